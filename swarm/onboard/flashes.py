"""Detection of the sync flashes among one craft's pulses, and the craft's record of their expected times.

A pulse is part of a flash if it is at least half as long as the shortest flash. Overlapping ones are one flash: it rose
when the first of them rose and is as long as the longest, because a photodiode in weak light triggers late; its length
is its code (see `swarm.messages`). A craft accepts flashes as follows:

- It locks on when it sees an X and a Y flash that announce sweeps and lie half a turn apart.
- Locked, it accepts the flash nearest to the time that the same fan's last one predicts, within `tolerance`. A missing
  flash is placed there, for at most `coast` ticks; after that, half a turn from the other fan's flash if that one was
  seen; else the fan's sweeps are not read. With neither fan's flash within reach it is no longer locked.

Kernels for one craft; ticks are its own, as floats: exact to half a tick for 2^52 ticks.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from swarm.messages import FAN_BIT, SKIP_BIT

MAX_FLASHES = 32
"""Largest number of flashes per call; two stations make eight, further ones are rejected."""


class Timing(NamedTuple):
    """A craft's knowledge of the lighthouse's timing, in ticks of its clock.

    half_turn: half a turn of the rotor. period: from one X flash that announces a sweep to the next. coast: time for
    which a flash may be predicted. slot_gap: delay of the second station's flash. tolerance: of a flash's instant.
    sweep_first, sweep_last: limits of the field, from a flash. shortest_pulse: shortest pulse of a flash. code_zero,
    code_step: lengths of flashes by their code. slot: slot of the followed station.
    """

    half_turn: float
    period: float
    coast: float
    slot_gap: float
    tolerance: float
    sweep_first: float
    sweep_last: float
    shortest_pulse: float
    code_zero: float
    code_step: float
    slot: float


class Flashes(NamedTuple):
    """Flashes of one call, (MAX_FLASHES,) each.

    rise, longest: of its first pulse, and the width of its longest one [ticks]. code: -1 if none. size: number of
    pulses in the flash. mine: 1 for the followed station's, 0 for the other's, -1 if unknown because its partner is
    missing.
    """

    rise: Floats
    longest: Floats
    code: Ints
    size: Ints
    mine: Ints


class FlashRecord(NamedTuple):
    """One craft's memory, per fan (2,) [ticks], NaN for none.

    last: the last flash, predicted or seen. seen: the last flash that was seen.
    """

    last: Floats
    seen: Floats


@kernel
def tell(count: int, timing: Timing, out: Flashes) -> None:
    """Write codes of flashes, and whose they are.

    Args:
        count: number of flashes.
        timing: timing of the lighthouse.
        out: flashes, with their rises, longest pulses and sizes.
    """
    two_stations = timing.period > 3 * timing.half_turn
    for i in range(count):
        out.code[i] = max(-1, int(np.floor((out.longest[i] - timing.code_zero) / timing.code_step + 0.5)))
    for i in range(count):
        out.mine[i] = -1 if two_stations else 1
        for j in range(count if two_stations else 0):
            gap = out.rise[i] - out.rise[j]
            same_fan = (out.code[i] ^ out.code[j]) & FAN_BIT == 0
            if same_fan and abs(abs(gap) - timing.slot_gap) <= timing.tolerance:
                out.mine[i] = 1 if (gap > 0) == (timing.slot == 1) else 0


@kernel
def nearest(fan: int, expected: float, flashes: Flashes, count: int, tolerance: float) -> int:
    """Return the index of the fan's flash that rose nearest to the expected time, -1 if none is within the tolerance.

    Args:
        fan: 0 for X, 1 for Y.
        expected: expected rise [ticks].
        flashes: flashes of this period.
        count: number of flashes.
        tolerance: largest deviation [ticks].
    """
    best, index = tolerance, -1
    for i in range(count):
        error = abs(flashes.rise[i] - expected)
        if flashes.code[i] >= 0 and flashes.code[i] & FAN_BIT == fan and error <= best:
            best, index = error, i
    return index


@kernel
def first_pair(flashes: Flashes, count: int, timing: Timing) -> tuple[int, int]:
    """Return the indices of the first X and Y flash that announce sweeps and lie half a turn apart, (-1, -1) if none.

    Args:
        flashes: flashes of this period.
        count: number of flashes.
        timing: timing of the lighthouse.
    """
    for i in range(count):
        for j in range(i + 1, count):
            known = flashes.code[i] >= 0 and flashes.code[j] >= 0 and flashes.mine[i] == 1 and flashes.mine[j] == 1
            sweeps = (flashes.code[i] | flashes.code[j]) & SKIP_BIT == 0
            in_order = flashes.code[i] & FAN_BIT == 0 and flashes.code[j] & FAN_BIT == 1
            apart = abs(flashes.rise[j] - flashes.rise[i] - timing.half_turn) <= timing.tolerance
            if known and sweeps and in_order and apart:
                return i, j
    return -1, -1


@kernel
def follow(flashes: Flashes, count: int, timing: Timing, record: FlashRecord, swept: Bools) -> tuple[int, int, int]:
    """Advance a craft's record by one period, using this period's flashes.

    Args:
        flashes: flashes of this period.
        count: number of flashes.
        timing: timing of the lighthouse.
        record: the craft's record, updated.
        swept: whether each fan's sweep can be read, (2,), written.

    Returns:
        The indices of the accepted X and Y flash (-1: not seen), and the number of expected flashes that were missed.
    """
    for fan in range(2):
        record.last[fan] += timing.period
    locked = record.last[0] - record.seen[0] <= timing.coast or record.last[1] - record.seen[1] <= timing.coast
    if locked:
        x = nearest(0, record.last[0], flashes, count, timing.tolerance)
        y = nearest(1, record.last[1], flashes, count, timing.tolerance)
    else:
        x, y = first_pair(flashes, count, timing)
    missed = 0 if np.isnan(record.last[0]) else (x < 0) + (y < 0)
    for fan, index in ((0, x), (1, y)):
        if index >= 0:
            record.last[fan] = record.seen[fan] = flashes.rise[index]
            swept[fan] = flashes.code[index] & SKIP_BIT == 0
        else:
            swept[fan] = record.last[fan] - record.seen[fan] <= timing.coast
    if x < 0 and y >= 0 and not swept[0]:
        record.last[0], swept[0] = record.last[1] - timing.half_turn, True
    if y < 0 and x >= 0 and not swept[1]:
        record.last[1], swept[1] = record.last[0] + timing.half_turn, True
    return x, y, missed
