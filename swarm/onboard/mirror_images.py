"""Mirror images: a second filter beside that of a craft whose light fits two poses.

Three photodiodes, or a plane, fit two poses. Where both are within reach of what a filter knows, it cannot tell which
one it follows, and its own covariance says nothing of the other. Both are then followed: the craft's own filter, and
one beside it that takes in the same sweep angles, row by row. With the innovations' likelihoods N(y; 0, S), the lead of
the own filter over its mirror image is

    lead = sum over periods of (NIS + log det S)_image - (NIS + log det S)_own

and where one leads by `DECISIVE`, as in `swarm.onboard.acquisition`, the other is given up. Until then a craft
that had a pose reports the mean and the covariance of both, weighted by 1 : exp(-lead / 2), and one that searches
reports none. Of a craft that moves, filters tell two images apart sooner than poses do: each has to move as its light
says.

Three photodiodes fit two poses, which meet at a *fold*, a critical attitude: along the direction that is known worst,
what the rows leave over is a parabola, and the fold its vertex. A filter that reaches over it is parted there: with t ~
N(0, 1) the error along that direction in sigmas and the fold at f, into its parts t < f and t > f with the mean and the
variance that a normal distribution has there, and the weights F(f) and 1 - F(f). Neither passes for the other then.

Two photodiodes leave the tilt of their line open, and what light tells of it is how a push shares in tilt and distance,
by the tangent of the tilt. A filter weighs that at its own tilt, the truth has another one. Where a filter's tilt is
coarse it is parted in its middle, f = 0, and parted anew when both halves have grown into each other.

Of two filters the mean and the covariance are those in the coordinates of `estimators.pivot`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import POSE_COLUMNS, difference_into
from estimators.lighthouse.rows import Rows
from estimators.pivot import ARMS, PIVOT, shear, shear_into, turn_about
from estimators.state import STATES, State
from swarm.messages import Command
from swarm.onboard.acquisition import DECISIVE
from swarm.onboard.single_sweeps import DETERMINED, SingleSweeps, SweepsTaken
from swarm.onboard.tracks import UNKNOWN_RATE, Filtered, Pair, Tracks

REACH = 3.0
"""Distance of a fold from a filter's estimate, in its sigmas, within which the other side of it counts."""
NEAR = 2.0
"""Likewise, within which the filter itself is only what is on its own side: beyond, that is all of it."""
LIKELIER = 4.0
"""By how much the other side of a fold leads, twice in logarithms, over an image that it takes the place of."""
AGAIN, OVERLAPPING = 1.0, 9.0
"""Likewise, within which two filters that are no farther apart than that, squared, are parted anew."""
TILT_RAD = 0.07
"""Standard deviation of the tilt of two photodiodes' line beyond which a filter is parted: the tangent of the tilt, by
which their light tells pushes of tilt and of distance apart, is another one on either side."""
GROWN = 3.0
"""Squared distance, in the covariance of both, below which two halves have grown into each other: it is 7 of the halves
of a normal distribution."""
ONE = 0.25
"""Squared distance, in the covariance of both, below which two filters are one."""


class _Fold(NamedTuple):
    """The place at which two images of one craft meet.

    at: sigmas from its estimate along `side`. side: (12,), the error of one sigma along its attitude's coarsest axis,
    or of the tilt. pivot: (PIVOT,), of `estimators.pivot`. tilt: it is only the middle of a tilt, at which none ends.
    """

    at: float
    side: Floats
    pivot: Floats
    tilt: bool = False


class MirrorImages:
    """The mirror images of C craft; `open` (C,): craft of which one is followed. hidden: (C,), those whose two poses
    are both of a search, so that none is reported until one leads.
    """

    def __init__(self, bank: FilterBank, tracks: Tracks, sweeps: SingleSweeps) -> None:
        """Begin without an image.

        Args:
            bank: filters for the images, not started.
            tracks: the craft's own filters.
            sweeps: gives rows to filters.
        """
        self._images, self._tracks, self._sweeps = tracks.beside(bank), tracks, sweeps
        self._lead = np.zeros(len(bank.active))
        self._pivot = np.zeros((len(bank.active), PIVOT))
        self.hidden: Bools = np.zeros(len(bank.active), dtype=np.bool_)

    @property
    def open(self) -> Bools:
        """The craft (C,) whose mirror image is followed."""
        return self._images.bank.active

    def forget(self, mask: Bools) -> None:
        """Forget the images of the craft of the mask (C,)."""
        self._images.forget(mask)
        self.hidden[mask] = False

    def predict(self, command: Command | None) -> None:
        """Predict the images to the next epoch."""
        self._images.predict(command)

    def start(self, pairs: Mapping[int, Pair]) -> None:
        """Start both filters of craft, by index, that a search leaves with two poses."""
        if not pairs:
            return
        own, other = self._tracks.bank, self._images.bank
        mask = np.zeros_like(self.hidden)
        for c, pair in pairs.items():
            mask[c], self._lead[c] = True, pair.lead
        mask &= ~own.active
        if not mask.any():
            return
        for i, bank in enumerate((own, other)):
            arrays = [np.zeros((len(mask), *part.shape[1:])) for part in next(iter(pairs.values()))[:4]]
            for c, pair in pairs.items():
                for array, part in zip(arrays, pair[:4], strict=True):
                    array[c] = part[i]
            rotation, position, covariance, coupling = arrays
            bank.start(mask, rotation, position, covariance, UNKNOWN_RATE, coupling)
        self.hidden |= mask

    def step(self, taken: SweepsTaken) -> None:
        """Give this period's rows to the images, decide where they tell, and look for new ones.

        taken: what the craft's own filters made of them.
        """
        own, other = self._tracks.bank, self._images.bank
        followed = other.active
        if followed.any():
            other.stop(followed & ~own.active)
            followed = other.active
        self.hidden &= followed
        if taken.batch is None or taken.before is None:
            return
        if followed.any():
            asked = followed & (taken.fresh | taken.refused)
            for c in np.flatnonzero(asked).tolist():
                self._pivot[c] = self._sweeps.centre(c, taken.batch.of(c, taken.kept))
            if asked.any():
                self._weigh(taken, asked)
            self._merge()
        self._seek(taken)
        self.hidden &= other.active

    def _weigh(self, taken: SweepsTaken, asked: Bools) -> None:
        own, other = self._tracks.bank, self._images.bank
        assert taken.batch is not None
        result = self._sweeps.give(taken.batch, taken.kept.copy(), asked, other)[0]
        asked = asked & (result.accepted | taken.fresh) & np.isfinite(result.nis)
        ahead = result.nis + result.log_determinant - taken.nis - taken.log_determinant
        self._lead[asked] += np.clip(ahead[asked], -DECISIVE, DECISIVE)
        behind = other.active & (self._lead < -LIKELIER)
        if behind.any():
            before = own.state_where(behind), own.covariance_where(behind)
            own.adopt(behind, other.state_where(behind), other.covariance_where(behind))
            other.adopt(behind, *before)
            self._lead[behind] *= -1
        other.stop(other.active & (self._lead >= DECISIVE))

    def _merge(self) -> None:
        """Make one filter of two that have come to the same."""
        own, other = self._tracks.bank, self._images.bank
        followed = other.active
        if not followed.any():
            return
        one = np.zeros_like(followed)
        state, covariance = own.state_where(followed), own.covariance_where(followed)
        for c in np.flatnonzero(followed).tolist():
            if self._apart(c) < ONE:
                one[c] = True
                self._mixed(c, state, covariance)
        own.adopt(one, state, covariance)
        other.stop(one)

    def _mixed(self, c: int, state: State, covariance: Floats) -> None:
        """Write the mean and the covariance of craft c's two filters in the place of its own."""
        other = self._images.bank
        share = 1 / (1 + np.exp(np.clip(self._lead[c], -2 * DECISIVE, 2 * DECISIVE) / 2))
        here, there, pivot = state.of(c), other.state_of(c), self._pivot[c]
        away = _away(there, here, pivot)
        mean, carried = _moved(here, share * away, pivot)
        back = _moved(there, _away(mean, there, pivot), pivot)[1]
        between, parts = np.empty((STATES, STATES)), (covariance[c], other.covariance_of(c))
        shear_into(carried, between)
        apart = np.outer(between @ away, between @ away)
        for p, arms in zip(parts, (carried, back), strict=True):
            shear(p, arms)
        covariance[c] = (1 - share) * parts[0] + share * parts[1] + share * (1 - share) * apart
        for part, found in zip(state, mean, strict=True):
            part[c] = found

    def reported(self, after: Filtered) -> Filtered:
        """Return the filters with the mean and covariance of both where a mirror image is followed, as inactive where
        both are of a search.
        """
        if not (followed := self.open).any():
            return after
        after = after._replace(covariance=after.covariance.copy())
        for c in np.flatnonzero(followed & after.active & ~self.hidden).tolist():
            self._mixed(c, after.state, after.covariance)
        if not self.hidden.any():
            return after
        for part in (*after.state, after.covariance):
            part[self.hidden] = np.nan
        return after._replace(active=after.active & ~self.hidden)

    def _seek(self, taken: SweepsTaken) -> None:
        """Part every filter that reaches over the fold between two images, or whose tilt is coarse, into one on either
        side.
        """
        own, other = self._tracks.bank, self._images.bank
        asked = taken.fresh & own.active & ~self.hidden & (taken.photodiodes >= DETERMINED - 1)
        asked &= taken.photodiodes <= DETERMINED
        if not asked.any():
            return
        asked = self._sweeps.bends(asked, own.covariance_where(asked), own.position)
        if not asked.any():
            return
        assert taken.batch is not None
        parted, near, own_mixed, close = np.zeros((4, len(asked)), dtype=np.bool_)
        first, second = ((own.state_where(asked), own.covariance_where(asked)) for _ in range(2))
        for c in np.flatnonzero(asked).tolist():
            rows = taken.batch.of(c, taken.kept)
            fold = self._fold(c, rows, *first)
            overlap = GROWN if fold is not None and fold.tilt else OVERLAPPING
            again = fold is not None and abs(fold.at) < AGAIN and other.active[c] and self._apart(c) < overlap
            if again:
                # Both reach over the fold by now, so that neither is on one side of it.
                self._mixed(c, *first)
                for part, mixed in zip((*second[0], second[1]), (*first[0], first[1]), strict=True):
                    part[c] = mixed[c]
                fold = self._fold(c, rows, *first)
                own_mixed[c] = True
                close[c] = fold is None
            if fold is None:
                continue
            lead = 2 * float(log_ndtr(abs(fold.at)) - log_ndtr(-abs(fold.at)))
            if other.active[c] and not again and (fold.tilt or lead + LIKELIER > self._lead[c]):
                continue
            parted[c], self._lead[c], self._pivot[c] = True, lead, fold.pivot
            near[c] = again or abs(fold.at) < NEAR
            over = 1.0 if fold.at >= 0 else -1.0
            for (state, covariance), side in ((first, -over), (second, over)):
                # The part of a normal distribution on one side of the fold.
                ratio = float(np.exp(-(fold.at**2) / 2 - log_ndtr(-side * fold.at)) / np.sqrt(2 * np.pi))
                mean = side * ratio
                variance = 1 + side * fold.at * ratio - ratio**2
                moved, arms = _moved(state.of(c), mean * fold.side, fold.pivot)
                for part, found in zip(state, moved, strict=True):
                    part[c] = found
                covariance[c] -= (1 - variance) * np.outer(fold.side, fold.side)
                shear(covariance[c], arms)
        own.adopt(near | own_mixed, *first)
        other.stop(close)
        other.adopt(parted, *second)

    def _apart(self, c: int) -> float:
        """Return the squared distance of craft c's two filters, in the covariance of both."""
        own, other, pivot = self._tracks.bank, self._images.bank, self._pivot[c]
        here, there, covariance = own.state_of(c), other.state_of(c), other.covariance_of(c)
        away = _away(there, here, pivot)
        shear(covariance, _moved(there, _away(here, there, pivot), pivot)[1])
        return float(away @ np.linalg.solve(own.covariance_of(c) + covariance, away))

    def _fold(self, c: int, rows: Rows, states: State, covariances: Floats) -> _Fold | None:
        """Return the fold that a filter of craft c reaches over, or its tilt's middle; None if there is none.

        Args:
            c: the craft.
            rows: its rows.
            states: by craft.
            covariances: likewise, (C, 12, 12).
        """
        state, covariance = states.of(c), covariances[c]
        pivot = self._sweeps.centre(c, rows)
        if len(rows.angle) == 2 * (DETERMINED - 1):
            along, sight = state.rotation @ pivot[3:6], state.position + state.rotation @ pivot[:3] - pivot[6:]
            axis = np.cross(along, sight)
            axis /= np.linalg.norm(axis)
            sigma = float(np.sqrt(axis @ covariance[:3, :3] @ axis))
            return _Fold(0.0, covariance[:, :3] @ axis / sigma, pivot, True) if sigma > TILT_RAD else None
        if len(rows.angle) != 2 * DETERMINED:
            return None
        variance, axes = np.linalg.eigh(covariance[:3, :3])
        side = covariance[:, :3] @ axes[:, 2] / np.sqrt(variance[2])
        here, h = self._sweeps.whitened(c, rows, state)
        ahead, behind = (self._sweeps.whitened(c, rows, _moved(state, s * side, pivot)[0])[0] for s in (1.0, -1.0))
        # What the five other coordinates of the pose cannot take up is a parabola.
        scale = np.sqrt(np.diag(covariance)[POSE_COLUMNS])
        others = np.linalg.svd((side[POSE_COLUMNS] / scale)[None])[2][1:].T
        free = np.linalg.qr(h[:, POSE_COLUMNS] * scale @ others, mode="complete")[0][:, -1]
        slope, bend = float((ahead - behind) @ free) / 2, float((ahead + behind - 2 * here) @ free)
        return _Fold(-slope / bend, side, pivot) if abs(slope) < REACH * abs(bend) else None


def _moved(state: State, x: Floats, pivot: Floats) -> tuple[State, Floats]:
    """Return a state without the craft axis, moved by the error x (12,) about the pivot (PIVOT,), and (ARMS,) of it."""
    out, arms = State._make(part.copy() for part in state), np.empty(ARMS)
    turn_about(out.rotation, out.angular_rate, out.position, out.velocity, x, pivot, arms)
    return out, arms


def _away(there: State, here: State, pivot: Floats) -> Floats:
    """Return the error (12,) by which `_moved` takes one state `here` to another one, by Newton's method."""
    x, slope = _difference(there, here), np.empty((STATES, STATES))
    for _ in range(4):
        reached, arms = _moved(here, x, pivot)
        shear_into(arms, slope)
        x += np.linalg.solve(slope, _difference(there, reached))
    return x


def _difference(one: State, other: State) -> Floats:
    """Return the error (12,) by which one state is off another, both without the craft axis."""
    out = np.empty(STATES)
    difference_into(State._make(part[None] for part in one), State._make(part[None] for part in other), 0, out)
    return out
