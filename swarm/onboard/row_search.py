"""Search for the pose of a craft that knows nothing, by rows of any number of stations; mirror images stay open.

A period's rows may not determine a pose, so those of the last `KEPT_S` count together; the craft is taken to be at rest
meanwhile. Every pose that fits (`estimators.lighthouse.row_start`) is a hypothesis and is refined in each later period.
With F the chi-square of a hypothesis's fit, the second one is refuted where, over m periods,

    D = sum (F_2 - F_1) / (g (1 + m q))  >=  `DECISIVE`,   q = (place / distance)^2 / own^2

with g the best fit's F per degree of freedom where it is above one, and q the variance of what does not change between
periods: photodiodes off their places look the same in each of them, and no number of periods averages that out. A
second station, a turn of the craft or the distance decides then, or nothing does, and the craft says so.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_pose import RowPose
from estimators.lighthouse.row_start import refined_starts, row_starts, trimmed
from estimators.lighthouse.rows import Rows, Station
from swarm.onboard.acquisition import DECISIVE

KEPT_S = 0.04
"""Time over which rows are gathered for a search [s]: two turns of a rotor."""
WIDE_RAD = 0.15
"""Uncertainty of the attitude [rad] beyond which a pose starts no filter."""
FEWEST_PHOTODIODES = (4, 3)
"""Photodiodes that a search needs before one station, and before several."""


class _Hypotheses(NamedTuple):
    """Poses of one craft, best first: pose; evidence (M,), summed F; periods, their number."""

    pose: RowPose
    evidence: Floats
    periods: int


class Found(NamedTuple):
    """Result of one craft's search: index of the pose in `pose` that is certain, None if none is; undecided: whether
    there are hypotheses.
    """

    pose: RowPose | None
    certain: bool
    undecided: bool


NOTHING = Found(None, False, False)


class RowSearch:
    """The searches of C craft."""

    def __init__(
        self, point_m: Floats, stations: Sequence[Station], noise: Sequence[AngleNoise], frame_s: float, place_m: float
    ) -> None:
        """Begin without a row.

        Args:
            point_m: (C, K, 3) [m], photodiodes as the craft assume them.
            stations: all stations.
            noise: noise of their rows.
            frame_s: period of the filter [s].
            place_m: by how much photodiodes may be off their places [m].
        """
        self._point_m, self._stations, self._noise = point_m, stations, noise
        self._frame_s, self._place_m = frame_s, place_m
        self._batches: list[RowBatch] = []
        self._known = np.zeros(len(point_m), dtype=np.int64)
        self._open: list[_Hypotheses | None] = [None] * len(point_m)

    def forget(self, mask: Bools) -> None:
        """Forget the craft of the mask (C,)."""
        self._known[mask] = 0
        for c in np.flatnonzero(mask):
            self._open[c] = None

    def gather(self, rows: RowBatch) -> None:
        """Keep this period's rows of every craft."""
        most = int(np.ceil(KEPT_S / self._frame_s)) + 1
        self._batches = [rows, *self._batches[: most - 1]]
        self._known = np.minimum(self._known + 1, most)

    def search(self, craft: int) -> Found:
        """Return what the rows of the last periods tell of one craft's pose."""
        rows = self._joined(craft)
        if rows is None or not self._enough(rows):
            # Nothing new: a hypothesis waits.
            waiting = self._open[craft]
            return Found(None, False, waiting is not None)
        before, args = self._open[craft], (rows, self._stations, self._point_m[craft], self._noise)
        found = self._followed(before, rows, craft) if before is not None else None
        if found is None:
            starts = trimmed(*args, row_starts(*args))
            found = _Hypotheses(starts.pose, starts.pose.cost.copy(), 1) if len(starts) else None
        self._open[craft] = found
        if found is None:
            return NOTHING
        return Found(found.pose, self._certain(found, craft), True)

    def settle(self, craft: int) -> None:
        """End one craft's search."""
        self._open[craft] = None

    def _joined(self, craft: int) -> Rows | None:
        """Return one craft's rows of the last periods, their sweeps told apart; None without any."""
        parts = []
        for age, batch in enumerate(self._batches[: self._known[craft]]):
            own = batch.of(craft)
            offset_s = own.offset_s - age * self._frame_s
            if np.any(offset_s > -KEPT_S):
                parts.append(own._replace(offset_s=offset_s, sweep=own.sweep + 1000 * age))
        return Rows._make(np.concatenate(column) for column in zip(*parts, strict=True)) if parts else None

    def _enough(self, rows: Rows) -> bool:
        several = len(np.unique(rows.station)) > 1
        return len(np.unique(rows.photodiode)) >= FEWEST_PHOTODIODES[several]

    def _followed(self, before: _Hypotheses, rows: Rows, craft: int) -> _Hypotheses | None:
        """Return the hypotheses of the period before, with this period's evidence; None if all are lost."""
        starts, args = (
            list(zip(*before.pose[:2], strict=True)),
            (rows, self._stations, self._point_m[craft], self._noise),
        )
        after = trimmed(*args, refined_starts(*args, starts))
        if not len(after):
            return None
        evidence = np.empty(len(after))
        for i, rotation in enumerate(after.pose.rotation):
            nearest = int(np.argmin(rot.angle_between(before.pose.rotation, rotation)))
            evidence[i] = before.evidence[nearest] + after.pose.cost[i]
        order = np.argsort(evidence, kind="stable")
        pose = RowPose._make(part[order] for part in after.pose)
        return _Hypotheses(pose, evidence[order], before.periods + 1)

    def _certain(self, found: _Hypotheses, craft: int) -> bool:
        pose = found.pose
        wide = float(np.sqrt(np.trace(pose.covariance[0][:3, :3])) * np.sqrt(scatter(pose, 0)))
        if wide > WIDE_RAD:
            return False
        if len(found.evidence) == 1:
            return True
        away = [float(np.linalg.norm(pose.position[0] - station.position)) for station in self._stations]
        own = min(noise.own_rad for noise in self._noise)
        constant = (self._place_m / min(away) / own) ** 2
        unit = scatter(pose, 0) * (1 + found.periods * constant)
        return bool((found.evidence[1] - found.evidence[0]) / unit >= DECISIVE)


def scatter(pose: RowPose, which: int) -> float:
    """Return F per degree of freedom of one of several poses, at least one."""
    return max(1.0, float(pose.cost[which]) / max(int(pose.rows[which]) - 6, 1))
