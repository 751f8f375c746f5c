"""Truth of another system for a replay: each period gets the true pose at its epoch, in the frame of the estimates.

The replay is flown once for its estimates, to which the truth is aligned in time and space
(`swarm.flight.recordings.alignment`), and once more to be written. The true position is the body's: the marker's place
on the body is taken off with the estimated attitude. A trajectory with attitudes has its own body axes; the constant
turn between these and the object's is the mean over the recording, so what is left of an attitude error is its scatter.
The true velocity is the trajectory's difference over 50 ms, turned into our frame; no true angular rate is known.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.flight.recordings.alignment import FAR_M, align, interpolated, true_positions
from swarm.flight.recordings.trajectory import Trajectory
from swarm.onboard.settings import by_light
from swarm.results.period import Period
from swarm.results.records import Truth

BASELINE_S = 0.05
"""Time over which a velocity is the difference of places [s]."""


class Flown(Protocol):
    """A replay that can be flown. begin_s, marks_s: as in `GivenTruth`."""

    begin_s: float
    marks_s: Floats

    def fly(self) -> Iterator[Period]:
        """Yield its periods, the same each time."""


class NoTruth:
    """No truth."""

    notes: Sequence[str] = ()
    known = False

    def summary(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def give(self, periods: Iterable[Period]) -> Iterable[Period]:
        """Return periods as they are."""
        return periods


def truth_for(truth: Trajectory | None, flown: Flown) -> "GivenTruth | NoTruth":
    """Return a trajectory as the truth, aligned with a replay; it is flown for that. Without one there is none.

    Raises:
        SwarmError: it does not fit.
    """
    return NoTruth() if truth is None else GivenTruth(truth, flown.fly(), flown.begin_s, flown.marks_s)


class GivenTruth:
    """A trajectory, aligned with the estimates of a replay. alignment: how. notes: the same in sentences."""

    known = True

    def __init__(self, truth: Trajectory, periods: Iterable[Period], begin_s: float, marks_s: Floats) -> None:
        """Align a trajectory.

        Args:
            truth: the trajectory.
            periods: of the replay, of one object.
            begin_s: instant of `Period.time_s` zero on the recording's clock [s].
            marks_s: instants on that clock at which the trajectory begins and ends, or none.

        Raises:
            SwarmError: it does not fit.
        """
        self._truth, self._begin_s = truth, begin_s
        time_s, position, rotation = _estimates(periods, begin_s)
        self.alignment = align(time_s, position, rotation, self._truth, marks_s)
        self._turn = self._attitude_offset(time_s, position, rotation)
        self.notes = [*_lost(self._truth), *self.alignment.sentences()]
        if self._turn is not None:
            self.notes.append("the turn between the truth's body axes and the object's is the mean over the recording")

    def summary(self) -> dict[str, Any]:
        """Return the alignment for summary.json."""
        return {"truth_alignment": {"file": self._truth.path.name, **self.alignment.summary()}}

    def give(self, periods: Iterable[Period]) -> Iterator[Period]:
        """Yield periods with their truth."""
        for period in periods:
            yield period._replace(truth=self._at(period))

    def _at(self, period: Period) -> Truth:
        time_s = np.array([period.time_s + self._begin_s])
        estimate = period.estimate.rotation[:1]
        position, _ = true_positions(self.alignment, self._truth, time_s, estimate)
        clock, turn = self.alignment.clock, self.alignment.rotation
        ends = interpolated(self._truth, clock.of(time_s + BASELINE_S / 2 * np.array([-1.0, 1.0])))
        velocity = (ends[1] - ends[0]) @ turn / BASELINE_S
        nothing = np.full((1, 3), np.nan)
        return Truth(position, self._quaternion(time_s), velocity[None], nothing, np.zeros(1, dtype=np.bool_))

    def _quaternion(self, time_s: Floats) -> Floats:
        """Return true attitudes (n, 4) wxyz in the estimates' frame at instants of the recording, NaN without one."""
        out = np.full((len(time_s), 4), np.nan)
        if self._turn is None:
            return out
        rotation = self._raw(time_s)
        seen = np.isfinite(rotation).all(axis=(1, 2))
        out[seen] = rot.quaternion_from_matrix(self.alignment.rotation.T @ rotation[seen] @ self._turn)
        return out

    def _raw(self, time_s: Floats) -> Floats:
        """Return the trajectory's attitudes (n, 3, 3) in its own frame at instants of the recording, NaN in gaps."""
        known, at = self._truth.time_s, self.alignment.clock.of(time_s)
        out = np.full((len(at), 3, 3), np.nan)
        quaternion = self._truth.quaternion
        after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
        whole: Bools = np.asarray(np.isfinite(quaternion).all(axis=1))
        there = np.asarray(np.isfinite(interpolated(self._truth, at)).all(axis=1) & whole[after] & whole[after - 1])
        seen = np.flatnonzero(there)
        after = after[seen]
        first, second = (rot.matrix_from_quaternion(quaternion[i]) for i in (after - 1, after))
        share = (at[seen] - known[after - 1]) / (known[after] - known[after - 1])
        out[seen] = first @ rot.exp(share[:, None] * rot.log(np.swapaxes(first, 1, 2) @ second))
        return out

    def _attitude_offset(self, time_s: Floats, position: Floats, rotation: Floats) -> Floats | None:
        """Return R_truth's body from the object's (3, 3), None for a trajectory without attitudes."""
        places, seen = true_positions(self.alignment, self._truth, time_s, rotation)
        own = self._raw(time_s)
        with np.errstate(invalid="ignore"):
            near = seen & (np.linalg.norm(places - position, axis=1) < FAR_M)
        near &= np.isfinite(own).all(axis=(1, 2)) & np.isfinite(rotation).all(axis=(1, 2))
        if not np.any(near):
            return None
        return rot.mean_rotation(np.swapaxes(self.alignment.rotation.T @ own[near], 1, 2) @ rotation[near])


def _estimates(periods: Iterable[Period], begin_s: float) -> tuple[Floats, Floats, Floats]:
    """Return instants (n,) [s], positions (n, 3) [m] and attitudes (n, 3, 3) where the light tells them."""
    times, positions, rotations = [], [], []
    for period in periods:
        estimate = period.estimate
        if by_light(estimate.status[0]) and np.isfinite(estimate.position[0]).all():
            times.append(period.time_s + begin_s)
            positions.append(estimate.position[0].copy())
            rotations.append(estimate.rotation[0].copy())
    if not times:
        raise SwarmError("the replay has no estimate to align the truth with")
    return np.array(times), np.array(positions), np.array(rotations)


def _lost(truth: Trajectory) -> list[str]:
    """Return what of a trajectory could not be used."""
    out = [f"{truth.path}: damaged rows, left out: {truth.damaged}"] if truth.damaged else []
    return [*out, f"{truth.path}: the file is {truth.lost}: the rest of it is lost"] if truth.lost else out
