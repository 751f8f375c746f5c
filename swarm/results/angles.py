"""angles.parquet: every sweep angle that every craft measured, for `swarm calibrate`; a run writes it if asked to.

One row per lighthouse period, craft and photodiode that at least one fan has hit: `theta_x_rad`, `theta_y_rad`, the
angles since the fan's own flash as measured, before anything is taken off; `offset_x_s`, `offset_y_s`, each angle's
instant after the epoch; null where that fan was not seen. The beliefs of the craft are in the schema's metadata,
`survey`, as JSON: see `Believed`.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Bools, Floats, Ints
from estimators.calibration.problem import Noise
from estimators.lighthouse.sweep import FanErrors, FanPair
from swarm.errors import SwarmError
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.results.files import ANGLES
from swarm.results.parquet import PARTIAL, GrowingParquet, read_table

_KEY = b"survey"
_ROWS = 65_536
_VALUES = ("theta_x_rad", "theta_y_rad", "offset_x_s", "offset_y_s")


class Believed(NamedTuple):
    """Beliefs of the craft while they measured.

    craft: their names. point_m: places of each craft's photodiodes, (k, 3) [m]. fans: errors that were taken off the
    angles. noise: of one angle.
    """

    craft: tuple[str, ...]
    point_m: tuple[Floats, ...]
    fans: FanPair
    noise: Noise


class AngleTable(NamedTuple):
    """A run's angles, M rows: frame, craft (index into Believed.craft), photodiode (M,); theta, offset_s (M, 2)."""

    believed: Believed
    frame: Ints
    craft: Ints
    photodiode: Ints
    theta: Floats
    offset_s: Floats


def believed(craft: Sequence[str], layout: Photodiodes, fans: FanPair, noise: Noise) -> Believed:
    """Return the beliefs of craft.

    Args:
        craft: Their names.
        layout: Their photodiodes.
        fans: Errors of the fans that they take off the angles.
        noise: Noise of one angle.
    """
    points = tuple(layout.point_m[i][layout.present[i]] for i in range(layout.craft_count))
    return Believed(tuple(craft), points, fans, noise)


class AngleWriter:
    """Writes the angles of one run into its folder: `append` every period, `close` at the end."""

    def __init__(self, folder: Path, about: Believed) -> None:
        fields = [
            pa.field("frame", pa.int32(), nullable=False),
            pa.field("craft", pa.dictionary(pa.int32(), pa.string()), nullable=False),
            pa.field("photodiode", pa.int16(), nullable=False),
            *(pa.field(name, pa.float64()) for name in _VALUES),
        ]
        text = json.dumps(
            {
                "craft": about.craft,
                "point_m": [p.tolist() for p in about.point_m],
                "fans": [fan._asdict() for fan in about.fans],
                "noise": about.noise._asdict(),
            }
        )
        self._schema = pa.schema(fields, metadata={_KEY: text.encode()})
        self._names = pa.array(about.craft, pa.string())
        self._waiting: list[tuple[Ints, Ints, Ints, Floats]] = []
        self._rows = 0
        self._file = GrowingParquet(folder / ANGLES, self._schema)

    def append(self, frame: int, angles: SweepAngles) -> None:
        """Take one period of all craft. Raises SwarmError on a full disk."""
        seen: Bools = np.isfinite(angles.theta)
        craft, photodiode = np.nonzero(seen.any(axis=2))
        theta, offset = angles.theta[craft, photodiode], angles.offset_s[craft, photodiode]
        offset = np.where(np.isfinite(theta), offset, np.nan)
        self._waiting.append((np.full(len(craft), frame), craft, photodiode, np.concatenate([theta, offset], axis=1)))
        self._rows += len(craft)
        if self._rows >= _ROWS:
            self._flush()

    def _flush(self) -> None:
        if not self._rows:
            return
        frame, craft, photodiode, value = (np.concatenate(column) for column in zip(*self._waiting, strict=True))
        columns = [
            pa.array(frame, pa.int32()),
            pa.DictionaryArray.from_arrays(pa.array(craft, pa.int32()), self._names),
            pa.array(photodiode, pa.int16()),
            *(pa.array(v, pa.float64(), mask=~np.isfinite(v)) for v in value.T),
        ]
        self._file.write(pa.Table.from_arrays(columns, schema=self._schema))
        self._waiting, self._rows = [], 0

    def close(self) -> None:
        """Write what is left and give the file its name. Raises SwarmError on a full disk."""
        self._flush()
        self._file.close()


def read_angles(folder: Path) -> AngleTable:
    """Return the angles of the run in `folder`. Raises SwarmError where it has none, or they are damaged."""
    file = folder / ANGLES
    if not file.exists():
        raise SwarmError(
            f"{folder} has no {ANGLES}: fly it again with --set recording.angles=true"
            + (" (a run that was killed leaves none)" if (folder / (ANGLES + PARTIAL)).exists() else "")
        )
    try:
        table = read_table(file)
        about = _parse(json.loads(table.schema.metadata[_KEY]))
        names = table.column("craft").combine_chunks()
        dictionary = names.dictionary.to_pylist()
        code = np.array([about.craft.index(name) for name in dictionary], dtype=np.int64)
        value = np.stack([table.column(name).to_numpy() for name in _VALUES], axis=1)
        out = AngleTable(
            about,
            table.column("frame").to_numpy().astype(np.int64),
            code[names.indices.to_numpy()],
            table.column("photodiode").to_numpy().astype(np.int64),
            value[:, :2],
            value[:, 2:],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error
    return out


def _parse(data: dict[str, Any]) -> Believed:
    x, y = (FanErrors(**fan) for fan in data["fans"])
    points = tuple(np.array(p, dtype=np.float64).reshape(-1, 3) for p in data["point_m"])
    return Believed(tuple(data["craft"]), points, (x, y), Noise(**data["noise"]))
