"""Instants of Lighthouse 1.0 sweeps in a Crazyflie's log, whose angles have only the time at which they were logged.

The firmware logs all angles of a period in one burst after its end, up to 40 ms late, and again those of a station that
did not sweep since: an angle that a photodiode, station and fan repeats to the bit is old. The receiver's raw pulses
have exact instants but no station, and not all of them are logged. They fit together: an angle a is a pulse
(a + pi/2) / (2 pi 60 Hz) after a flash, which is a pulse, too. Angles whose pulses are there tell when each station's
fans begin their sweeps, every 1/30 s to some ten microseconds; that and the time of logging give the others' instants.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from estimators.arrays import Bools, Floats, Ints
from swarm.flight.recordings.hits import Hits
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
_NEIGHBOURS, _AWAY = 15, 200.0
"""Sweeps of whose begins the median is taken, and largest distance from it [ticks]."""


class Timed(NamedTuple):
    """Hits with instants. tick_s: tick of their clock [s]. repeated: number of old angles left out. untimed: number of
    angles left out because no pulse belongs to them. exact: whether instants are those of pulses.
    """

    hits: Hits
    tick_s: float
    repeated: int
    untimed: int
    exact: bool


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
        tick = _by_rotors(kept, *_instants(kept, kept.tick * tick_s, frames))
        found = np.isfinite(tick)
        if found.any():
            hits = kept.of(found)._replace(tick=tick[found])
            order = np.argsort(hits.tick, kind="stable")
            return Timed(hits.of(order), 1 / FRAME_HZ, repeated, len(tick) - int(np.count_nonzero(found)), True)
    return Timed(kept, tick_s, repeated, 0, False)


def _by_rotors(angles: Hits, tick: Floats, logged: Floats) -> Floats:
    """Return the instants of all angles whose station and fan have enough pulses, (N,) ticks; NaN for the others.

    Args:
        angles: N angles.
        tick: instants of their pulses, NaN where not found.
        logged: times of logging on the same clock.
    """
    after = _after(angles.angle)
    out = np.full(len(tick), np.nan)
    for key in np.unique(angles.station * 2 + angles.fan):
        rows = np.flatnonzero(angles.station * 2 + angles.fan == key)
        found = rows[np.isfinite(tick[rows])]
        if len(found) < FEWEST:
            continue
        begin = np.sort(tick[found] - after[found])
        number = np.round((begin - begin[0]) / PERIOD_TICKS)
        off = begin - begin[0] - number * PERIOD_TICKS
        near = np.abs(off - median_filter(off, _NEIGHBOURS, mode="nearest")) < _AWAY
        number, off = number[near], median_filter(off[near], _NEIGHBOURS, mode="nearest")
        late = float(np.median((logged - tick)[found]))
        swept = logged[rows] - late - after[rows] - begin[0]
        # Of which period an angle is, its own pulse tells best.
        exact = tick[rows] - after[rows] - begin[0]
        swept = np.where(np.isfinite(exact), exact, swept)
        mine = np.round((swept - np.interp(swept / PERIOD_TICKS, number, off)) / PERIOD_TICKS)
        out[rows] = begin[0] + mine * PERIOD_TICKS + np.interp(mine, number, off) + after[rows]
    return out


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
