"""Kernels of the pulses that a craft's circuits log in a period: flashes, sweeps and stray light in order of rise.

The place of a pulse in the log is the number of pulses before it: of a sweep it is counted by comparing all sweeps of
the craft with it, WIDE at a time; the pulses of a flash rise together.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import WIDE, select, wide_in
from swarm.messages import Pulses


class _Room(NamedTuple):
    """Room for one craft's sweeps, number n that of photodiode n // 2 by fan n % 2, and more to fill the last lanes.

    rise, ticks: rise and width [ticks]. key: orders them by rise, and sweeps of equal rise by number; inf where there
    is none. place: number of pulses before each. keys, places: the last two side by side, (G, WIDE).
    """

    rise: Floats
    ticks: Floats
    key: Floats
    place: Floats
    keys: Floats
    places: Floats


@kernel
def pack_into(
    flashed: Bools,
    instant: Floats,
    width: Floats,
    lost: Bools,
    strays: Ints,
    stray: Floats,
    flash: Floats,
    flash_width: Ints,
    start_tick: Floats,
    tick: float,
    out: Pulses,
) -> None:
    """Write every craft's pulses in order of rise; pulses of equal rise stay in the order flashes, sweeps, strays.

    Args:
        flashed: photodiodes that see each fan's flash, (C, K, 2).
        instant: crossing instants, (C, K, 2) [s], NaN where there is no sweep.
        width: sweep widths, (C, K, 2) [s].
        lost: sweeps whose pulse is lost, (C, K, 2).
        strays: numbers of stray pulses, (C,).
        stray: photodiode (rounded down), instant [s] and width [s] of the stray pulses, (C, S, 3).
        flash: instants at which the flashes rise, (2,) [s].
        flash_width: widths of the flashes, (2,) [ticks].
        start_tick: start of the period on each craft's clock, not a whole number, (C,) [ticks].
        tick: length of a tick [s].
        out: output, with room for all of them; behind the last one, photodiode is -1 and the rest 0.
    """
    craft, sweeps = len(flashed), 2 * flashed.shape[1]
    groups = -(-sweeps // WIDE)
    keys, places = np.full((groups, WIDE), np.inf), np.empty((groups, WIDE))
    room = _Room(np.empty(sweeps), np.empty(sweeps), keys.reshape(-1), places.reshape(-1), keys, places)
    _pack_into(
        flashed.reshape(craft, sweeps),
        instant.reshape(craft, sweeps),
        width.reshape(craft, sweeps),
        lost.reshape(craft, sweeps),
        strays,
        stray,
        flash,
        flash_width,
        start_tick,
        tick,
        room,
        out,
    )


@kernel
def _pack_into(
    flashed: Bools,
    instant: Floats,
    width: Floats,
    lost: Bools,
    strays: Ints,
    stray: Floats,
    flash: Floats,
    flash_width: Ints,
    start_tick: Floats,
    tick: float,
    room: _Room,
    out: Pulses,
) -> None:
    """Do the work of `pack_into`, with all sweeps of a craft in one row, (C, 2 K)."""
    rises, ticks, keys = room.rise, room.ticks, room.key
    sweeps = flashed.shape[1]
    for c in range(len(flashed)):
        start = start_tick[c]
        origin = np.rint(start)
        for n in range(sweeps):
            ticks[n] = max(1.0, np.rint(width[c, n] / tick))
            rises[n] = np.rint(start + instant[c, n] / tick - ticks[n] / 2)
            gone = np.isnan(rises[n]) or lost[c, n]
            keys[n] = np.inf if gone else (rises[n] - origin) * sweeps + n
        seen_x, seen_y = 0, 0
        for n in range(0, sweeps, 2):
            seen_x += flashed[c, n]
            seen_y += flashed[c, n + 1]
        x, y = np.rint(start + flash[0] / tick), np.rint(start + flash[1] / tick)
        # Just below the keys of sweeps that rise with the flash.
        key_x, key_y = (x - origin) * sweeps - 0.5, (y - origin) * sweeps - 0.5
        _count_before(room, key_x, key_y, seen_x, seen_y)
        photodiode, rise, wide, total = out.photodiode[c], out.rise_tick[c], out.width_tick[c], seen_x + seen_y
        at_x, at_y = (seen_y, 0) if y < x else (0, seen_x)
        for n in range(sweeps):
            at_x += keys[n] < key_x
            at_y += keys[n] < key_y
        for k in range(sweeps // 2):
            if flashed[c, 2 * k]:
                photodiode[at_x], rise[at_x], wide[at_x] = k, int(x), flash_width[0]
                at_x += 1
            if flashed[c, 2 * k + 1]:
                photodiode[at_y], rise[at_y], wide[at_y] = k, int(y), flash_width[1]
                at_y += 1
        for n in range(sweeps):
            if keys[n] < np.inf:
                place = int(room.place[n])
                photodiode[place], rise[place], wide[place] = n >> 1, int(rises[n]), int(ticks[n])
                total += 1
        for s in range(strays[c]):
            long = max(1, int(np.rint(stray[c, s, 2] / tick)))
            total = _insert(
                total, int(stray[c, s, 0]), int(np.rint(start + stray[c, s, 1] / tick)), long, photodiode, rise, wide
            )
        out.total[c] = total
        for place in range(total, len(rise)):
            photodiode[place], rise[place], wide[place] = -1, 0, 0


@inlined
def _count_before(room: _Room, x: float, y: float, seen_x: int, seen_y: int) -> None:
    """Write how many pulses are before each sweep; x, y: keys of the flashes, which seen_x, seen_y photodiodes see."""
    keys, places = wide_in(room.keys), wide_in(room.places)
    for g in range(len(keys)):
        one = keys[g]
        before = select(x < one, float(seen_x), 0.0) + select(y < one, float(seen_y), 0.0)
        for n in range(len(room.key)):
            before += select(room.key[n] < one, 1.0, 0.0)
        places[g] = before


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
