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
from estimators.filter.bank import gates
from estimators.kernel import kernel
from estimators.lighthouse.innovation import RowBatch, agreeing, condense, fault_slopes, innovations, rows_of_sweeps
from estimators.lighthouse.integrity import AngleNoise, shown_to_gate
from estimators.lighthouse.rows import Rows, Station, packed
from estimators.lighthouse.sweep import lighthouse_1
from swarm.onboard.settings import MIN_LIT, NavigationSettings
from swarm.onboard.tracks import Filtered, Tracks


class SweepsTaken(NamedTuple):
    """Result of the filters' updates with single sweeps, (C,) each.

    fresh: whether rows were accepted. refused: whether they were refused, all of them. nis: squared innovation
    normalised by its covariance, NaN without rows. rows: number of rows in the filter. photodiodes: number of
    photodiodes that they come from. dropped: number of photodiodes left out as false; -1: none agreed. fault: what a
    false one among fewer than MIN_LIT may do to position [m] and attitude [deg], (2, C); zero elsewhere. batch: all
    rows, None without any; kept: (N,), those of them that were used.
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

    @property
    def decided(self) -> Bools:
        """The craft of which rows of as many photodiodes as decide a pose were accepted, (C,)."""
        return self.fresh & (self.photodiodes >= MIN_LIT)


def _none(craft: int, batch: RowBatch | None = None) -> SweepsTaken:
    return SweepsTaken(
        fresh=np.zeros(craft, dtype=np.bool_),
        refused=np.zeros(craft, dtype=np.bool_),
        nis=np.full(craft, np.nan),
        rows=np.zeros(craft, dtype=np.int64),
        photodiodes=np.zeros(craft, dtype=np.int64),
        dropped=np.zeros(craft, dtype=np.int64),
        fault=np.zeros((2, craft)),
        batch=batch,
        kept=np.ones(0 if batch is None else len(batch.angle), dtype=np.bool_),
    )


class SingleSweeps:
    """The rows of C craft from one station with the two fans of Lighthouse 1.0."""

    def __init__(self, point_m: Floats, settings: NavigationSettings) -> None:
        """Take the photodiodes, point_m (C, K, 3) [m], at the positions that the craft assume."""
        s = settings
        fans = lighthouse_1(s.fan_x, s.fan_y)
        self._stations = packed([Station(s.station.rotation, s.station.position, fans)])
        self._point_m = point_m
        self._compensated = s.motion_compensation
        self._noise = [s.noise]
        self._gate = gates(s.gate_probability, 2 * point_m.shape[1])
        self._screens = s.integrity.residual_test
        self._missed = np.sqrt(shown_to_gate(self._gate, s.integrity.missed_detection))

    def assume(self, noise: AngleNoise) -> None:
        """Take angles to have this noise from now on."""
        self._noise = [noise]

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
            return _none(len(mask))
        instants = offset_s if self._compensated else np.zeros_like(offset_s)
        rows = rows_of_sweeps(theta, instants, np.isfinite(theta) & mask[:, None, None])
        out, predicted = _none(len(mask), rows), tracks.filtered() if self._screens else None
        kept = out.kept
        self._update(rows, kept, mask, tracks, out)
        if predicted is not None:
            self._without_false(rows, kept, predicted, tracks, out)
        _count_photodiodes(rows.first, rows.photodiode, kept, out.fresh, self._point_m.shape[1], out.photodiodes)
        if predicted is not None:
            for c in np.flatnonzero(out.fresh & (out.photodiodes < MIN_LIT)):
                own = slice(rows.first[c], rows.first[c + 1])
                used = Rows._make(part[kept[own]] for part in rows.of(int(c)))
                before = predicted.state.of(int(c)), predicted.covariance[c]
                open_s = float(tracks.since_pose_s[c]) if out.photodiodes[c] < DETERMINED else 0.0
                slopes = fault_slopes(used, self._stations, self._point_m[c], *before, self._noise, open_s)
                out.fault[:, c] = self._missed[len(used.angle)] * np.array([slopes[0], np.degrees(slopes[1])])
        return out

    def _update(self, rows: RowBatch, kept: Bools, mask: Bools, tracks: Tracks, out: SweepsTaken) -> None:
        """Give the kept rows of the craft of the mask to their filters, and write their fate."""
        bank = tracks.bank
        found = innovations(rows, kept, mask, self._stations, self._point_m, bank.state, self._noise)
        asked = mask & (found.number > 0)
        sums, angles = condense(found, asked, bank.covariance)
        result = bank.update(asked, sums.y, sums.h, np.ones_like(sums.y), sums.number, sums.pivot, angles)
        out.fresh[asked], out.refused[asked] = result.accepted[asked], ~result.accepted[asked]
        out.nis[asked], out.rows[asked] = result.nis[asked], np.where(result.accepted, angles, 0)[asked]

    def _without_false(
        self, rows: RowBatch, kept: Bools, predicted: Filtered, tracks: Tracks, out: SweepsTaken
    ) -> None:
        """Try again without false photodiodes where the gate has refused the rows."""
        again = np.zeros(len(out.fresh), dtype=np.bool_)
        for c in np.flatnonzero(out.refused):
            own, used = rows.of(int(c)), kept[rows.first[c] : rows.first[c + 1]]
            before = predicted.state.of(int(c)), predicted.covariance[c]
            keep = agreeing(own, self._stations, self._point_m[c], *before, self._noise, self._gate)
            out.dropped[c] = -1
            if keep is None:
                again[c] = self._pushed(int(c), rows, kept, tracks)
            else:
                out.dropped[c] = len(np.unique(own.photodiode[used])) - len(np.unique(own.photodiode[keep]))
                used[:] = keep
                again[c] = True
        if again.any():
            self._update(rows, kept, again, tracks, out)

    def _pushed(self, craft: int, rows: RowBatch, kept: Bools, tracks: Tracks) -> bool:
        """Return whether the rows of a craft agree with each other, and its prediction has been widened for them."""
        used = kept.copy()
        mask = np.arange(len(rows.first) - 1) == craft
        found = innovations(rows, used, mask, self._stations, self._point_m, tracks.bank.state, self._noise)
        n = found.number[craft]
        return n >= 2 * MIN_LIT and tracks.push(craft, found.y[craft, :n], found.h[craft, :n], np.eye(n))


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


DETERMINED = 3
"""Photodiodes whose rows leave nothing of a pose open."""
