"""Choice among several pulses of one photodiode in one sweep.

One of them may be the direct light, the others reflections or stray light; neither order nor width tells which. Only
where the photodiode is expected at some angle is one of them chosen: the nearest, if it is within `CHOICE_RAD` of that
angle and nearer by `CHOICE_RATIO` than any other. Otherwise none of them becomes an angle.

Kernels for one craft with K photodiodes.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel

CHOICE_RAD = 10e-3
"""Largest distance of a pulse from its expected angle to be chosen among several [rad]."""
CHOICE_RATIO = 0.5
"""Largest share of that distance in the next nearest pulse's: beyond it, the two cannot be told apart."""


class Hits(NamedTuple):
    """Pulses that one craft's photodiodes got in the sweeps of one period, by photodiode and fan, (K, 2) each.

    expected: expected angle, NaN where there is none [rad]. pulses: their number. rival: where there are several,
    distance of the second nearest from the expected angle [rad]. theta: angle of the nearest pulse, NaN without one
    [rad]. instant: its instant, 0 without one.
    """

    expected: Floats
    pulses: Ints
    rival: Floats
    theta: Floats
    instant: Floats


def no_hits(expected: Floats) -> Hits:
    """Return the hits of a period that is about to begin, for the expected angles (K, 2) [rad]."""
    hits = Hits(expected, np.empty(expected.shape, np.int64), *np.empty((3, *expected.shape)))
    clear(hits)
    return hits


@kernel
def clear(hits: Hits) -> None:
    """Forget every pulse, as at the beginning of a period."""
    for k in range(len(hits.pulses)):
        for fan in range(2):
            hits.pulses[k, fan], hits.theta[k, fan], hits.instant[k, fan] = 0, np.nan, 0.0


@kernel
def take(hits: Hits, photodiode: int | np.uint16, fan: int, angle: float, instant: float) -> int:
    """Take in one pulse, and return how many its photodiode has got in this sweep so far.

    Args:
        hits: pulses of the period, updated.
        photodiode: photodiode that got it.
        fan: 0 for X, 1 for Y.
        angle: its angle [rad].
        instant: its instant, in whatever unit the caller counts.
    """
    k = photodiode
    hits.pulses[k, fan] = pulses = hits.pulses[k, fan] + 1
    if pulses == 1:
        hits.theta[k, fan], hits.instant[k, fan] = angle, instant
        return 1
    away = abs(angle - hits.expected[k, fan])
    before = abs(hits.theta[k, fan] - hits.expected[k, fan])
    hits.rival[k, fan] = min(hits.rival[k, fan] if pulses > 2 else np.inf, max(away, before))
    if away < before:
        hits.theta[k, fan], hits.instant[k, fan] = angle, instant
    return int(pulses)


@kernel
def choose(hits: Hits) -> int:
    """Drop every pulse that is not chosen among several, and return the number of dropped pulses."""
    dropped = 0
    for k in range(len(hits.pulses)):
        for fan in range(2):
            if hits.pulses[k, fan] < 2:
                continue
            away = abs(hits.theta[k, fan] - hits.expected[k, fan])
            if away <= CHOICE_RAD and away < CHOICE_RATIO * hits.rival[k, fan]:
                dropped += hits.pulses[k, fan] - 1
            else:
                hits.theta[k, fan], hits.instant[k, fan] = np.nan, 0.0
                dropped += hits.pulses[k, fan]
    return dropped
