"""The choice of K stations among candidates: coverage before precision, greedy and then by exchange.

The information of stations adds up (`information`), so the error e of a pose under a choice is the root of a trace. A
pose is *decided* where the chosen stations light at least four photodiodes together, eight rows for six numbers, and
the information determines it, e < `WORST`; a photodiode that two stations light counts twice, for it is measured twice.
With a loss, e is the largest error that is left when any one of the chosen stations fails. The objective is

    1. the share of undecided poses beyond the 1 - q that are forgiven, down to nothing;
    2. ln e at the percentile q, and a part of ln e at the median.

Stations are added one by one, each where it helps most, and from there and from random choices each is exchanged for
any other candidate as long as that helps (Fedorov, Theory of Optimal Experiments, 1972).
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.pnp import FEWEST_LIT
from estimators.linear import cholesky_into

WORST = 1e3
"""Errors beyond so many times the wanted ones count as undecided."""
EXCESS = 1e5
"""Weight of the share of undecided poses: one pose outweighs any gain in precision."""
SHORT = 0.05
"""Among undecided poses, one that lacks fewer photodiodes is better by this much of a pose for each."""
MEDIAN = 0.25
"""Weight of the median beside the percentile."""
LEAST_GAIN = 1e-9
"""An exchange gains more than rounding."""


class Views(NamedTuple):
    """Measurements of N stations at P poses. information: (N, P, 6, 6), scaled so that e^2 = tr (sum)^-1. lit: (N, P),
    number of photodiodes that each lights.
    """

    information: Floats
    lit: Ints

    def joined(self, other: "Views") -> "Views":
        """Return both together, this one's stations first."""
        return Views(np.concatenate([self.information, other.information]), np.concatenate([self.lit, other.lit]))

    def at(self, index: Ints) -> "Views":
        """Return the stations with these indices."""
        return Views(self.information[index], self.lit[index])


class Choice(NamedTuple):
    """Indices of the chosen candidates (K,), ascending, and the objective."""

    chosen: Ints
    objective: float


class _Goal(NamedTuple):
    """spot: (N,), place of each candidate, of which one may be chosen. fixed: stations that stand already. share: q.
    losses: stations that may fail, 0 or 1.
    """

    spot: Ints
    fixed: Views
    share: float
    losses: int


def none_fixed(poses: int) -> Views:
    """Return the views of no station at so many poses."""
    return Views(np.empty((0, poses, 6, 6)), np.empty((0, poses), dtype=np.int64))


def errors(stations: Views, losses: int = 0) -> Floats:
    """Return the error e (P,) of every pose with all these stations, inf where it is not decided.

    Args:
        stations: the stations that stand.
        losses: 1: the largest error with any one of them lost.
    """
    found = _worst(stations, losses)
    return np.where(found < WORST, found, np.inf)


def objective(error: Floats, share: float) -> Floats:
    """Return the objective (...,) of errors (..., P), undecided ones `WORST` (1 + photodiodes that are lacking)."""
    ordered = np.sort(error, axis=-1)
    count = error.shape[-1]
    blind = ordered >= WORST
    last = _rank(share, count)
    beyond = np.maximum(0, np.count_nonzero(blind, axis=-1) - (count - 1 - last)) / count
    lacking = np.where(blind, ordered / WORST - 1, 0.0).mean(axis=-1)
    q, half = (np.minimum(ordered[..., _rank(part, count)], WORST) for part in (share, 0.5))
    short = np.where(beyond > 0, beyond + SHORT * lacking, 0.0)
    out: Floats = EXCESS * short + np.log(q) + MEDIAN * np.log(half)
    return out


def choose(
    candidates: Views,
    spot: Ints,
    count: int,
    share: float,
    *,
    losses: int = 0,
    fixed: Views,
    starts: int,
    seed: int,
) -> list[Choice]:
    """Return different choices, the best first.

    Args:
        candidates: N candidates at P poses.
        spot: (N,), place of each candidate: one may stand there.
        count: number K of stations to choose, at most the number of places.
        share: q of the percentile.
        losses: stations that may fail at a time, 0 or 1; those that stand already may fail too.
        fixed: stations that stand already, at the same poses.
        starts: number of random choices that are improved, beside the greedy one.
        seed: seed of the random choices.
    """
    goal = _Goal(spot, fixed, share, losses)
    rng = np.random.default_rng(seed)
    every = [_greedy(candidates, count, goal)]
    for _ in range(starts):
        order = rng.permutation(len(spot))
        # The first candidate of each place in a random order, in that order.
        first = np.sort(np.unique(spot[order], return_index=True)[1])
        every.append(order[first[:count]])
    return _distinct([_exchanged(candidates, start, goal) for start in every])


def improve(candidates: Views, spot: Ints, start: Ints, share: float, *, losses: int = 0, fixed: Views) -> Choice:
    """Return the choice that exchanges lead to from a start (K,), its indices in the order of the start.

    Args:
        candidates: N candidates at P poses.
        spot: (N,), place of each candidate: one may stand there.
        start: indices of the first choice.
        share: q of the percentile.
        losses: stations that may fail at a time, 0 or 1.
        fixed: stations that stand already.
    """
    return _exchanged(candidates, start, _Goal(spot, fixed, share, losses))


def _rank(share: float, count: int) -> int:
    return max(int(np.ceil(share * count - 1e-9)) - 1, 0)


def _greedy(candidates: Views, count: int, goal: _Goal) -> Ints:
    """Return a choice whose stations were added one by one, each the best by the errors without a loss."""
    chosen: list[int] = []
    for _ in range(count):
        base = goal.fixed.joined(candidates.at(np.array(chosen, dtype=np.int64)))
        cost = objective(_with_each(base, candidates, 0), goal.share)
        cost[np.isin(goal.spot, goal.spot[chosen])] = np.inf
        chosen.append(int(np.argmin(cost)))
    return np.array(chosen, dtype=np.int64)


def _exchanged(candidates: Views, start: Ints, goal: _Goal) -> Choice:
    """Exchange one station after the other for the best candidate, until none helps."""
    chosen = np.array(start, dtype=np.int64)
    best = float(objective(_worst(goal.fixed.joined(candidates.at(chosen)), goal.losses), goal.share))
    slot, kept = 0, 0
    while kept < len(chosen):
        others = np.delete(chosen, slot)
        cost = objective(_with_each(goal.fixed.joined(candidates.at(others)), candidates, goal.losses), goal.share)
        cost[np.isin(goal.spot, goal.spot[others])] = np.inf
        found = int(np.argmin(cost))
        if cost[found] < best - LEAST_GAIN:
            chosen[slot], best, kept = found, float(cost[found]), 0
        kept += 1
        slot = (slot + 1) % len(chosen)
    return Choice(chosen, best)


def _distinct(choices: list[Choice]) -> list[Choice]:
    out: dict[tuple[int, ...], Choice] = {}
    for choice in sorted(choices, key=lambda each: each.objective):
        ordered = np.sort(choice.chosen)
        out.setdefault(tuple(ordered.tolist()), Choice(ordered, choice.objective))
    return list(out.values())


def _worst(stations: Views, losses: int) -> Floats:
    """Return the errors (P,) of stations, those of undecided poses as `objective` takes them."""
    count, poses = stations.lit.shape
    nothing = Views(np.zeros((1, poses, 6, 6)), np.zeros((1, poses), dtype=np.int64))
    if not count:
        empty: Floats = _with_each(nothing, nothing, 0)[0]
        return empty
    # The last one as the candidate that joins the others.
    out: Floats = _with_each(stations.at(np.arange(count - 1)), stations.at(np.array([count - 1])), losses)[0]
    return out


def _with_each(base: Views, candidates: Views, losses: int) -> Floats:
    """Return the errors (N, P) of the stations of `base` together with each candidate, the largest with one lost."""
    poses = candidates.lit.shape[1]
    whole, lit = base.information.sum(axis=0)[None], base.lit.sum(axis=0)[None]
    floor = np.zeros(poses)
    if losses:
        # The candidate itself is lost: the same for all.
        nothing = Views(np.zeros((1, poses, 6, 6)), np.zeros((1, poses), dtype=np.int64))
        out = np.empty((1, poses))
        _errors_into(whole, lit, *nothing, floor, out)
        floor = out[0].copy()
        if len(base.lit):
            whole, lit = whole - base.information, lit - base.lit
        else:
            return np.broadcast_to(floor, candidates.lit.shape).copy()
    out = np.empty(candidates.lit.shape)
    _errors_into(
        np.ascontiguousarray(whole), np.ascontiguousarray(lit), candidates.information, candidates.lit, floor, out
    )
    return out


@kernel
def _errors_into(whole: Floats, lit: Ints, information: Floats, reached: Ints, floor: Floats, out: Floats) -> None:
    """Write the largest error (N, P) of each candidate with any of B bases.

    Args:
        whole: (B, P, 6, 6), information of the bases.
        lit: (B, P), photodiodes that they light.
        information: (N, P, 6, 6), of the candidates.
        reached: (N, P), photodiodes that they light.
        floor: (P,), least value.
        out: (N, P), receives the errors.
    """
    total, lower, column = np.empty((6, 6)), np.zeros((6, 6)), np.empty(6)
    for n in range(out.shape[0]):
        for p in range(out.shape[1]):
            worst = floor[p]
            for b in range(whole.shape[0]):
                seen = lit[b, p] + reached[n, p]
                if seen < FEWEST_LIT:
                    worst = max(worst, WORST * (1 + FEWEST_LIT - seen))
                    continue
                for i in range(6):
                    for j in range(i + 1):
                        total[i, j] = whole[b, p, i, j] + information[n, p, i, j]
                error = WORST
                if cholesky_into(total, lower):
                    square = 0.0
                    for j in range(6):
                        for i in range(j, 6):
                            value = 1.0 if i == j else 0.0
                            for k in range(j, i):
                                value -= lower[i, k] * column[k]
                            column[i] = value / lower[i, i]
                            square += column[i] * column[i]
                    error = min(WORST, np.sqrt(square))
                worst = max(worst, error)
            out[n, p] = worst
