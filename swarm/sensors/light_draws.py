"""Draws of what happens to the light by chance: errors of angles, lost sweeps, missed flashes and stray pulses.

All are functions of the key of the craft or rotor, the period or sweep, the photodiode, and the kind of draw
(`swarm.draws`): not of what is lit, of other craft, or of the strength of any error.
"""

from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import WIDE
from swarm.draws import Keys, normal_quantiles_into, normals, uniforms, uniforms_into
from swarm.messages import SYNC_WIDTH_S

ANGLE, LOST, MISSED, STRAY, FLASH = range(5)
"""Kinds of draws."""
STRAY_WIDTH_MAX_S = SYNC_WIDTH_S / 10
"""Longest stray pulse [s]."""


class Strays(NamedTuple):
    """Stray pulses of C craft in a period, in order of time.

    number: of each craft, (C,). pulse: photodiode, instant after the period's start [s], width [s], (C, S, 3).
    """

    number: Ints
    pulse: Floats


def strays(keys: Keys, count: Ints, frame: int, rate_hz: float, period_s: float) -> Strays:
    """Return the stray pulses of every craft in a period, on any of its photodiodes at any time.

    Args:
        keys: key of each craft, (C,).
        count: photodiodes of each craft, (C,).
        frame: number of the period.
        rate_hz: mean number of a craft's stray pulses per second [Hz].
        period_s: length of the period [s].
    """
    mean = rate_hz * period_s
    most = ceil(mean + 12 * sqrt(mean) + 12) if mean > 0 else 0
    out = Strays(np.zeros(len(keys), dtype=np.int64), np.zeros((len(keys), most, 3)))
    if most:
        _strays_into(keys, count, frame, mean, period_s, out)
    return out


@kernel
def _strays_into(keys: Keys, count: Ints, frame: int, mean: float, period_s: float, out: Strays) -> None:
    """Draw the gaps between a craft's strays, which are exponential."""
    for c in range(len(keys)):
        n, share = 0, 0.0
        while count[c] > 0 and n < out.pulse.shape[1]:
            gap, which = uniforms(keys[c], frame, 2 * n, STRAY)
            share -= np.log(gap) / mean
            if share >= 1:
                break
            out.pulse[c, n, 0] = np.floor(count[c] * which)
            out.pulse[c, n, 1] = share * period_s
            out.pulse[c, n, 2] = STRAY_WIDTH_MAX_S * uniforms(keys[c], frame, 2 * n + 1, STRAY)[0]
            n += 1
        out.number[c] = n


class DrawRoom(NamedTuple):
    """Room for the draws of WIDE craft, 2 K each and up to whole lanes more.

    share, normal: one craft after the other, (WIDE, L). shares, normals: the same memory, (G, WIDE). far, which:
    room for as many numbers, (G, WIDE) and (G WIDE,).
    """

    share: Floats
    normal: Floats
    shares: Floats
    normals: Floats
    far: Floats
    which: Ints


def draw_room(photodiodes: int) -> DrawRoom:
    """Return room for the draws of WIDE craft with so many photodiodes."""
    groups = -(-2 * photodiodes // WIDE) * WIDE
    shares, normal, far = np.full((groups, WIDE), 0.5), np.empty((groups, WIDE)), np.ones((groups, WIDE))
    rows = WIDE, groups
    return DrawRoom(shares.reshape(rows), normal.reshape(rows), shares, normal, far, np.empty(shares.size, np.int64))


@kernel
def errors_into(
    keys: Keys, rotor: np.uint64, frame: int, lit: Bools, own: float, shared: float, room: DrawRoom, out: Floats
) -> None:
    """Write the random errors of the angles of photodiodes that are lit, WIDE craft side by side.

    Args:
        keys: key of each craft, (C,).
        rotor: key of the rotor.
        frame: number of the period.
        lit: photodiodes that are lit as each fan sweeps, (C, K, 2).
        own: standard deviation of an angle by itself [rad].
        shared: standard deviation of what all angles of a sweep have in common [rad].
        room: room for the draws of WIDE craft.
        out: output, (G, 2, K, WIDE) [rad]; NaN where a fan does not light a photodiode, and behind the last craft.
    """
    common, groups = normals(rotor, frame, 0, ANGLE), len(room.shares) // WIDE
    first, second = shared * common[0], shared * common[1]
    for g in range(len(out)):
        drawn = 0
        for c in range(WIDE * g, min(WIDE * g + WIDE, lit.shape[0])):
            seen = 0
            for k in range(lit.shape[1]):
                seen += lit[c, k, 0] | lit[c, k, 1]
            if seen:
                uniforms_into(keys[c], frame, ANGLE, lit.shape[1], room.share[drawn])
                drawn += 1
        normal_quantiles_into(groups * drawn, room.shares, room.normals, room.far, room.which)
        drawn = 0
        for i in range(WIDE):
            c, seen = WIDE * g + i, 0
            for k in range(lit.shape[1]):
                x, y = (lit[c, k, 0], lit[c, k, 1]) if c < lit.shape[0] else (False, False)
                out[g, 0, k, i] = own * room.normal[drawn, 2 * k] + first if x else np.nan
                out[g, 1, k, i] = own * room.normal[drawn, 2 * k + 1] + second if y else np.nan
                seen += x | y
            drawn += seen > 0


@kernel
def chances_into(keys: Keys, frame: int, miss: float, lose: float, flashed: Bools, instant: Floats) -> None:
    """Take missed flashes from `flashed`, of all photodiodes of a craft at once, and lost sweeps from `instant`.

    Args:
        keys: key of each craft, (C,).
        frame: number of the period.
        miss: probability that a craft misses a flash.
        lose: probability that a photodiode loses a sweep.
        flashed: photodiodes that see each fan's flash, (C, K, 2); changed.
        instant: instants of the sweeps, WIDE craft side by side, (G, 2, K, WIDE); NaN afterwards where one is lost.
    """
    for c in range(flashed.shape[0]):
        missed = uniforms(keys[c], frame, 0, MISSED) if miss > 0 else (1.0, 1.0)
        for k in range(flashed.shape[1]):
            chance = uniforms(keys[c], frame, k, LOST) if lose > 0 else (1.0, 1.0)
            for fan in range(2):
                flashed[c, k, fan] = flashed[c, k, fan] and missed[fan] >= miss
                if chance[fan] < lose:
                    instant[c // WIDE, fan, k, c % WIDE] = np.nan
