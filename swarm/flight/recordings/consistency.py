"""Noise and false photodiodes of a recording, found from its own redundancy before it is replayed.

n photodiodes give 2 n angles for a pose of 6 unknowns; the 2 n - 6 left over tell the noise of an angle. Per period,
one photodiode or two are false if the fit without them is better by more than chance allows. With F and F' the costs
with and without k photodiodes, r' = 2 (n - k) - 6, and Gaussian noise of any size, F' / F has the beta distribution of
r' / 2 and k; the best of all choices of k has up to as many times its probability. Further ones are sought among the
rest, down to five. No noise need be known for that, and a photodiode that sees a reflection does not raise it.

The noise of the recording is that of the median period, or that which explains four of five periods, whichever is
larger: what photodiodes' places and the fans leave behind changes with the pose, and is noise here. A photodiode that
is false in half of its periods is left out of all: it sees a constant reflection, or is not where CONFIG has it.
"""

from collections.abc import Iterable
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, chdtri

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.integrity import FEWEST_KEPT, Sweeps
from estimators.lighthouse.pnp import refine

CHANCE = 1e-3
"""Probability that an honest period loses a photodiode."""
FEWEST_PERIODS = 20
"""Periods with redundancy below which nothing is told."""
FALSE_SHARE = 0.5
"""Share of a photodiode's periods in which it is false, from which it is left out of all."""
_SHARE = 0.8


class Consistency(NamedTuple):
    """Findings about one recording.

    noise_rad: independent noise of an angle, 1 sigma, None if too few periods tell it. false: photodiodes that are left
    out of all periods, (n,). share: of the periods in which each of those was tested and found false, (n,).
    """

    noise_rad: float | None
    false: Ints
    share: Floats


class Sample(NamedTuple):
    """One period of one object with a pose near to the solution: rotation (1, 3, 3), position (1, 3) [m]."""

    sweeps: Sweeps
    rotation: Floats
    position: Floats


def assess(samples: Iterable[Sample]) -> Consistency:
    """Return the noise and the false photodiodes of periods; those without redundancy are passed over."""
    costs: list[float] = []
    redundancy: list[int] = []
    tested = dropped = np.zeros(0, dtype=np.int64)
    for sample in samples:
        lit = sample.sweeps.lit[0]
        if np.count_nonzero(lit) < FEWEST_KEPT:
            continue
        kept, cost = _agreeing(sample)
        if not np.isfinite(cost):
            continue
        if not len(tested):
            tested, dropped = np.zeros((2, len(lit)), dtype=np.int64)
        if np.count_nonzero(lit) > FEWEST_KEPT:
            tested += lit
            dropped += lit & ~kept
        costs.append(cost)
        redundancy.append(2 * int(np.count_nonzero(kept)) - 6)
    if len(costs) < FEWEST_PERIODS:
        return Consistency(None, np.zeros(0, dtype=np.int64), np.zeros(0))
    share = dropped / np.maximum(tested, 1)
    false = np.flatnonzero((share >= FALSE_SHARE) & (tested >= FEWEST_PERIODS))
    dof = np.array(redundancy, dtype=np.float64)
    median = float(np.median(np.array(costs) / dof))
    most = float(np.quantile(np.array(costs) / chdtri(dof, 1 - _SHARE), _SHARE))
    return Consistency(float(np.sqrt(max(median, most))), false, share[false])


def _agreeing(sample: Sample) -> tuple[Bools, float]:
    """Return the photodiodes that agree, (K,), and the cost of their fit [rad^2], NaN without one."""
    kept = sample.sweeps.lit[0].copy()
    cost = float(_fits(sample, kept[None])[0])
    while np.isfinite(cost):
        least, better = CHANCE, None
        for count in (1, 2):
            n = int(np.count_nonzero(kept))
            if n - count < FEWEST_KEPT:
                continue
            choices = np.array(list(combinations(np.flatnonzero(kept).tolist(), count)))
            without = np.tile(kept, (len(choices), 1))
            without[np.arange(len(choices))[:, None], choices] = False
            costs = np.where(np.isfinite(found := _fits(sample, without)), found, np.inf)
            best = int(np.argmin(costs))
            chance = len(choices) * float(betainc(n - count - 3, count, min(costs[best] / cost, 1.0)))
            if chance < least:
                least, better = chance, (without[best], float(costs[best]))
        if better is None:
            break
        kept, cost = better
    return kept, cost


def _fits(sample: Sample, lit: Bools) -> Floats:
    """Return the costs of the fits of one period to some of its photodiodes, lit (N, K): (N,), NaN where unsolved."""
    s = sample.sweeps.of(np.zeros(len(lit), dtype=np.int64))
    rotation = np.broadcast_to(sample.rotation, (len(lit), 3, 3))
    position = np.broadcast_to(sample.position, (len(lit), 3))
    fit = refine(s.theta, lit, s.point_m, rotation, position, s.offset_s, s.angular_rate, s.velocity)
    return np.where(fit.solved, fit.cost, np.nan)
