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


@kernel
def errors_into(keys: Keys, rotor: np.uint64, frame: int, lit: Bools, own: float, shared: float, out: Floats) -> None:
    """Write the random errors of the angles of photodiodes that are lit.

    Args:
        keys: key of each craft, (C,).
        rotor: key of the rotor.
        frame: number of the period.
        lit: photodiodes that are lit as each fan sweeps, (C, K, 2).
        own: standard deviation of an angle by itself [rad].
        shared: standard deviation of what all angles of a sweep have in common [rad].
        out: output, (C, K, 2) [rad]; NaN where a fan does not light a photodiode.
    """
    groups = -(-2 * lit.shape[1] // WIDE)
    share, normal, which = np.full((groups, WIDE), 0.5), np.empty((groups, WIDE)), np.empty(groups * WIDE, np.int64)
    _errors_into(keys, rotor, frame, lit, own, shared, share.reshape(-1), share, normal.reshape(-1), normal, which, out)


@kernel
def _errors_into(
    keys: Keys,
    rotor: np.uint64,
    frame: int,
    lit: Bools,
    own: float,
    shared: float,
    share: Floats,
    shares: Floats,
    normal: Floats,
    quantiles: Floats,
    which: Ints,
    out: Floats,
) -> None:
    """Do the work of `errors_into`.

    share, normal: room for the 2 K draws of a craft, filled up to whole lanes with 1/2; shares, quantiles: the same
    memory, (G, WIDE); which: room for as many numbers.
    """
    common = normals(rotor, frame, 0, ANGLE)
    first, second = shared * common[0], shared * common[1]
    for c in range(lit.shape[0]):
        seen = 0
        for k in range(lit.shape[1]):
            seen += lit[c, k, 0] | lit[c, k, 1]
        if seen:
            uniforms_into(keys[c], frame, ANGLE, lit.shape[1], share)
            normal_quantiles_into(shares, quantiles, which)
        for k in range(lit.shape[1]):
            out[c, k, 0] = own * normal[2 * k] + first if lit[c, k, 0] else np.nan
            out[c, k, 1] = own * normal[2 * k + 1] + second if lit[c, k, 1] else np.nan


@kernel
def chances_into(keys: Keys, frame: int, miss: float, lose: float, flashed: Bools, lost: Bools) -> None:
    """Take missed flashes from `flashed`, of all photodiodes of a craft at once, and write which sweeps are lost.

    Args:
        keys: key of each craft, (C,).
        frame: number of the period.
        miss: probability that a craft misses a flash.
        lose: probability that a photodiode loses a sweep.
        flashed: photodiodes that see each fan's flash, (C, K, 2); changed.
        lost: output, sweeps whose pulse is lost, (C, K, 2).
    """
    for c in range(flashed.shape[0]):
        missed = uniforms(keys[c], frame, 0, MISSED) if miss > 0 else (1.0, 1.0)
        for k in range(flashed.shape[1]):
            chance = uniforms(keys[c], frame, k, LOST) if lose > 0 else (1.0, 1.0)
            for fan in range(2):
                flashed[c, k, fan] = flashed[c, k, fan] and missed[fan] >= miss
                lost[c, k, fan] = chance[fan] < lose
