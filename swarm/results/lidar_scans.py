"""scans.parquet: one row per finished LiDAR scan and observer, of a run with LiDARs.

The pose is the target's in the lighthouse frame at the epoch of the row's lighthouse period. `measured` is what this
one scan gave, through the observer's own fix; `ekf` the observer's own filter afterwards. The fused estimate of all
observers is in telemetry.parquet, as the target's own row. What is not known is null. Of a symmetric target, errors
are those of the equivalent pose nearest to the truth.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats
from estimators.filter.tumble import Inertia
from estimators.lidar.symmetry import Symmetry
from estimators.rotation import angle_between, log, matrix_from_quaternion, quaternion_from_matrix
from swarm.onboard.inspection import LidarFix
from swarm.results.columns.column import Column
from swarm.results.files import SCANS
from swarm.results.parquet import GrowingParquet
from swarm.results.period import Period
from swarm.results.records import Truth

ROWS, PERIODS = 512, 120
"""Scans, and periods, that wait in memory at most: a run that is killed loses no more, as of its telemetry."""

COLUMNS = (
    Column("time_s", "s", "the epoch that everything refers to"),
    Column("frame", "1", "number of the lighthouse period", "whole"),
    Column("observer", "", "the craft that carries the LiDAR", "name"),
    Column("target", "", "the craft that it inspects", "name"),
    Column("outcome", "", "what became of the scan: tracked, found, or why not", "name"),
    Column("acquired", "", "it was acquired from nothing, not tracked", "yes"),
    Column("accepted", "", "the observer's filter took the pose in", "yes"),
    Column("points", "1", "returns of the target", "whole"),
    Column("range_m", "m", "true distance from the observer to the target"),
    Column("residual_m", "m", "RMS of the registration's residuals"),
    Column("overlap", "1", "share of the rays that agree with the pose"),
    Column("confidence", "1", "of an acquisition: above a half where it is believed"),
    *(Column(f"measured_p{a}_m", "m", f"pose of this scan: position, {a}") for a in "xyz"),
    *(Column(f"measured_q{a}", "1", f"pose of this scan: attitude quaternion, {a} (w >= 0)") for a in "wxyz"),
    Column("measured_position_error_m", "m", "distance of that pose from the truth"),
    Column("measured_attitude_error_deg", "deg", "angle of that pose from the truth"),
    Column("measured_nees", "1", "its squared error normalised by its covariance, 6 degrees of freedom"),
    Column("nis", "1", "its squared innovation normalised by its covariance, 6 degrees of freedom"),
    Column("ekf_position_error_m", "m", "distance of the observer's filter from the truth"),
    Column("ekf_attitude_error_deg", "deg", "angle of the observer's filter from the truth"),
    Column("ekf_nees", "1", "its squared error normalised by its covariance, 6 degrees of freedom"),
    *(Column(f"inertia_{a}", "1", f"the target's principal moment {a}, ascending, against their mean") for a in "123"),
    *(Column(f"inertia_sigma_{a}", "1", f"relative standard deviation of moment {a}") for a in "123"),
    Column("inertia_observed", "1", "of the five ratios of inertia, how many have become twice as well known", "whole"),
)


SCHEMA = pa.schema([column.field for column in COLUMNS])


class ScanWriter:
    """Writes the scans of one run into its folder: `append` every period, `close` at the end."""

    def __init__(self, folder: Path, craft: Sequence[str]) -> None:
        self._craft = list(craft)
        self._rows: list[dict[str, Any]] = []
        self._periods = 0
        self._file = GrowingParquet(folder / SCANS, SCHEMA)

    def append(self, period: Period) -> None:
        """Take what became of the scans of one period. Raises SwarmError on a full disk."""
        if period.truth is not None:
            self._rows += [_row(period.time_s, period.frame, self._craft, fix, period.truth) for fix in period.scans]
        self._periods += 1
        if len(self._rows) >= ROWS or (self._rows and self._periods >= PERIODS):
            self._flush()

    def _flush(self) -> None:
        self._periods = 0
        self._file.write(pa.Table.from_pylist(self._rows, schema=SCHEMA))
        self._rows = []

    def close(self) -> None:
        """Complete the file. Raises SwarmError on a full disk."""
        if self._rows:
            self._flush()
        self._file.close()


def _row(time_s: float, frame: int, craft: Sequence[str], fix: LidarFix, truth: Truth) -> dict[str, Any]:
    true_position, rotation = truth.position[fix.target], matrix_from_quaternion(truth.quaternion[fix.target])
    known = bool(np.isfinite(fix.position).all())
    turn = quaternion_from_matrix(fix.rotation) if known else np.full(4, np.nan)
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
        **_errors("measured", fix.symmetry, (rotation, true_position), fix.rotation, fix.position, fix.covariance),
        "nis": fix.nis,
        **_errors(
            "ekf", fix.symmetry, (rotation, true_position), fix.ekf_rotation, fix.ekf_position, fix.ekf_covariance
        ),
        **_inertia(fix.inertia),
    }
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in row.items()}


def _inertia(known: Inertia | None) -> dict[str, Any]:
    """Return the columns of the ratios of inertia."""
    if known is None:
        return {}
    return {
        **{f"inertia_{a}": float(v) for a, v in zip("123", known.moments, strict=True)},
        **{f"inertia_sigma_{a}": float(v) for a, v in zip("123", known.sigma, strict=True)},
        "inertia_observed": known.observed,
    }


def _errors(
    prefix: str,
    symmetry: Symmetry,
    true: tuple[Floats, Floats],
    rotation: Floats,
    position: Floats,
    covariance: Floats,
) -> dict[str, float]:
    if not (np.isfinite(rotation).all() and np.isfinite(position).all() and np.isfinite(covariance).all()):
        return {}
    true_rotation, true_position = symmetry.nearest(*true, rotation)
    error = np.concatenate([log(true_rotation @ rotation.T), true_position - position])
    return {
        f"{prefix}_position_error_m": float(np.linalg.norm(error[3:])),
        f"{prefix}_attitude_error_deg": float(np.degrees(angle_between(true_rotation, rotation))),
        f"{prefix}_nees": float(error @ np.linalg.solve(covariance, error)),
    }
