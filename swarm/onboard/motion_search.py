"""Search for an object that a hand carries, and a watch over its filter: mirror images and lost tracks.

The rows of the last `KEPT_S` are solved with pose, rates and acceleration (`estimators.lighthouse.row_motion`), from
every pose that fits those of the last turn (`estimators.lighthouse.row_start`) and from its mirror images: of a rig in
one plane, before a station in the direction u, with n the rig's normal in its body,

    R' = (1 - 2 u u^T) R (1 - 2 n n^T)

looks nearly the same. Rows that contradict a solution are left out of it (`estimators.lighthouse.row_snooping`), and it
is solved again. One solution is certain where every other one's F is larger by `DECISIVE`, in units of its own F per
degree of freedom. A filter is started, or started again, with the state and the covariance of all twelve numbers.

The watch does the same for an object with a filter, every `WATCH_S` in which two stations have seen it, from its
filter's state and that state's mirror images. Where a certain solution is another pose than the filter's, the filter
has the wrong mirror image, or has lost the object: it is started again there. Where one station alone sees an object in
one plane, its filter may slip to the mirror image whenever that is within a few standard deviations of the attitude.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import RowBatch, gathered, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import MOTION, HandMotion, RowMotion, solve_motion
from estimators.lighthouse.row_snooping import LIMIT, snooped
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
FLAT = 0.1
"""Thickness of a rig relative to its width below which it is in one plane."""
MIRROR_SIGMAS = 4.0
"""Standard deviations of the attitude that a mirror image must be away for a track not to slip there."""


class MotionFound(NamedTuple):
    """Result of one object's search: its state without the craft axis and covariance (12, 12), None where none is
    certain; undecided: whether several fit; rows: those that the state was solved from; confirmed: whether what is
    certain is the filter's own state.
    """

    state: State | None
    covariance: Floats | None
    undecided: bool
    rows: Rows | None = None
    confirmed: bool = False


NOTHING = MotionFound(None, None, False)
Contradiction = Callable[[int, State, Floats], Floats]
"""Function of an object, of states (N, ...) of it and their covariances (N, 12, 12): by how much other sensors
contradict them, chi-square."""


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
        self._packed = packed(self._stations)
        self._light = light_of(self._packed, self._noise)
        self._flat = [_flat(point) for point in point_m]
        self._flip = [_reflection(_normal(point)) for point in point_m]
        self._batches: list[RowBatch] = []
        self._known = np.zeros(len(point_m), dtype=np.int64)
        self._most = int(np.ceil(KEPT_S / frame_s)) + 1
        self._every = max(round(WATCH_S / frame_s), 1)
        self._wait = 0
        self._contradiction: Contradiction | None = None

    def forget(self, mask: Bools) -> None:
        """Forget the objects of the mask (C,)."""
        self._known[mask] = 0

    def gather(self, rows: RowBatch, contradiction: Contradiction | None = None) -> None:
        """Keep this period's rows of every object, and what tells what other sensors say of its states."""
        self._contradiction = contradiction
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

    def watched(self, craft: int, state: State, covariance: Floats, *, doubted: bool) -> MotionFound:
        """Return the state of one object that has a filter, where it is certain and another than the filter's.

        Args:
            craft: the object.
            state: its filter's, without the craft axis.
            covariance: (12, 12), likewise.
            doubted: whether to look where one station alone has seen the object, too.
        """
        rows = self._joined(craft, KEPT_S) if self._wait == 0 else None
        if rows is None or not _enough(rows) or not (doubted or len(np.unique(rows.station)) > 1):
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
        return found if turned > OTHER_RAD or far else NOTHING._replace(confirmed=True)

    def mirror_doubtful(self, craft: int, rows: Rows, state: State, covariance: Floats) -> bool:
        """Return whether one object's filter may have slipped to its mirror image before the only station that sees it.

        Args:
            craft: the object.
            rows: of this period.
            state: the filter's, without the craft axis.
            covariance: (12, 12), likewise.
        """
        if not self._flat[craft] or len(np.unique(rows.station)) != 1:
            return False
        turn = self._mirrors(craft, rows, state.rotation, state.position)[0][0] @ state.rotation.T
        away = rot.log(turn[None])[0]
        square = float(away @ away)
        return square**2 < MIRROR_SIGMAS**2 * float(away @ covariance[:3, :3] @ away)

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
        found, used = self._solved(craft, rows, start)
        if self._contradiction is not None:
            found = found._replace(cost=found.cost + self._contradiction(craft, found.state, found.covariance))
        order = _distinct(found)
        if not order:
            return NOTHING
        best = order[0]
        unit = max(1.0, float(found.cost[best]) / max(int(used[best].sum()) - MOTION, 1))
        covariance = found.covariance[best] * unit
        if unit > POOR or float(np.sqrt(np.trace(covariance[:3, :3]))) > WIDE_RAD:
            return MotionFound(None, None, len(order) > 1)
        if len(order) > 1 and float(found.cost[order[1]] - found.cost[best]) < DECISIVE * unit:
            return MotionFound(None, None, True)
        own = Rows._make(part[used[best]] for part in rows)
        return MotionFound(found.state.of(best), covariance, True, own)

    def _solved(self, craft: int, rows: Rows, start: State) -> tuple[RowMotion, list[Bools]]:
        """Return the solutions from several starts without the rows that contradict each one, and which rows each has;
        a row that is left out costs as much as it may at most.
        """
        point = np.broadcast_to(self._point_m[craft], (len(start.position), *self._point_m.shape[1:]))
        every: Bools = np.ones(len(rows.angle), dtype=np.bool_)
        used = [every] * len(start.position)
        found = solve_motion(_side_by_side(rows, used), self._light, point, start, self._hand)
        wide = np.diag(np.repeat(np.square([1.0, self._hand.angular_rate, 1.0, self._hand.velocity]), 3))
        for i in np.flatnonzero(found.solved).tolist():
            used[i] = snooped(
                rows,
                self._packed,
                self._point_m[craft],
                found.state.of(i),
                wide,
                self._noise,
                self._hand.acceleration,
            )
        if all(kept.all() for kept in used):
            return found, used
        again = solve_motion(_side_by_side(rows, used), self._light, point, found.state, self._hand)
        lost = np.array([np.count_nonzero(~kept) for kept in used])
        return again._replace(solved=again.solved & found.solved, cost=again.cost + lost * LIMIT**2), used


def _side_by_side(rows: Rows, used: Sequence[Bools]) -> RowBatch:
    """Return the used rows of one object as those of as many objects as there are masks."""
    parts = [Rows._make(part[kept] for part in rows) for kept in used]
    craft = np.repeat(np.arange(len(used)), [len(part.angle) for part in parts])
    return gathered(craft, Rows._make(np.concatenate(column) for column in zip(*parts, strict=True)), len(used))


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


def _flat(point: Floats) -> bool:
    """Return whether points (K, 3) are nearly in one plane, so that mirror images look alike."""
    size = np.linalg.svd(point - point.mean(axis=0), compute_uv=False)
    return bool(size[2] < FLAT * size[1])


def _normal(point: Floats) -> Floats:
    """Return the normal of the plane that is nearest to points (K, 3)."""
    out: Floats = np.linalg.svd(point - point.mean(axis=0))[2][2]
    return out


def _reflection(axis: Floats) -> Floats:
    """Return the reflection (3, 3) along an axis."""
    unit = axis / np.linalg.norm(axis)
    out: Floats = np.eye(3) - 2 * unit[:, None] * unit
    return out
