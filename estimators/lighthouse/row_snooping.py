"""Rows that contradict the others, told by their residuals from what all others predict (W. Baarda's data snooping).

With S the covariance of a period's innovations y, prediction included, row i lies

    u_i = (S^-1 y)_i / sqrt((S^-1)_ii)

standard deviations from what the prediction and all other rows together expect of it. Photodiodes in weak light, at a
grazing angle or beside a reflection are off by ten times the noise, in one fan only and for a tenth of a second: less
than what a gate on all rows notices, and in a filter that follows them a false distance. The farthest row is left out,
with those of its sweep that are nearly as far, until none lies beyond a limit: four photodiodes of one plane have one
redundant angle per sweep, which tells that one is false, and without the prediction not which.
"""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.innovation import noise_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Packed, Rows, linearise
from estimators.state import State

LIMIT = 2.5
"""Standard deviations beyond which a row contradicts the others: 1 in 80 of honest ones, whose loss costs little. Noise
of real light has tails: half of the rows of a Crazyflie agree to 15 urad, a tenth are off by more than 77."""
RIVAL = 0.8
"""Share of the farthest row's distance from which on another of its sweep may be the false one as well."""


def snooped(
    rows: Rows,
    stations: Packed,
    point_m: Floats,
    state: State,
    covariance: Floats,
    noise: Sequence[AngleNoise],
    acceleration: float = 0.0,
) -> Bools:
    """Return the rows (n,) of one craft that agree with each other; all in front, where fewer than half do.

    Args:
        rows: of one period.
        stations: that they name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        state: predicted state of the craft, without the craft axis.
        covariance: (12, 12), its covariance.
        noise: noise of the rows of each station.
        acceleration: standard deviation per axis of a constant acceleration [m/s^2] that the state does not have.
    """
    y, h = linearise(rows, stations, point_m, state.rotation, state.position, state.velocity, state.angular_rate)
    front: Bools = np.isfinite(y)
    if not front.any():
        return front
    y, h = np.where(front, y, 0.0), np.where(front[:, None], h, 0.0)
    pushed = 0.5 * acceleration * rows.offset_s[:, None] * h[:, 9:12]
    s = h @ covariance @ h.T + pushed @ pushed.T + noise_of(rows, noise)
    sweep = (rows.station * 2 + rows.fan) * (1 + int(rows.sweep.max())) + rows.sweep
    kept = np.flatnonzero(front)
    fewest = (len(kept) + 1) // 2
    while True:
        inverse = np.linalg.inv(s[np.ix_(kept, kept)])
        with np.errstate(invalid="ignore"):
            away = np.abs(inverse @ y[kept]) / np.sqrt(np.diagonal(inverse))
        worst = int(np.argmax(away))
        if not away[worst] > LIMIT:
            break
        kept = kept[(away < RIVAL * away[worst]) | (sweep[kept] != sweep[kept[worst]])]
        if len(kept) < max(fewest, 1):
            return front
    out: Bools = np.zeros(len(y), dtype=np.bool_)
    out[kept] = True
    return out
