"""Navigation by single sweeps: the sweep angles themselves go into the filter, one row each, without a pose.

One angle is one measurement (docs/single-sweeps.md). Which craft use rows is the setting `coupling`:

    auto    those that have no pose in this period: one to three photodiodes lit, or a pose that failed
    loose   none: a craft without a pose coasts
    tight   all that have a filter; a pose is solved only to start one, or to find one again

The rows of a period are tested together by the filter's gate. If they fail, they are searched for false photodiodes
without which the others agree with the prediction; without a subset that agrees, a push is tried, by which they all
agree with each other at other rates (`Tracks.push`); else none is used.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, UpdateResult, gates
from estimators.kernel import kernel
from estimators.lighthouse.curvature import to_second_order
from estimators.lighthouse.innovation import Innovations, RowBatch, innovations, noise_of, rows_of_sweeps
from estimators.lighthouse.integrity import AngleNoise, shown_to_gate
from estimators.lighthouse.planar import bends as is_coarse
from estimators.lighthouse.row_faults import row_faults
from estimators.lighthouse.row_screen import agreeing
from estimators.lighthouse.row_sums import CONDENSED, condense, pose_sums
from estimators.lighthouse.rows import Rows, Station, linearise
from estimators.lighthouse.sweep import lighthouse_1
from estimators.pivot import PIVOT
from estimators.state import State
from swarm.onboard.known_stations import KnownStations
from swarm.onboard.settings import MIN_LIT, NavigationSettings
from swarm.onboard.tracks import Filtered, Tracks


class SweepsTaken(NamedTuple):
    """Result of the filters' updates with single sweeps, (C,) each.

    fresh: whether rows were accepted. refused: whether they were refused, all of them. nis: squared innovation
    normalised by its covariance, NaN without rows. rows: number of rows in the filter. photodiodes: number of
    photodiodes that they come from. dropped: number of photodiodes left out as false; -1: none agreed. fault: what a
    false one among fewer than MIN_LIT may do to position [m] and attitude [deg], (2, C); zero elsewhere. batch: all
    rows, None without any; kept: (N,), those of them that were used. log_determinant: of the innovations' covariance,
    NaN without rows. before: the predictions of the filters with rows; None without any.
    """

    fresh: Bools
    refused: Bools
    nis: Floats
    rows: Ints
    photodiodes: Ints
    dropped: Ints
    fault: Floats
    batch: RowBatch | None
    kept: Bools
    log_determinant: Floats
    before: Filtered | None = None

    @property
    def decided(self) -> Bools:
        """The craft of which rows of as many photodiodes as decide a pose were accepted, (C,)."""
        return self.fresh & (self.photodiodes >= MIN_LIT)


def _taken(
    result: UpdateResult, rows: Ints, batch: RowBatch | None, kept: Bools, before: Filtered | None = None
) -> SweepsTaken:
    """Return the fate of rows, (C,) of each craft, before it is known which photodiodes they come from."""
    photodiodes, dropped = np.zeros((2, *rows.shape), dtype=np.int64)
    return SweepsTaken(
        fresh=result.accepted,
        refused=np.isfinite(result.nis) & ~result.accepted,
        nis=result.nis,
        rows=rows * result.accepted,
        photodiodes=photodiodes,
        dropped=dropped,
        fault=np.zeros((2, *rows.shape)),
        batch=batch,
        kept=kept,
        log_determinant=result.log_determinant,
        before=before,
    )


class SingleSweeps:
    """The rows of C craft from one station with the two fans of Lighthouse 1.0."""

    def __init__(self, point_m: Floats, settings: NavigationSettings) -> None:
        """Take the photodiodes, point_m (C, K, 3) [m], at the positions that the craft assume."""
        s = settings
        fans = lighthouse_1(s.fan_x, s.fan_y)
        self._known = KnownStations([Station(s.station.rotation, s.station.position, fans)], [s.noise])
        self._point_m = point_m
        self._size_m = np.linalg.norm(np.nan_to_num(point_m), axis=2).max(axis=1, initial=0.0)
        self._compensated = s.motion_compensation
        self._gate = gates(s.gate_probability, 2 * point_m.shape[1])
        self._screens = s.integrity.residual_test
        self._missed = np.sqrt(shown_to_gate(self._gate, s.integrity.missed_detection))
        craft = len(point_m)
        none = UpdateResult(np.zeros(craft, dtype=np.bool_), np.full(craft, np.nan), np.full(craft, np.nan))
        self._nothing = _taken(none, np.zeros(craft, dtype=np.int64), None, np.ones(0, dtype=np.bool_))
        for part in (*self._nothing[:7], self._nothing.log_determinant):
            part.flags.writeable = False  # it is that of many periods

    def assume(self, noise: AngleNoise) -> None:
        """Take angles to have this noise from now on."""
        self._known.assume([noise])

    def take_in(self, theta: Floats, offset_s: Floats, mask: Bools, tracks: Tracks) -> SweepsTaken:
        """Update the filters of the craft of the mask with their rows.

        Args:
            theta: (C, K, 2) [rad], measured sweep angles, less the rotor's speed; NaN where not seen.
            offset_s: (C, K, 2) [s], instants of the angles minus the epoch.
            mask: (C,), the craft concerned; those without a filter are left out.
            tracks: filters, predicted to the epoch.
        """
        mask = mask & tracks.bank.active
        if not mask.any():
            return self._nothing
        instants = offset_s if self._compensated else np.zeros_like(offset_s)
        rows = rows_of_sweeps(theta, instants, mask)
        predicted = tracks.filtered_where(mask)
        kept: Bools = np.ones(len(rows.angle), dtype=np.bool_)
        out = _taken(*self.give(rows, kept, mask, tracks.bank, predicted), rows, kept, predicted)
        if self._screens:
            self._without_false(rows, kept, predicted, tracks, out)
        _count_photodiodes(rows.first, rows.photodiode, kept, out.fresh, self._point_m.shape[1], out.photodiodes)
        if self._screens:
            self._faults(rows, kept, predicted, tracks, out)
        return out

    def give(
        self, rows: RowBatch, kept: Bools, mask: Bools, bank: FilterBank, before: Filtered | None = None
    ) -> tuple[UpdateResult, Ints]:
        """Give the kept rows of the craft of the mask to filters; return their fate and the numbers of rows, (C,).

        Args:
            rows: of all craft.
            kept: (N,), those that are used; becomes False where a row cannot be.
            mask: (C,), the craft concerned.
            bank: their filters.
            before: the filters as they are, if that is known.
        """
        if before is None:
            before = Filtered(bank.active, bank.state_where(mask), bank.covariance_where(mask))
        state, covariance, light = before.state, before.covariance, self._known.light
        bends = self.bends(mask, covariance, state.position)
        first, few = None, mask
        if rows.most > CONDENSED:
            many = pose_sums(rows, kept, mask & ~bends, light, self._point_m, state, covariance)
            if many.told.any():
                result = bank.update(many.told, many.y, many.h, many.r, freedoms=many.rows, square=many.square)
                result.log_determinant[many.told] += many.log_determinant[many.told]
                first, few = (result, np.where(many.told, many.rows, 0)), mask & ~many.told
                if not few.any():
                    return first
        found = innovations(rows, kept, few, light, self._point_m, state)
        asked = few & (found.number > 0)
        bent = asked & bends
        if bent.any():

            def there(state: State, mask: Bools) -> Innovations:
                return innovations(rows, kept.copy(), mask, light, self._point_m, state)

            to_second_order(found, bent, state, covariance, there)
        sums, counted = condense(found, asked, covariance)
        other = bank.update(asked, sums.y, sums.h, np.ones_like(sums.y), sums.number, sums.pivot, counted)
        if first is None:
            return other, counted
        both = (np.where(asked, new, old) for new, old in zip((*other, counted), (*first[0], first[1]), strict=True))
        accepted, nis, log_determinant, angles = both
        return UpdateResult(accepted, nis, log_determinant), angles

    def centre(self, craft: int, rows: Rows) -> Floats:
        """Return the pivot (PIVOT,) of `estimators.pivot` in the centre of the photodiodes of one craft's rows, with
        the line between them where they are two.
        """
        out, lit = np.zeros(PIVOT), np.unique(rows.photodiode)
        out[:3] = self._point_m[craft, rows.photodiode].mean(axis=0)
        if len(lit) == 2:
            out[3:6] = self._point_m[craft, lit[1]] - self._point_m[craft, lit[0]]
            out[6:] = self._known.packed.position[rows.station[0]]
        return out

    def whitened(self, craft: int, rows: Rows, state: State) -> tuple[Floats, Floats]:
        """Return the innovations (n,) of rows of one craft at a state, and their derivatives (n, 12), with independent
        noise of variance one; NaN where a photodiode is not in front of the station.

        Args:
            craft: its index.
            rows: n of its rows.
            state: without the craft axis.
        """
        y, h = linearise(rows, self._known.packed, self._point_m[craft], *_in_order(state))
        root = np.linalg.inv(np.linalg.cholesky(noise_of(rows, self._known.noise)))
        return root @ y, root @ h

    def bends(self, mask: Bools, covariance: Floats, position: Floats) -> Bools:
        """Return the craft (C,) of the mask whose attitude is so coarse that angles are no longer linear about the
        prediction.

        Args:
            mask: (C,), the craft concerned.
            covariance: (C, 12, 12) of their predictions.
            position: (C, 3) [m], predicted.
        """
        out = np.empty_like(mask)
        known = self._known
        _bends_into(mask, covariance, position, known.packed.position[0], self._size_m, known.noise[0], out)
        return out

    def _faults(self, rows: RowBatch, kept: Bools, before: Filtered, tracks: Tracks, out: SweepsTaken) -> None:
        """Write what a false one of fewer than MIN_LIT photodiodes may do to their craft."""
        few = out.fresh & (out.photodiodes < MIN_LIT)
        if not few.any():
            return
        open_s = np.where(out.photodiodes < DETERMINED, tracks.since_pose_s, 0.0)
        found = innovations(rows, kept, few, self._known.light, self._point_m, before.state)
        position, attitude = row_faults(rows, kept, few, found, self._known.light, before.covariance, open_s)
        who = np.flatnonzero(few)
        missed = self._missed[out.rows[who]]
        out.fault[0, who], out.fault[1, who] = missed * position[who], missed * np.degrees(attitude[who])

    def _without_false(
        self, rows: RowBatch, kept: Bools, predicted: Filtered, tracks: Tracks, out: SweepsTaken
    ) -> None:
        """Try again without false photodiodes where the gate has refused the rows."""
        refused = np.flatnonzero(out.refused)
        if not len(refused):
            return
        known, again = self._known, np.zeros(len(out.fresh), dtype=np.bool_)
        for c in refused:
            own, used = rows.of(int(c)), kept[rows.first[c] : rows.first[c + 1]]
            before = predicted.state.of(int(c)), predicted.covariance[c]
            keep = agreeing(own, known.packed, self._point_m[c], *before, known.noise, self._gate)
            out.dropped[c] = -1
            if keep is None:
                again[c] = self._pushed(int(c), rows, kept, tracks)
            else:
                out.dropped[c] = len(np.unique(own.photodiode[used])) - len(np.unique(own.photodiode[keep]))
                used[:] = keep
                again[c] = True
        if again.any():
            now = _taken(*self.give(rows, kept, again, tracks.bank), rows, kept)
            asked = now.fresh | now.refused
            for fate, found in zip(_fates(out), _fates(now), strict=True):
                fate[asked] = found[asked]

    def _pushed(self, craft: int, rows: RowBatch, kept: Bools, tracks: Tracks) -> bool:
        """Return whether the rows of a craft agree with each other, and its prediction has been widened for them."""
        used = kept.copy()
        mask = np.arange(len(rows.first) - 1) == craft
        found = innovations(rows, used, mask, self._known.light, self._point_m, tracks.bank.state)
        n = found.number[craft]
        return n >= 2 * MIN_LIT and tracks.push(craft, found.y[craft, :n], found.h[craft, :n], np.eye(n))


def _fates(taken: SweepsTaken) -> tuple[Bools, Bools, Floats, Ints, Floats]:
    """Return what an update with rows has come to, (C,) each."""
    return taken.fresh, taken.refused, taken.nis, taken.rows, taken.log_determinant


def _in_order(state: State) -> tuple[Floats, Floats, Floats, Floats]:
    return state.rotation, state.position, state.velocity, state.angular_rate


@kernel
def _count_photodiodes(first: Ints, photodiode: Ints, kept: Bools, mask: Bools, photodiodes: int, out: Ints) -> None:
    """Write the number of photodiodes that the kept rows of the craft of the mask come from."""
    seen = np.empty(photodiodes, np.bool_)
    for c in range(len(mask)):
        if mask[c]:
            seen[:] = False
            out[c] = 0
            for r in range(first[c], first[c + 1]):
                if kept[r] and not seen[photodiode[r]]:
                    seen[photodiode[r]] = True
                    out[c] += 1


@kernel
def _bends_into(
    mask: Bools, covariance: Floats, position: Floats, station: Floats, size: Floats, noise: AngleNoise, out: Bools
) -> None:
    """Write where the attitude is too coarse, as in `SingleSweeps.bends`.

    Args:
        mask: (C,).
        covariance: (C, 12, 12).
        position: (C, 3) [m].
        station: (3,) [m], its place.
        size: (C,) [m], largest distance of a photodiode from its body's origin.
        noise: of the angles.
        out: (C,), receives it.
    """
    for c in range(len(mask)):
        out[c] = mask[c]
        if mask[c]:
            x, y, z = position[c, 0] - station[0], position[c, 1] - station[1], position[c, 2] - station[2]
            sigma = np.sqrt(covariance[c, 0, 0] + covariance[c, 1, 1] + covariance[c, 2, 2])
            out[c] = is_coarse(sigma, size[c], np.sqrt(x * x + y * y + z * z), noise)


DETERMINED = 3
"""Photodiodes whose rows leave nothing of a pose open."""
