"""Instants of Lighthouse 1.0 sweeps in a Crazyflie's log, whose angles have only the time at which they were logged.

The firmware logs all angles of a period in one burst after its end, up to 40 ms late, and again those of a station that
did not sweep since: an angle that a photodiode, station and fan repeats to the bit is old. The receiver's raw pulses
have exact instants but no station, and not all of them are logged. They fit together: an angle a is a pulse
(a + pi/2) / (2 pi 60 Hz) after a flash, which is a pulse, too. Angles whose pulses are there tell when each station's
fans begin their sweeps, every 1/30 s to some ten microseconds; that and the time of logging give the others' instants.

The firmware logs no angles of a period in which it has lost a flash, a third of the time where the craft is carried,
but its pulses are there: those within the sweep of a station's fan, whose begin is known, are angles as well, from the
mean of the pulses that are that flash.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from estimators.arrays import Bools, Floats, Ints
from swarm.flight.recordings.hits import Hits, joined
from swarm.flight.recordings.rotor_light import FRAME_HZ, FrameLog

RATE_HZ = 60.0
"""Rate of the rotors of Lighthouse 1.0 [Hz]."""
LATE_S, EARLY_S = 0.06, 0.004
"""Times after and before a pulse within which its angle is logged [s]."""
TICKS = 12
"""Largest difference between an angle and its pulses [ticks of 24 MHz]: the firmware measures from a mean flash."""
FEWEST = 50
"""Angles of a station and fan whose pulses must be found; with fewer, the times of logging are taken."""
PERIOD_TICKS = FRAME_HZ / 30.0
"""A fan's period, where two stations take turns [ticks of 24 MHz]."""
WIDEST_RAD = np.radians(75.0)
"""Angle from boresight up to which a pulse is a sweep's; beyond it are the flashes."""
FLASH_TICKS = 150
"""Distance from a sweep's predicted begin within which pulses are its flash [ticks]."""
_AHEAD = FRAME_HZ / RATE_HZ / 4
"""Time from a sweep's begin to boresight [ticks of 24 MHz]."""
_NEIGHBOURS, _AWAY = 15, 200.0
"""Sweeps of whose begins the median is taken, and largest distance from it [ticks]."""


class Timed(NamedTuple):
    """Hits with instants. tick_s: tick of their clock [s]. repeated: number of old angles left out. untimed: number of
    angles left out because no pulse belongs to them. exact: whether instants are those of pulses. added: number of
    angles that only pulses tell.
    """

    hits: Hits
    tick_s: float
    repeated: int
    untimed: int
    exact: bool
    added: int = 0


class _Rotor(NamedTuple):
    """One fan's sweeps, as far as they are known: sweep number[i] begins off[i] after first + number[i] periods
    [ticks].
    """

    first: float
    number: Floats
    off: Floats

    def begin(self, number: Floats) -> Floats:
        """Return the ticks at which sweeps begin."""
        out: Floats = self.first + number * PERIOD_TICKS + np.interp(number, self.number, self.off)
        return out

    def of(self, tick: Floats, after: Floats | float) -> Floats:
        """Return the number of the sweep that begins nearest to `after` before each tick."""
        since = tick - after - self.first
        out: Floats = np.round((since - np.interp(since / PERIOD_TICKS, self.number, self.off)) / PERIOD_TICKS)
        return out


def timed(angles: Hits, tick_s: float, frames: FrameLog) -> Timed:
    """Return the fresh angles of Lighthouse 1.0 with the instants of their pulses, where there are pulses.

    Args:
        angles: as logged; their ticks are the times of logging.
        tick_s: tick of these times [s].
        frames: the receiver's pulses.
    """
    fresh = _fresh(angles)
    repeated = len(fresh) - int(np.count_nonzero(fresh))
    kept = angles.of(fresh)
    if len(frames.tick) and len(kept.tick):
        pulse, logged = _instants(kept, kept.tick * tick_s, frames)
        rotors = _rotors(kept, pulse)
        tick = _by_rotors(kept, pulse, logged, rotors)
        found = np.isfinite(tick)
        if found.any():
            hits = kept.of(found)._replace(tick=tick[found])
            more = [_of_pulses(key, rotor, hits, frames) for key, rotor in rotors.items()]
            untimed, added = len(tick) - len(hits.tick), sum(len(part.tick) for part in more)
            return Timed(joined([hits, *more]), 1 / FRAME_HZ, repeated, untimed, True, added)
    return Timed(kept, tick_s, repeated, 0, False)


def _rotors(angles: Hits, tick: Floats) -> dict[int, _Rotor]:
    """Return the sweeps of each fan, 2 station + fan, that has enough pulses.

    Args:
        angles: N angles.
        tick: (N,), instants of their pulses, NaN where not found.
    """
    key, after, out = angles.station * 2 + angles.fan, _after(angles.angle), {}
    for k in np.unique(key).tolist():
        found = np.flatnonzero((key == k) & np.isfinite(tick))
        if len(found) < FEWEST:
            continue
        begin = np.sort(tick[found] - after[found])
        number = np.round((begin - begin[0]) / PERIOD_TICKS)
        off = begin - begin[0] - number * PERIOD_TICKS
        near = np.abs(off - median_filter(off, _NEIGHBOURS, mode="nearest")) < _AWAY
        out[k] = _Rotor(float(begin[0]), number[near], median_filter(off[near], _NEIGHBOURS, mode="nearest"))
    return out


def _by_rotors(angles: Hits, tick: Floats, logged: Floats, rotors: Mapping[int, _Rotor]) -> Floats:
    """Return the instants of all angles of fans whose sweeps are known, (N,) ticks; NaN for the others.

    Args:
        angles: N angles.
        tick: instants of their pulses, NaN where not found.
        logged: times of logging on the same clock.
        rotors: sweeps of the fans.
    """
    after = _after(angles.angle)
    out = np.full(len(tick), np.nan)
    for key, rotor in rotors.items():
        rows = np.flatnonzero(angles.station * 2 + angles.fan == key)
        late = float(np.nanmedian((logged - tick)[rows]))
        # Of which period an angle is, its own pulse tells best.
        swept = np.where(np.isfinite(tick[rows]), tick[rows], logged[rows] - late)
        out[rows] = rotor.begin(rotor.of(swept, after[rows])) + after[rows]
    return out


def _of_pulses(key: int, rotor: _Rotor, known: Hits, frames: FrameLog) -> Hits:
    """Return the angles of one fan that no angle was logged of, from the pulses.

    Args:
        key: 2 station + fan.
        rotor: its sweeps.
        known: angles with their instants, of all fans.
        frames: the receiver's pulses.
    """
    tick, photodiode = frames.tick, frames.photodiode
    number = rotor.of(tick, _AHEAD)
    swept = np.abs(tick - rotor.begin(number) - _AHEAD) < WIDEST_RAD / np.pi * 2 * _AHEAD
    swept &= (number >= rotor.number[0]) & (number <= rotor.number[-1])
    tick, photodiode, number = tick[swept], photodiode[swept], number[swept]
    begin, flash, pulses = (
        rotor.begin(number),
        np.sort(frames.tick),
        np.concatenate([[0.0], np.cumsum(np.sort(frames.tick))]),
    )
    first, end = (np.searchsorted(flash, begin + side) for side in (-FLASH_TICKS, FLASH_TICKS))
    seen = end > first
    late = (pulses[end] - pulses[first])[seen] / (end - first)[seen] - begin[seen]
    # The firmware's zero is where its angles have it, a constant from the mean flash.
    begin[seen] += late - (float(np.median(late)) if len(late) else 0.0)
    own = known.of(known.station * 2 + known.fan == key)
    told = rotor.of(own.tick, _after(own.angle)) * 64 + own.photodiode
    new = ~np.isin(number * 64 + photodiode, told)
    angle = (tick - begin)[new] / (2 * _AHEAD) * np.pi - np.pi / 2
    count = np.zeros(int(new.sum()), dtype=np.int64)
    return Hits(count + key // 2, count + key % 2, photodiode[new], tick[new], angle)


def _after(angle: Floats) -> Floats:
    """Return the time from a fan's begin to an angle [ticks of 24 MHz]."""
    out: Floats = (angle + np.pi / 2) / (2 * np.pi * RATE_HZ) * FRAME_HZ
    return out


def _fresh(angles: Hits) -> Bools:
    """Return which angles differ from the one before of the same station, fan and photodiode, (N,)."""
    out = np.ones(len(angles.tick), dtype=np.bool_)
    key = (angles.station * 2 + angles.fan) * (1 + int(angles.photodiode.max(initial=0))) + angles.photodiode
    for k in np.unique(key):
        own = np.flatnonzero(key == k)
        out[own[1:]] = angles.angle[own][1:] != angles.angle[own][:-1]
    return out


def _instants(angles: Hits, time_s: Floats, frames: FrameLog) -> tuple[Floats, Floats]:
    """Return the tick of each angle's pulse (N,), NaN where none is found, and that of its logging."""
    line = np.polynomial.Polynomial.fit(frames.time_s, frames.tick, 1)
    late = np.interp(time_s, frames.time_s, frames.tick - line(frames.time_s))
    logged = line(time_s) + late
    after = _after(angles.angle)
    every = np.sort(frames.tick)
    out = np.full(len(logged), np.nan)
    for k in np.unique(angles.photodiode):
        own = np.sort(frames.tick[frames.photodiode == k])
        rows: Ints = np.flatnonzero(angles.photodiode == k)
        last = np.searchsorted(own, logged[rows] + EARLY_S * FRAME_HZ) - 1
        step = 0
        while True:
            at = last - step
            near = at >= 0
            tick = own[np.maximum(at, 0)]
            near &= tick > logged[rows] - LATE_S * FRAME_HZ
            if not near.any():
                break
            flash = tick - after[rows]
            place = np.clip(np.searchsorted(every, flash), 1, len(every) - 1)
            away = np.minimum(np.abs(every[place] - flash), np.abs(every[place - 1] - flash))
            take = near & (away <= TICKS) & np.isnan(out[rows])
            out[rows[take]] = tick[take]
            step += 1
    return out, logged
