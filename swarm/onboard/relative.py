"""Relative navigation: named pairs of craft, of which one knows the other's pose in its own axes, and how well.

The other craft broadcasts its estimate with what its filter makes of shared errors (`swarm.onboard.pose_message`). From
that and its own the craft carries on the covariance between both errors (`estimators.relative.cross`), and has the
relative state with the covariance of the difference. Beside it are those of a craft that takes both errors to be
independent, and of one that allows for any correlation.

A protection level is the noise's, K times the root of the trace, plus what an undetected false photodiode may do to
either craft: the faults of both positions, and that of the own attitude times the distance.

The covariance between both needs every message. After a gap it is not known before both filters have forgotten the
errors that they had then; until that, the covariance is the one that holds for any correlation.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimators.arrays import Bools, Floats, Ints
from estimators.relative.cross import cross_covariance
from estimators.relative.pose import covariance_between, covariance_bound, relative
from estimators.state import STATES, State
from swarm.onboard.pose_message import PoseMessage, decoded, encoded
from swarm.onboard.shared_errors import Relations, SharedErrors

FORGOTTEN = 0.01
"""Share of a filter's variance of position at which errors from before a gap count as forgotten."""


class RelativePoses(NamedTuple):
    """Relative states that N pairs know at the epoch; NaN where one of both has no estimate.

    craft, to: (N,), indices of who knows and of whom. rotation (N, 3, 3), position (N, 3) [m], velocity (N, 3) [m/s],
    angular_rate (N, 3) [rad/s]: state of the other in the craft's axes. covariance: (N, 12, 12), of (attitude, angular
    rate, position, velocity) there. independent, bound: (N, 12, 12), as if both errors were independent, and for any
    correlation. correlated: (N,), whether the correlation is known. position_level_m, attitude_level_rad: (N,),
    protection levels. alert: (N,), whether one of them exceeds its limit, or there is none where there is a limit.
    message_bytes: (N,), size of the other's message, 0 without one.
    """

    craft: Ints
    to: Ints
    rotation: Floats
    position: Floats
    velocity: Floats
    angular_rate: Floats
    covariance: Floats
    independent: Floats
    bound: Floats
    correlated: Bools
    position_level_m: Floats
    attitude_level_rad: Floats
    alert: Bools
    message_bytes: Ints

    @property
    def state(self) -> State:
        """The states of the others in the craft's axes."""
        return State(self.rotation, self.position, self.velocity, self.angular_rate)


class _Pair:
    """The covariance between the errors of two craft, as one of them carries it on. cross: (12, 12). known: whether
    nothing is missing in it.
    """

    def __init__(self) -> None:
        self.cross = np.zeros((STATES, STATES))
        self.known = True
        self._last: tuple[int, int] | None = None
        self._old: tuple[Floats, Floats] | None = None

    def hear(self, own: PoseMessage, other: PoseMessage) -> None:
        """Carry the covariance on by one period."""
        last, self._last = self._last, (own.period, other.period)
        # A filter that starts keeps nothing of an error: what both had in common before does not matter.
        fresh = not own.step.kept.any() or not other.step.kept.any()
        if fresh or (last is not None and self._last == (last[0] + 1, last[1] + 1)):
            self.cross = cross_covariance(self.cross, own.step, other.step)
            self._old = None if fresh or self._old is None else self._faded(self._old, own, other)
        else:
            self.cross, self._old = np.zeros((STATES, STATES)), (own.covariance, other.covariance)
        self.known = self._old is None

    @staticmethod
    def _faded(old: tuple[Floats, Floats], own: PoseMessage, other: PoseMessage) -> tuple[Floats, Floats] | None:
        """Return what is left of the covariances that both had at the last gap; None where that is forgotten."""
        first, second = (
            said.step.kept @ before @ said.step.kept.T for before, said in zip(old, (own, other), strict=True)
        )
        gone = _spread(first) < FORGOTTEN * _spread(own.covariance)
        return None if gone and _spread(second) < FORGOTTEN * _spread(other.covariance) else (first, second)


def _root(covariance: Floats, first: int) -> float:
    return float(np.sqrt(np.trace(covariance[first : first + 3, first : first + 3])))


def _spread(covariance: Floats) -> float:
    return float(np.trace(covariance[6:9, 6:9]))


class RelativeNavigation:
    """The relative navigation of N pairs among C craft: `step` once per period."""

    def __init__(self, relations: Relations, errors: SharedErrors, risk: float = 1e-7) -> None:
        """Begin with craft whose own states are unknown.

        Args:
            relations: the pairs, and their limits.
            errors: shared errors of all craft, each craft's own.
            risk: probability of an error beyond its protection level.
        """
        pairs = relations.pairs
        self._pairs = {pair: _Pair() for pair in pairs}
        self._limits = np.array(relations.limits or [(np.inf, np.inf)] * len(pairs)).reshape(-1, 2)
        self.quantile = -float(ndtri(risk / 2))
        self._errors, self._period = errors, 0
        self._craft = np.array([pair[0] for pair in pairs], dtype=np.int64)
        self._to = np.array([pair[1] for pair in pairs], dtype=np.int64)

    @property
    def wanted(self) -> bool:
        """True where there are pairs."""
        return bool(self._pairs)

    def step(self, active: Bools, state: State, covariance: Floats, levels: Floats) -> RelativePoses | None:
        """Return what every pair knows after a period; None without pairs.

        Args:
            active: (C,), craft with an estimate.
            state: estimates.
            covariance: (C, 12, 12), of the filters, without considered errors.
            levels: (2, C), protection levels of the craft alone: position [m], attitude [rad].
        """
        if not self._pairs:
            return None
        self._period = (self._period + 1) % 2**32
        speaks = sorted({craft for pair in self._pairs for craft in pair if active[craft]})
        said = {craft: encoded(self._message(craft, state, covariance, levels)) for craft in speaks}
        heard = {craft: decoded(message) for craft, message in said.items()}
        count = len(self._pairs)
        vectors, matrices = np.full((3, count, 3), np.nan), np.full((3, count, STATES, STATES), np.nan)
        rotation, known = np.full((count, 3, 3), np.nan), np.zeros(count, dtype=np.bool_)
        size = np.array([len(said.get(to, b"")) for to in self._to.tolist()], dtype=np.int64)
        found = *np.full((2, count), np.nan), np.isfinite(self._limits).any(axis=1), size
        out = RelativePoses._make((self._craft, self._to, rotation, *vectors, *matrices, known, *found))
        for n, ((a, b), pair) in enumerate(self._pairs.items()):
            if a in heard and b in heard:
                pair.hear(heard[a], heard[b])
                self._between(n, pair, heard[a], heard[b], out)
        return out

    def _message(self, craft: int, state: State, covariance: Floats, levels: Floats) -> PoseMessage:
        errors, sensitivity = self._errors, self._errors.sensitivity[craft]
        own = covariance[craft] + (sensitivity * errors.variance) @ sensitivity.T
        noise = self.quantile * np.array([_root(own, 6), _root(own, 0)])
        fault = np.maximum(levels[:, craft] - noise, 0.0)
        of = covariance[craft], errors.step.of(craft), sensitivity
        return PoseMessage(craft, self._period, state.of(craft), *of, fault)

    def _between(self, n: int, pair: _Pair, own: PoseMessage, other: PoseMessage, out: RelativePoses) -> None:
        """Write the relative state of one pair and its covariances."""
        there, variance = relative(own.state, other.state), self._errors.variance
        of_own, of_other = (
            said.covariance + (said.sensitivity * variance) @ said.sensitivity.T for said in (own, other)
        )
        common = (own.sensitivity * variance) @ other.sensitivity.T
        out.rotation[n], out.position[n], out.velocity[n], out.angular_rate[n] = there[:4]
        out.independent[n] = covariance_between(there, of_own, of_other, np.zeros((STATES, STATES)))
        out.bound[n] = covariance_bound(there, of_own, of_other)
        # How errors of a bearer tie two craft together is not in their messages.
        correlated = pair.known and self._errors.bearers is None
        if correlated:
            out.covariance[n] = covariance_between(there, of_own, of_other, pair.cross + common)
        else:
            own_part = covariance_bound(there, own.covariance, other.covariance)
            shift = there.by_a @ own.sensitivity + there.by_b @ other.sensitivity
            out.covariance[n] = own_part + (shift * variance) @ shift.T
        out.correlated[n] = correlated
        fault = own.fault + other.fault
        fault[0] += float(np.linalg.norm(there.position)) * own.fault[1]
        level = self.quantile * np.array([_root(out.covariance[n], 6), _root(out.covariance[n], 0)]) + fault
        out.position_level_m[n], out.attitude_level_rad[n] = level
        out.alert[n] = bool(np.any(level > self._limits[n]))
