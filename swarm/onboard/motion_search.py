"""Search for an object that a hand carries, and a watch over its filter: mirror images and lost tracks.

The rows of the last `KEPT_S` are solved with pose, rates and acceleration (`estimators.lighthouse.row_motion`), from
every pose that fits those of the last turn (`estimators.lighthouse.row_start`) and from its mirror images: of a rig in
one plane, before a station in the direction u, with n the rig's normal in its body,

    R' = (1 - 2 u u^T) R (1 - 2 n n^T)

looks nearly the same. One solution is certain where every other one's F is larger by `DECISIVE`, in units of its own F
per degree of freedom. A filter is started, or started again, with the state and the covariance of all twelve numbers.

The watch does the same for an object with a filter, every `WATCH_S` in which two stations have seen it, from its
filter's state and that state's mirror images. Where a certain solution is another pose than the filter's, the filter
has the wrong mirror image, or has lost the object: it is started again there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import RowBatch, gathered, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import MOTION, HandMotion, RowMotion, solve_motion
from estimators.lighthouse.row_start import row_starts
from estimators.lighthouse.rows import Rows, Station, packed
from estimators.state import State
from swarm.onboard.acquisition import DECISIVE

KEPT_S = 0.05
"""Time over which rows are solved together [s]: two turns of a rotor and more."""
TURN_S = 0.034
"""Time of the rows that tell poses of an object at rest [s]."""
WATCH_S = 0.05
"""Time between two looks of the watch [s]."""
FEWEST_ROWS = 12
FEWEST_PHOTODIODES = (4, 3)
"""Photodiodes that a search needs before one station, and before several."""
WIDE_RAD = 0.15
"""Uncertainty of the attitude [rad] beyond which a solution starts no filter."""
POOR = 25.0
"""F per degree of freedom beyond which a solution is none: some row is false."""
DISTINCT_RAD = 0.05
"""Turn between two solutions [rad] below which they are one."""
OTHER_RAD, OTHER_M, OTHER_SIGMAS = 0.5, 0.1, 6.0
"""A solution is another pose than the filter's beyond this turn [rad]; or beyond this distance [m], and so many
standard deviations of both."""


class MotionFound(NamedTuple):
    """Result of one object's search: its state without the craft axis and covariance (12, 12), None where none is
    certain; undecided: whether several fit.
    """

    state: State | None
    covariance: Floats | None
    undecided: bool


NOTHING = MotionFound(None, None, False)


class MotionSearch:
    """The searches and watches of C objects."""

    def __init__(
        self,
        point_m: Floats,
        stations: Sequence[Station],
        noise: Sequence[AngleNoise],
        frame_s: float,
        hand: HandMotion,
    ) -> None:
        """Begin without a row.

        Args:
            point_m: (C, K, 3) [m], photodiodes as the objects assume them.
            stations: all stations.
            noise: noise of their rows.
            frame_s: period of the filter [s].
            hand: how the objects are moved.
        """
        self._point_m, self._stations, self._noise, self._hand = point_m, list(stations), list(noise), hand
        self._frame_s = frame_s
        self._light = light_of(packed(self._stations), self._noise)
        self._flip = [_reflection(_normal(point)) for point in point_m]
        self._batches: list[RowBatch] = []
        self._known = np.zeros(len(point_m), dtype=np.int64)
        self._most = int(np.ceil(KEPT_S / frame_s)) + 1
        self._every = max(round(WATCH_S / frame_s), 1)
        self._wait = 0

    def forget(self, mask: Bools) -> None:
        """Forget the objects of the mask (C,)."""
        self._known[mask] = 0

    def gather(self, rows: RowBatch) -> None:
        """Keep this period's rows of every object."""
        self._batches = [rows, *self._batches[: self._most - 1]]
        self._known = np.minimum(self._known + 1, self._most)
        self._wait = (self._wait + 1) % self._every

    def search(self, craft: int) -> MotionFound:
        """Return what the rows of the last periods tell of one object that has no filter."""
        rows = self._joined(craft, KEPT_S)
        if rows is None or not _enough(rows):
            return NOTHING
        recent = self._joined(craft, TURN_S)
        starts = row_starts(recent if recent is not None else rows, self._stations, self._point_m[craft], self._noise)
        poses = list(zip(starts.pose.rotation, starts.pose.position, strict=True))
        if not poses:
            return NOTHING
        poses += self._mirrors(craft, rows, *poses[0])
        still = np.zeros((len(poses), 3))
        start = State(np.array([r for r, _ in poses]), np.array([p for _, p in poses]), still, still)
        return self._decided(craft, rows, start)

    def watched(self, craft: int, state: State, covariance: Floats) -> MotionFound:
        """Return the state of one object that has a filter, where it is certain and another than the filter's.

        Args:
            craft: the object.
            state: its filter's, without the craft axis.
            covariance: (12, 12), likewise.
        """
        rows = self._joined(craft, KEPT_S) if self._wait == 0 else None
        if rows is None or not _enough(rows) or len(np.unique(rows.station)) < 2:
            return NOTHING
        poses = [(state.rotation, state.position), *self._mirrors(craft, rows, state.rotation, state.position)]
        many = len(poses)
        start = State(
            np.array([r for r, _ in poses]),
            np.array([p for _, p in poses]),
            np.tile(state.velocity, (many, 1)),
            np.concatenate([state.angular_rate[None], np.zeros((many - 1, 3))]),
        )
        found = self._decided(craft, rows, start)
        if found.state is None or found.covariance is None:
            return NOTHING
        turned = float(rot.angle_between(found.state.rotation[None], state.rotation)[0])
        away = found.state.position - state.position
        both = found.covariance[6:9, 6:9] + covariance[6:9, 6:9]
        far = float(np.linalg.norm(away)) > OTHER_M and float(away @ np.linalg.solve(both, away)) > OTHER_SIGMAS**2
        return found if turned > OTHER_RAD or far else NOTHING

    def _joined(self, craft: int, span_s: float) -> Rows | None:
        """Return one object's rows of the last `span_s`, their sweeps told apart; None without any."""
        parts = []
        for age, batch in enumerate(self._batches[: self._known[craft]]):
            own = batch.of(craft)
            offset_s = own.offset_s - age * self._frame_s
            kept = offset_s > -span_s
            if kept.any():
                own = own._replace(offset_s=offset_s, sweep=own.sweep + 1000 * age)
                parts.append(Rows._make(part[kept] for part in own))
        return Rows._make(np.concatenate(column) for column in zip(*parts, strict=True)) if parts else None

    def _mirrors(self, craft: int, rows: Rows, rotation: Floats, position: Floats) -> list[tuple[Floats, Floats]]:
        """Return the mirror images of a pose before the stations that see the object."""
        out = []
        for s in np.unique(rows.station).tolist():
            ahead = position - self._stations[s].position
            out.append((_reflection(ahead) @ rotation @ self._flip[craft], position))
        return out

    def _decided(self, craft: int, rows: Rows, start: State) -> MotionFound:
        """Return the one state that fits the rows, from several starts."""
        many = len(start.position)
        one = gathered(np.zeros(len(rows.angle), dtype=np.int64), rows, 1)
        batch = RowBatch._make(
            (len(rows.angle) * np.arange(many + 1, dtype=np.int64), *(np.tile(part, many) for part in one[1:]))
        )
        point = np.broadcast_to(self._point_m[craft], (many, *self._point_m.shape[1:]))
        found = solve_motion(batch, self._light, point, start, self._hand)
        order = _distinct(found)
        if not order:
            return NOTHING
        best = order[0]
        unit = max(1.0, float(found.cost[best]) / max(len(rows.angle) - MOTION, 1))
        covariance = found.covariance[best] * unit
        if unit > POOR or float(np.sqrt(np.trace(covariance[:3, :3]))) > WIDE_RAD:
            return MotionFound(None, None, len(order) > 1)
        if len(order) > 1 and float(found.cost[order[1]] - found.cost[best]) < DECISIVE * unit:
            return MotionFound(None, None, True)
        return MotionFound(found.state.of(best), covariance, True)


def _enough(rows: Rows) -> bool:
    several = len(np.unique(rows.station)) > 1
    return len(rows.angle) >= FEWEST_ROWS and len(np.unique(rows.photodiode)) >= FEWEST_PHOTODIODES[several]


def _distinct(found: RowMotion) -> list[int]:
    """Return the different solutions, best first."""
    order: list[int] = []
    for i in np.argsort(np.where(found.solved, found.cost, np.inf), kind="stable").tolist():
        turned = rot.angle_between(found.state.rotation[order], found.state.rotation[i])
        if found.solved[i] and np.all(turned > DISTINCT_RAD):
            order.append(i)
    return order


def _normal(point: Floats) -> Floats:
    """Return the normal of the plane that is nearest to points (K, 3)."""
    out: Floats = np.linalg.svd(point - point.mean(axis=0))[2][2]
    return out


def _reflection(axis: Floats) -> Floats:
    """Return the reflection (3, 3) along an axis."""
    unit = axis / np.linalg.norm(axis)
    out: Floats = np.eye(3) - 2 * unit[:, None] * unit
    return out
