"""Kernels of the pulses that a craft's circuits log in a period: flashes, sweeps and stray light in order of rise.

The place of a pulse in the log is the number of pulses before it: of a sweep it is counted by comparing the craft's
other sweeps with it, of WIDE craft side by side; the pulses of a flash rise together.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import WIDE, alike, all_of, select, wide_in
from swarm.messages import Pulses

_ROUNDER = 1.5 * 2.0**52
"""Its sum with a number below 2^51 is a whole number."""


class PulseRoom(NamedTuple):
    """Room for the sweeps of WIDE craft side by side, (2, K, WIDE) by fan and photodiode.

    rise, ticks: rise and width [ticks]. key: orders a craft's sweeps by rise, and those of equal rise by photodiode
    and fan; inf where there is none. place: number of pulses before each. flash: of both flashes, a key just below
    those of sweeps that rise with it, the number of photodiodes that see it, and of pulses before it, (3, 2, WIDE).
    start: of the period, and the same in whole ticks, (2, WIDE).
    """

    rise: Floats
    ticks: Floats
    key: Floats
    place: Floats
    flash: Floats
    start: Floats


def pulse_room(photodiodes: int) -> PulseRoom:
    """Return room for the sweeps of WIDE craft with so many photodiodes."""
    rise, ticks, key, place = np.empty((4, 2, photodiodes, WIDE))
    return PulseRoom(rise, ticks, key, place, np.empty((3, 2, WIDE)), np.zeros((2, WIDE)))


@kernel
def pack_into(
    flashed: Bools,
    instant: Floats,
    width: Floats,
    strays: Ints,
    stray: Floats,
    flash: Floats,
    flash_width: Ints,
    start_tick: Floats,
    tick: float,
    room: PulseRoom,
    out: Pulses,
) -> None:
    """Write every craft's pulses in order of rise; pulses of equal rise stay in the order flashes, sweeps, strays.

    Args:
        flashed: photodiodes that see each fan's flash, (C, K, 2).
        instant: crossing instants, WIDE craft side by side, (G, 2, K, WIDE) [s], NaN where no sweep is logged.
        width: sweep widths, (G, 2, K, WIDE) [s].
        strays: numbers of stray pulses, (C,).
        stray: photodiode (rounded down), instant [s] and width [s] of the stray pulses, (C, S, 3).
        flash: instants at which the flashes rise, (2,) [s].
        flash_width: widths of the flashes, (2,) [ticks].
        start_tick: start of the period on each craft's clock, not a whole number, (C,) [ticks].
        tick: length of a tick [s].
        room: room for the sweeps of WIDE craft.
        out: output, with room for all of them; behind the last one, photodiode is -1 and the rest 0.
    """
    # Places have no sign: a kernel looks for a negative one with every element that it writes.
    for c in range(len(flashed)):
        g, i = c // WIDE, c % WIDE
        if i == 0:
            _begin(g, flashed, start_tick, room)
            _order(wide_in(instant)[g], wide_in(width)[g], flash, tick, room)
        start, photodiode, rise, wide = start_tick[c], out.photodiode[c], out.rise_tick[c], out.width_tick[c]
        total = 0
        for fan in range(2):
            rises = int(np.rint(start + flash[fan] / tick))
            at = int(np.int64(np.uint32(room.flash[2, fan, i])))
            for k in range(flashed.shape[1]):
                if flashed[c, k, fan]:
                    photodiode[at], rise[at], wide[at] = k, rises, flash_width[fan]
                at += flashed[c, k, fan]
                total += flashed[c, k, fan]
        for fan in range(2):
            for k in range(flashed.shape[1]):
                if room.key[fan, k, i] < np.inf:
                    place = np.uint32(room.place[fan, k, i])
                    photodiode[place], rise[place] = k, int(room.rise[fan, k, i])
                    wide[place] = int(room.ticks[fan, k, i])
                    total += 1
        for s in range(strays[c]):
            long = max(1, int(np.rint(stray[c, s, 2] / tick)))
            total = _insert(
                total, int(stray[c, s, 0]), int(np.rint(start + stray[c, s, 1] / tick)), long, photodiode, rise, wide
            )
        out.total[c] = total
        for at in range(total, len(rise)):
            photodiode[at], rise[at], wide[at] = -1, 0, 0


@inlined
def _begin(g: int, flashed: Bools, start_tick: Floats, room: PulseRoom) -> None:
    """Bring the start of the period of WIDE craft side by side, and how many photodiodes see each flash."""
    for i in range(min(WIDE, len(flashed) - WIDE * g)):
        c, x, y = WIDE * g + i, 0, 0
        for k in range(flashed.shape[1]):
            x += flashed[c, k, 0]
            y += flashed[c, k, 1]
        room.flash[1, 0, i], room.flash[1, 1, i] = x, y
        room.start[0, i], room.start[1, i] = start_tick[c], np.rint(start_tick[c])


@inlined
def _order(instant: Floats, width: Floats, flash: Floats, tick: float, room: PulseRoom) -> None:
    """Write rises, widths and places of WIDE craft's sweeps, and the places of their flashes.

    instant, width: crossing instants and widths of the sweeps, (2, K) lanes.
    """
    rises, ticks, keys, places = wide_in(room.rise), wide_in(room.ticks), wide_in(room.key), wide_in(room.place)
    flashes, starts = wide_in(room.flash), wide_in(room.start)
    start, origin, photodiodes = starts[0], starts[1], instant.shape[1]
    for fan in range(2):
        flashes[0, fan] = (_whole(start + flash[fan] / tick) - origin) * (2 * photodiodes) - 0.5
    reverse = flashes[0, 1] < flashes[0, 0]
    flashes[2, 0], flashes[2, 1] = select(reverse, flashes[1, 1], 0.0), select(reverse, 0.0, flashes[1, 0])
    last, next_, number = alike(start, -np.inf), alike(start, np.inf), alike(start, 0.0)
    for k in range(photodiodes):
        for fan in range(2):
            long = max(1.0, _whole(width[fan, k] / tick))
            rise = _whole(start + instant[fan, k] / tick - long / 2)
            key = select(rise == rise, (rise - origin) * (2 * photodiodes) + (2 * k + fan), np.inf)
            ticks[fan, k], rises[fan, k], keys[fan, k] = long, rise, key
            before = alike(start, 0.0)
            for one in range(2):
                earlier = flashes[0, one] < key
                before += select(earlier, flashes[1, one], 0.0)
                flashes[2, one] = flashes[2, one] + select(earlier, 0.0, 1.0)
            places[fan, k] = before
        there = keys[0, k] < np.inf
        last, next_ = select(there, max(last, keys[0, k]), last), min(next_, keys[1, k])
        number += select(there, 1.0, 0.0)
    # As a rule, all sweeps of fan X are before all of fan Y.
    parted = all_of(last < next_)
    for fan in range(2):
        for k in range(photodiodes):
            key, before = keys[fan, k], places[fan, k]
            for other in range(2):
                if parted and other < fan:
                    before += number
                elif not (parted and other > fan):
                    for n in range(photodiodes):
                        before += select(keys[other, n] < key, 1.0, 0.0)
            places[fan, k] = before


@inlined
def _whole(value: float) -> float:
    """Return the nearest whole number of each lane, below 2^51."""
    return (value + _ROUNDER) - _ROUNDER


@inlined
def _insert(
    count: int,
    photodiode: int,
    rise: int,
    width: int,
    photodiodes: NDArray[np.int16],
    rises: Ints,
    widths: NDArray[np.int32],
) -> int:
    """Insert a pulse into the first `count` entries of a row, sorted by rise; return the new count."""
    i = count
    while i > 0 and rises[i - 1] > rise:
        photodiodes[i], rises[i], widths[i] = photodiodes[i - 1], rises[i - 1], widths[i - 1]
        i -= 1
    photodiodes[i], rises[i], widths[i] = photodiode, rise, width
    return count + 1
