"""angles.parquet: every sweep angle that every craft measured, for `swarm calibrate`; a run writes it if asked to.

One row per lighthouse period, craft and photodiode that at least one fan has hit; null where the other was not seen.
Angles are as measured, before anything is taken off. The beliefs of the craft are in the schema's metadata,
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
from swarm.results.columns.column import Column
from swarm.results.files import ANGLES
from swarm.results.parquet import GrowingParquet, is_there, read_table
from swarm.results.table import TelemetryTable

_KEY = b"survey"
_ROWS, _PERIODS = 65_536, 120
"""Rows, and periods, that wait in memory at most: a run that is killed loses no more, as of its telemetry."""
_COLUMNS = (
    Column("frame", "1", "number of the lighthouse period", "whole", required=True),
    Column("craft", "", "name of the craft", "name", required=True),
    Column("photodiode", "1", "number of the photodiode on its craft", "small", required=True),
    *(Column(f"theta_{fan}_rad", "rad", f"angle since the flash of fan {fan.upper()}, as measured") for fan in "xy"),
    *(Column(f"offset_{fan}_s", "s", f"instant of the angle of fan {fan.upper()}, after the epoch") for fan in "xy"),
)


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
        self._columns = [column._replace(names=about.craft if column.name == "craft" else ()) for column in _COLUMNS]
        text = json.dumps(
            {
                "craft": about.craft,
                "point_m": [p.tolist() for p in about.point_m],
                "fans": [fan._asdict() for fan in about.fans],
                "noise": about.noise._asdict(),
            }
        )
        self._schema = pa.schema([column.field for column in _COLUMNS], metadata={_KEY: text.encode()})
        self._waiting: list[Floats] = []
        self._rows = 0
        self._file = GrowingParquet(folder / ANGLES, self._schema)

    def append(self, frame: int, angles: SweepAngles) -> None:
        """Take one period of all craft. Raises SwarmError on a full disk."""
        seen: Bools = np.isfinite(angles.theta)
        craft, photodiode = np.nonzero(seen.any(axis=2))
        theta, offset = angles.theta[craft, photodiode], angles.offset_s[craft, photodiode]
        offset = np.where(np.isfinite(theta), offset, np.nan)
        self._waiting.append(np.stack([np.full(len(craft), frame), craft, photodiode, *theta.T, *offset.T]))
        self._rows += len(craft)
        if self._rows >= _ROWS or len(self._waiting) >= _PERIODS:
            self._flush()

    def _flush(self) -> None:
        if not self._rows:
            return
        block = np.concatenate(self._waiting, axis=1)
        arrays = [column.array(value) for column, value in zip(self._columns, block, strict=True)]
        self._file.write(pa.Table.from_arrays(arrays, schema=self._schema))
        self._waiting, self._rows = [], 0

    def close(self) -> None:
        """Write what is left and give the file its name. Raises SwarmError on a full disk."""
        self._flush()
        self._file.close()


def read_angles(folder: Path) -> AngleTable:
    """Return the angles of the run in `folder`. Raises SwarmError where it has none, or they are damaged."""
    file = folder / ANGLES
    if not is_there(file):
        raise SwarmError(f"{folder} has no {ANGLES}: fly it again with --set recording.angles=true")
    try:
        table = read_table(file)
        about = _parse(json.loads(table.schema.metadata[_KEY]))
        rows = TelemetryTable.of(table)
        code = np.array([about.craft.index(name) for name in rows.names_of("craft")], dtype=np.int64)
        photodiode = rows.column("photodiode").astype(np.int64)
        theta, offset = (
            rows.stacked(*names) for names in (("theta_x_rad", "theta_y_rad"), ("offset_x_s", "offset_y_s"))
        )
        out = AngleTable(about, rows.frame, code[rows.craft], photodiode, theta, offset)
    except (KeyError, TypeError, ValueError) as error:
        raise SwarmError(f"cannot read {file}: {error}") from error
    return out


def _parse(data: dict[str, Any]) -> Believed:
    x, y = (FanErrors(**fan) for fan in data["fans"])
    points = tuple(np.array(p, dtype=np.float64).reshape(-1, 3) for p in data["point_m"])
    return Believed(tuple(data["craft"]), points, (x, y), Noise(**data["noise"]))
