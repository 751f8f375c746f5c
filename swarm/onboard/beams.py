"""Sweep angles from hits of Lighthouse 2.0 stations: the circuits of C craft side by side.

A hit whose bits were caught tells channel and offset from the rotor's zero, in ticks of the craft's own clock. A hit
that is too short for a word of bits is the same sweep's as those around it if all within `NEAR_S` are of one sweep,
none of them its own photodiode's, and it is no farther from them than they are from each other: then its offset follows
from the time between them. Otherwise it is rejected, as is a hit with a word that no other word of its sweep confirms.
Amid many stations it may yet be another one's, of which no hit was long enough: it is rejected where the craft expects
the photodiode elsewhere, and, if the craft expects nothing, where enough photodiodes have hits with bits.
With the duration T of a turn, offset / T is the rotor's angle, and (2) of `estimators.lighthouse.rotor` the plane and
its angle from boresight. Within 30 degrees of half a turn it may be either plane's: where the craft expects the
photodiode tells, or, if it expects nothing, the photodiode's other hit of that turn, or the hit is rejected. The first
of two hits is the first plane's up to an elevation of 56 degrees, where the planes cross; beyond, it is the second's.

The instants need no flash: the epoch is the middle of the computer's own period.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import gathered
from estimators.lighthouse.rotor import Located, angle_of, planes
from estimators.lighthouse.rows import Rows
from swarm.messages import BeamHits
from swarm.onboard.settings import MIN_LIT
from swarm.onboard.stations import RowLight

NEAR_S = 0.4e-3
"""Largest time between a hit without bits and one of its sweep [s]: a sweep over a craft of 40 cm takes as long, 3 m
away."""
WORD_S = 17 / 6e6
"""Duration of a word of bits [s]."""
EITHER = 1 / 12
"""Distance of a hit from half a turn within which a point in front of the station may meet either plane [turns]."""
EXPECTED_RAD = 0.1
"""Largest distance from where a craft expects a photodiode, by which it tells the plane of a hit [rad]."""
AWAY_SIGMAS = 5.0
"""Standard deviations from where a craft expects a photodiode, beyond which a hit without bits is another sweep's."""
SAME_S = 50e-6
"""Largest difference between zeros of one turn [s]; other turns are 18 ms away, other channels as a rule far more."""


class Expected(Protocol):
    """Expectations that craft have of the light, as `swarm.onboard.stations.StationNavigator` knows it."""

    def expected_angles(self, craft: Ints, station: Ints, photodiode: Ints, offset_s: Floats) -> Floats:
        """Return the angles of both planes (N, 2) [rad] at which hits are expected, NaN where none are.

        Args:
            craft: (N,).
            station: (N,).
            photodiode: (N,).
            offset_s: instants after the epoch, (N,) [s].
        """

    def sigmas_away(self, craft: Ints, rows: Rows) -> Floats:
        """Return by how many standard deviations rows are off where craft (N,) expect them, (N,); NaN where nowhere."""


class BeamDecoder:
    """The circuits of C craft before S stations: `decode` takes each one's hits of one period."""

    def __init__(self, present: Bools, tick_s: float, channels: Sequence[int], turn_s: Sequence[float]) -> None:
        """Take what the craft know of the stations.

        Args:
            present: photodiodes of each craft, (C, K).
            tick_s: tick of the craft's clocks [s].
            channels: channel of each station, from 1.
            turn_s: duration of a turn of each station's rotor [s].
        """
        self._present, self._tick_s = np.ascontiguousarray(present, dtype=np.bool_), tick_s
        self._turn_tick = np.array(turn_s) / tick_s
        self._station = np.full(max(channels) + 1, -1, dtype=np.int64)
        self._station[list(channels)] = np.arange(len(channels))

    def forget(self, mask: Bools) -> None:
        """Forget the craft of the mask (C,): the circuits keep nothing from one period to the next."""

    def decode(self, hits: BeamHits, expected: Expected | None = None) -> RowLight:
        """Return the rows of every craft in one period.

        Args:
            hits: hits of every craft.
            expected: what the craft expect of the light; None: nothing.

        Raises:
            ValueError: the hits are of another number of craft.
        """
        craft, most = self._present.shape
        if len(hits.total) != craft:
            raise ValueError(f"hits of {len(hits.total)} craft, but the decoder has {craft}")
        middle = hits.rise_tick + 0.5 * hits.width_tick
        station, offset = np.full(middle.shape, -1, dtype=np.int64), np.full(middle.shape, np.nan)
        _resolve(
            hits,
            middle,
            self._station,
            self._present,
            (NEAR_S / self._tick_s, SAME_S / self._tick_s, WORD_S / self._tick_s),
            station,
            offset,
        )
        of, at = np.nonzero(station >= 0)
        found, photodiode = station[of, at], hits.photodiode[of, at].astype(np.int64)
        after = offset[of, at]
        share = after / self._turn_tick[found]
        offset_s: Floats = np.asarray((middle[of, at] - hits.epoch_tick[of]) * self._tick_s, dtype=np.float64)
        plane = np.where(np.abs(share - 0.5) < EITHER, -1, (share > 0.5).astype(np.int64))
        turn = _turns(of, found, middle[of, at] - after, self._turn_tick)
        if expected is not None:
            _expected(plane, share, expected, (of, found, photodiode, offset_s))
        if np.any(plane < 0):
            # Of craft that expect nothing there, by all their hits.
            own = np.flatnonzero(np.isin(of, of[plane < 0]))
            who = (of[own] * len(self._turn_tick) + found[own]) * most + photodiode[own]
            paired = planes(Located(turn[own], share[own]), who, EITHER).plane
            plane[own] = np.where(plane[own] < 0, paired, plane[own])
        good = plane >= 0
        rows = Rows(found, plane, photodiode, turn, offset_s, angle_of(share, plane))
        bare = np.flatnonzero(good & (hits.channel[of, at] == 0))
        if expected is not None and len(bare):
            good[bare[_misplaced(of, rows, bare, expected, self._present.shape)]] = False
        used = np.bincount(of[good], minlength=craft)
        chosen = Rows._make(part[good] for part in rows)
        return RowLight(gathered(of[good], chosen, craft), hits.total - used, np.zeros(craft, dtype=np.int64))


def _misplaced(of: Ints, rows: Rows, bare: Ints, expected: Expected, shape: tuple[int, int]) -> Bools:
    """Return which hits without bits are not where their craft expect them, or not needed where these expect nothing.

    Args:
        of: craft of every hit, (N,).
        rows: the hits as rows.
        bare: (B,), indices of the hits without bits.
        expected: what the craft expect.
        shape: numbers of craft and of photodiodes.
    """
    away = expected.sigmas_away(of[bare], Rows._make(part[bare] for part in rows))
    told = np.ones(len(of), dtype=np.bool_)
    told[bare] = False
    seen = np.zeros(shape, dtype=np.bool_)
    seen[of[told], rows.photodiode[told]] = True
    enough = seen.sum(axis=1) >= MIN_LIT
    out: Bools = np.where(np.isfinite(away), away > AWAY_SIGMAS, enough[of[bare]])
    return out


def _expected(plane: Ints, share: Floats, expected: Expected, hits: Sequence[Any]) -> None:
    """Write the planes of those hits whose plane is open, -1, and that craft expect at one of the planes' angles.

    Args:
        plane: (N,), updated.
        share: (N,) [turns].
        expected: what the craft expect.
        hits: craft, station, photodiode and instant of all hits, as it takes them.
    """
    open_ = np.flatnonzero(plane < 0)
    if not len(open_):
        return
    both = np.stack([angle_of(share[open_], np.full(len(open_), which)) for which in (0, 1)], axis=1)
    asked: list[Any] = [part[open_] for part in hits]
    away = np.abs(both - expected.expected_angles(asked[0], asked[1], asked[2], asked[3]))
    away = np.where(np.isfinite(away), away, np.inf)
    best = np.argmin(away, axis=1)
    sure = away[np.arange(len(open_)), best] < EXPECTED_RAD
    plane[open_[sure]] = best[sure]


@kernel
def _resolve(
    hits: BeamHits,
    middle: Floats,
    station_of: Ints,
    present: Bools,
    limits: tuple[float, float, float],
    station: Ints,
    offset: Floats,
) -> None:
    """Write station (C, P), -1 where not known, and offset (C, P) [ticks] of every hit.

    station_of: station of each channel, -1 for none. limits: NEAR_S, SAME_S and WORD_S in ticks.
    """
    near, same, word = limits
    for c in range(len(hits.total)):
        count = hits.total[c]
        for i in range(count):
            k, channel = hits.photodiode[c, i], hits.channel[c, i]
            if k < 0 or k >= present.shape[1] or not present[c, k]:
                continue
            if channel > 0:
                if channel < len(station_of):
                    station[c, i], offset[c, i] = station_of[channel], float(hits.offset_tick[c, i])
                continue
            if hits.width_tick[c, i] > word + 1:
                continue
            # A sweep meets a photodiode once: beside a hit of its own with bits, this one is of another sweep.
            found, zero, nearest, one = -1, 0.0, np.inf, True
            begin, end = np.inf, -np.inf
            for step in (-1, 1):
                j = i + step
                while 0 <= j < count and abs(middle[c, j] - middle[c, i]) <= near:
                    other = hits.channel[c, j]
                    if other > 0:
                        one = one and hits.photodiode[c, j] != k
                        began = middle[c, j] - hits.offset_tick[c, j]
                        if found >= 0 and (other != found or abs(began - zero) > same):
                            one = False
                        if abs(middle[c, j] - middle[c, i]) < nearest:
                            nearest, zero = abs(middle[c, j] - middle[c, i]), began
                        found, begin, end = other, min(begin, middle[c, j]), max(end, middle[c, j])
                    j += step
            one = one and 2 * begin - end <= middle[c, i] <= 2 * end - begin
            if one and 0 < found < len(station_of):
                station[c, i], offset[c, i] = station_of[found], middle[c, i] - zero


@kernel
def _turns(craft: Ints, station: Ints, zero: Floats, turn_tick: Floats) -> Ints:
    """Return the number of every hit's turn, (N,), from that of the first hit of its craft and station.

    craft: (N,), in order. zero: zero of the hit's turn, (N,) [ticks].
    """
    out = np.zeros(len(craft), np.int64)
    first = np.full(len(turn_tick), np.nan)
    for i in range(len(craft)):
        if i == 0 or craft[i] != craft[i - 1]:
            first[:] = np.nan
        s = station[i]
        if np.isnan(first[s]):
            first[s] = zero[i]
        out[i] = int(np.rint((zero[i] - first[s]) / turn_tick[s]))
    return out
