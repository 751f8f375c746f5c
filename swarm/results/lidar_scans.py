"""scans.parquet: one row per finished LiDAR scan and observer, of a run with LiDARs; and what the rows say in sum.

The pose is the target's in the lighthouse frame at the epoch of the row's lighthouse period. `measured` is what this
one scan gave, through the observer's own fix; `ekf` the observer's own filter afterwards. The fused estimate of all
observers is in telemetry.parquet, as the target's own row. What is not known is null.

The file grows under another name and is renamed when it is complete: a run that was killed has none.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from estimators.arrays import Floats
from estimators.rotation import angle_between, log, matrix_from_quaternion, quaternion_from_matrix
from swarm.onboard.inspection import LidarFix
from swarm.results.disk import writing
from swarm.results.records import Truth

FILE = "scans.parquet"
PARTIAL = FILE + ".partial"
ROWS = 512


_NAME = pa.dictionary(pa.int32(), pa.string())
COLUMNS: tuple[tuple[str, pa.DataType, str, str], ...] = (
    ("time_s", pa.float64(), "s", "the epoch that everything refers to"),
    ("frame", pa.int32(), "1", "number of the lighthouse period"),
    ("observer", _NAME, "", "the craft that carries the LiDAR"),
    ("target", _NAME, "", "the craft that it inspects"),
    ("outcome", _NAME, "", "what became of the scan: tracked, found, or why not"),
    ("acquired", pa.bool_(), "", "it was acquired from nothing, not tracked"),
    ("accepted", pa.bool_(), "", "the observer's filter took the pose in"),
    ("points", pa.int32(), "1", "returns of the target"),
    ("range_m", pa.float64(), "m", "true distance from the observer to the target"),
    ("residual_m", pa.float64(), "m", "RMS of the registration's residuals"),
    ("overlap", pa.float64(), "1", "share of the rays that agree with the pose"),
    ("confidence", pa.float64(), "1", "of an acquisition: above a half where it is believed"),
    *((f"measured_p{a}_m", pa.float64(), "m", f"pose of this scan: position, {a}") for a in "xyz"),
    *((f"measured_q{a}", pa.float64(), "1", f"pose of this scan: attitude quaternion, {a} (w >= 0)") for a in "wxyz"),
    ("measured_position_error_m", pa.float64(), "m", "distance of that pose from the truth"),
    ("measured_attitude_error_deg", pa.float64(), "deg", "angle of that pose from the truth"),
    ("measured_nees", pa.float64(), "1", "its squared error normalised by its covariance, 6 degrees of freedom"),
    ("nis", pa.float64(), "1", "its squared innovation normalised by its covariance, 6 degrees of freedom"),
    ("ekf_position_error_m", pa.float64(), "m", "distance of the observer's filter from the truth"),
    ("ekf_attitude_error_deg", pa.float64(), "deg", "angle of the observer's filter from the truth"),
    ("ekf_nees", pa.float64(), "1", "its squared error normalised by its covariance, 6 degrees of freedom"),
)
"""Name, type, unit and meaning."""


def schema() -> pa.Schema:
    """The columns, each with its `unit` and `meaning` as field metadata."""
    return pa.schema([pa.field(n, kind, metadata={"unit": unit, "meaning": what}) for n, kind, unit, what in COLUMNS])


class ScanWriter:
    """Writes the scans of one run into its folder: `append` every period, `close` at the end."""

    def __init__(self, folder: Path, craft: Sequence[str]) -> None:
        self._folder, self._craft, self._schema = folder, list(craft), schema()
        self._rows: list[dict[str, Any]] = []
        with writing(folder / PARTIAL):
            self._file = pq.ParquetWriter(folder / PARTIAL, self._schema, compression="snappy")

    def append(self, time_s: float, frame: int, fixes: Sequence[LidarFix], truth: Truth) -> None:
        """Take what became of the scans of one period. Raises SwarmError on a full disk."""
        self._rows += [_row(time_s, frame, self._craft, fix, truth) for fix in fixes]
        if len(self._rows) >= ROWS:
            self._flush()

    def _flush(self) -> None:
        with writing(self._folder / PARTIAL):
            self._file.write_table(pa.Table.from_pylist(self._rows, schema=self._schema))
        self._rows = []

    def close(self) -> None:
        """Complete the file. Raises SwarmError on a full disk."""
        if self._rows:
            self._flush()
        with writing(self._folder / FILE):
            self._file.close()
            (self._folder / PARTIAL).replace(self._folder / FILE)


def _row(time_s: float, frame: int, craft: Sequence[str], fix: LidarFix, truth: Truth) -> dict[str, Any]:
    true_position, rotation = truth.position[fix.target], matrix_from_quaternion(truth.quaternion[fix.target])
    known = bool(np.isfinite(fix.position).all())
    turn = quaternion_from_matrix(fix.rotation) if known else np.full(4, np.nan)
    measured = _errors(rotation, true_position, fix.rotation, fix.position, fix.covariance)
    ekf = _errors(rotation, true_position, fix.ekf_rotation, fix.ekf_position, fix.ekf_covariance)
    row = {
        "time_s": time_s,
        "frame": frame,
        "observer": craft[fix.craft],
        "target": craft[fix.target],
        "outcome": fix.outcome,
        "acquired": fix.acquired,
        "accepted": fix.accepted,
        "points": fix.points,
        "range_m": float(np.linalg.norm(true_position - truth.position[fix.craft])),
        "residual_m": fix.residual_m,
        "overlap": fix.overlap,
        "confidence": fix.confidence,
        **{f"measured_p{a}_m": float(v) for a, v in zip("xyz", fix.position, strict=True)},
        **{f"measured_q{a}": float(v) for a, v in zip("wxyz", turn, strict=True)},
        **dict(
            zip(("measured_position_error_m", "measured_attitude_error_deg", "measured_nees"), measured, strict=True)
        ),
        "nis": fix.nis,
        **dict(zip(("ekf_position_error_m", "ekf_attitude_error_deg", "ekf_nees"), ekf, strict=True)),
    }
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in row.items()}


def _errors(
    true_rotation: Floats, true_position: Floats, rotation: Floats, position: Floats, covariance: Floats
) -> tuple[float, float, float]:
    """Distance [m], angle [deg] and NEES."""
    if not (np.isfinite(rotation).all() and np.isfinite(position).all() and np.isfinite(covariance).all()):
        return float("nan"), float("nan"), float("nan")
    error = np.concatenate([log(true_rotation @ rotation.T), true_position - position])
    nees = float(error @ np.linalg.solve(covariance, error))
    return float(np.linalg.norm(error[3:])), float(np.degrees(angle_between(true_rotation, rotation))), nees


def summarise_scans(folder: Path) -> dict[str, Any]:
    """What every observer made of its scans, for summary.json; empty where there is no file."""
    if not (folder / FILE).exists():
        return {}
    table = pq.read_table(folder / FILE).to_pydict()
    out: dict[str, Any] = {}
    for name in sorted(set(table["observer"])):
        mine = [i for i, observer in enumerate(table["observer"]) if observer == name]

        def column(key: str, rows: list[int] = mine) -> Floats:
            return np.array([np.nan if table[key][i] is None else table[key][i] for i in rows], dtype=np.float64)

        def figure(key: str, of: Any, values: Any = column) -> float | None:
            known = values(key)[np.isfinite(values(key))]
            return float(of(known)) if len(known) else None

        outcome = [table["outcome"][i] for i in mine]
        out[name] = {
            "target": table["target"][mine[0]],
            "scans": len(mine),
            "tracked_share": outcome.count("tracked") / len(mine),
            "acquisitions": sum(1 for i in mine if table["acquired"][i] and table["outcome"][i] == "found"),
            "outcomes": {word: outcome.count(word) for word in sorted(set(outcome))},
            "points_median": figure("points", np.median),
            "measured_attitude_mean_deg": figure("measured_attitude_error_deg", np.mean),
            "measured_attitude_max_deg": figure("measured_attitude_error_deg", np.max),
            "measured_position_mean_m": figure("measured_position_error_m", np.mean),
            "measured_nees_mean": figure("measured_nees", np.mean),
            "ekf_attitude_mean_deg": figure("ekf_attitude_error_deg", np.mean),
            "ekf_attitude_max_deg": figure("ekf_attitude_error_deg", np.max),
            "ekf_position_mean_m": figure("ekf_position_error_m", np.mean),
            "ekf_nees_mean": figure("ekf_nees", np.mean),
        }
    return {"lidar": out}
