"""Design of a layout: the places of N photodiodes among many candidates, by coverage, then precision.

The objective, over many poses, with unsolvable ones counted as worse than any error:

    1. the share of unsolvable poses beyond the 1 - q that the q-th percentile forgives, down to nothing;
    2. the tail: the mean of ln e between the percentiles q - 20 % and q (a mean, because one percentile alone says
       little about which exchange leads towards a better one).

Where one photodiode may be lost at any pose, unsolvable is a pose that is not solvable without each of the lit ones,
none is forgiven, and e is the error without the one that is missed most.

Step 1 is a matter of how many photodiodes see together, not of precision: from random sets, by counts alone, until no
exchange of one photodiode for any candidate helps. The best sets that differ are refined likewise on the whole
objective; then, a few times, some photodiodes of the best ones are thrown elsewhere and exchanged again (iterated local
search). Exchange is Fedorov's algorithm for D-optimal designs (Theory of Optimal Experiments, 1972) with another
objective; it ends in a local optimum, and starts and throws are what is done about that.
"""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.layout.error import (
    LACKING,
    WANTED_LIT,
    WORST,
    Sightings,
    add_up,
    lost_error,
    mixed_error,
    worst_loss,
)
from estimators.lighthouse.pnp import FEWEST_LIT

TAIL = 0.2
"""Width of the tail below the percentile."""
MARGIN = 0.96
"""Share of the poses forgiven by the percentile that the search uses: it sees a sample of the poses only."""
EXCESS = 1e5
"""Weight of the share of unsolvable poses: one pose of thousands outweighs any gain in the tail."""
SHORT = 1e-3
"""Among unsolvable poses, one that lacks fewer photodiodes is better by this much of a pose."""
BEST_TAIL = -21.0
"""Logarithm of an error that is 1e-9 of the wanted one: no tail is lighter."""
SMALL = 1e-9
"""A gain below this is rounding."""
SWEEPS = 20
"""An exchange that has not ended after so many rounds over all photodiodes is stopped."""
STARTS = 200
FINALISTS = 12
KEPT = 4
"""Designs that are kept, and thrown again, after every round."""
THROWS = 2
"""Throws of each of them in a round."""
ROUNDS = 2
WORKERS_MAX = 8


class Design(NamedTuple):
    """A set of candidates. chosen: (n,) indices, ascending. objective: its value, smaller is better."""

    chosen: Ints
    objective: float


@kernel
def _excess(seen: Ints, reached: Bools, share: float, losses: int) -> float:
    """Return the weighted excess of unsolvable poses over the forgiven share; `reached` (Q,): see one more."""
    total = 0.0
    for p in range(len(seen)):
        lacking = FEWEST_LIT + losses - seen[p] - reached[p]
        if lacking > 0:
            total += 1 + SHORT * lacking
    forgiven = MARGIN * (1 - share) if losses == 0 else 0.0
    return EXCESS * max(0.0, total / len(seen) - forgiven)


@kernel
def _tail(error: Floats, share: float) -> float:
    """Return the mean logarithm of the errors (P,) between the percentiles; sorts them."""
    error.sort()
    last = max(int(share * len(error)), 1)
    first = min(max(int((share - TAIL) * len(error)), 0), last - 1)
    total = 0.0
    for p in range(first, last):
        total += np.log(error[p])
    return total / (last - first)


@kernel
def _weighed(error: float, seen: int, losses: int) -> float:
    """Return the error of a pose as the search counts it: finite, and raised where photodiodes are lacking."""
    if seen < FEWEST_LIT + losses:
        error = WORST
    return min(error, WORST) * (1 + LACKING * max(0, WANTED_LIT - seen))


@kernel
def _errors_of(
    row: Floats,
    lit: Bools,
    chosen: Ints,
    without: int,
    normal: Floats,
    fan_sum: Floats,
    seen: Ints,
    rho: float,
    losses: int,
    out: Floats,
) -> None:
    """Write the weighed errors (P,) of `chosen`, without one slot, and the sums that `add_up` writes."""
    add_up(row, lit, chosen, without, normal, fan_sum, seen)
    lower, inverse, space = np.zeros((6, 6)), np.zeros((6, 6)), np.empty((2, 2, 6))
    for p in range(len(lit)):
        error = mixed_error(normal[p], fan_sum[p], rho, lower, inverse)
        if losses and error < np.inf and seen[p] > FEWEST_LIT:
            error, _ = worst_loss(row[p], lit[p], chosen, without, fan_sum[p], inverse, rho, space)
        out[p] = _weighed(error, seen[p], losses)


@kernel
def _count(reached: Bools, chosen: Ints, without: int, seen: Ints) -> None:
    """Write the number of `chosen`, without slot `without`, that are lit at every pose (Q,) into `seen`."""
    seen[:] = 0
    for slot in range(len(chosen)):
        if slot != without:
            for p in range(len(seen)):
                seen[p] += reached[p, chosen[slot]]


@kernel
def _free(candidates: int, chosen: Ints) -> Bools:
    """Return which candidates (N,) are not chosen."""
    free = np.ones(candidates, dtype=np.bool_)
    for k in chosen:
        free[k] = False
    return free


@kernel
def _cover(reached: Bools, chosen: Ints, share: float, losses: int) -> float:
    """Exchange `chosen` (n,) in place until no exchange lowers the excess of unsolvable poses, or there is none."""
    poses, candidates = reached.shape
    slots = len(chosen)
    seen = np.empty(poses, dtype=np.int64)
    best, stale, step = np.inf, 0, 0
    while best > 0 and stale < slots and step < SWEEPS * slots:
        slot = step % slots
        _count(reached, chosen, slot, seen)
        free = _free(candidates, chosen)
        here, best = chosen[slot], _excess(seen, reached[:, chosen[slot]], share, losses)
        stale += 1
        for k in range(candidates):
            if free[k]:
                excess = _excess(seen, reached[:, k], share, losses)
                if excess < best - SMALL:
                    here, best, stale = k, excess, 0
        chosen[slot] = here
        step += 1
    return best


@kernel
def _exchange(row: Floats, lit: Bools, reached: Bools, rho: float, chosen: Ints, share: float, losses: int) -> float:
    """Exchange `chosen` (n,) in place until no exchange lowers the objective; returns it."""
    poses, candidates = lit.shape
    slots = len(chosen)
    normal, fan_sum = np.empty((poses, 6, 6)), np.empty((poses, 2, 6))
    seen, counted = np.empty(poses, dtype=np.int64), np.empty(len(reached), dtype=np.int64)
    base, error, space = np.empty(poses), np.empty(poses), np.empty((2, 2, 6))
    more, more_sum = np.empty((6, 6)), np.empty((2, 6))
    lower, inverse = np.zeros((6, 6)), np.zeros((6, 6))
    best, stale, step = np.inf, 0, 0
    while stale < slots and step < SWEEPS * slots:
        slot = step % slots
        _count(reached, chosen, slot, counted)
        _errors_of(row, lit, chosen, slot, normal, fan_sum, seen, rho, losses, base)
        free = _free(candidates, chosen)
        here, least = chosen[slot], best
        for turn in range(-1, candidates):
            # First what is there, then what could be there instead.
            k = chosen[slot] if turn < 0 else turn
            if turn >= 0 and not free[k]:
                continue
            excess = _excess(counted, reached[:, k], share, losses)
            if excess + BEST_TAIL > least:
                continue
            for p in range(poses):
                error[p] = base[p]
                if lit[p, k]:
                    for a in range(6):
                        for fan in range(2):
                            more_sum[fan, a] = fan_sum[p, fan, a] + row[p, k, fan, a]
                        for b in range(a + 1):
                            more[a, b] = normal[p, a, b]
                            for fan in range(2):
                                more[a, b] += row[p, k, fan, a] * row[p, k, fan, b]
                    e = mixed_error(more, more_sum, rho, lower, inverse)
                    if losses and e < np.inf and seen[p] >= FEWEST_LIT:
                        e, own = worst_loss(row[p], lit[p], chosen, slot, more_sum, inverse, rho, space)
                        e = max(e, lost_error(inverse, space[0], own, row[p, k], rho, space[1]))
                    error[p] = _weighed(e, seen[p] + 1, losses)
            value = excess + _tail(error, share)
            if turn < 0:
                best, least = value, value
            elif value < least - SMALL:
                here, least = k, value
        stale = 0 if least < best else stale + 1
        chosen[slot], best = here, least
        step += 1
    return best


def objective(candidates: Sightings, chosen: Ints, share: float, losses: int = 0) -> float:
    """Return the value that the search lowers: the weighted excess of unsolvable poses, and the tail of ln e.

    Args:
        candidates: what they measure.
        chosen: (n,), indices of candidates.
        share: q of the percentile.
        losses: photodiodes that may be lost at any pose, 0 or 1.
    """
    poses = len(candidates.lit)
    chosen = np.ascontiguousarray(chosen, dtype=np.int64)
    normal, fan_sum, seen = np.empty((poses, 6, 6)), np.empty((poses, 2, 6)), np.empty(poses, dtype=np.int64)
    error, rho = np.empty(poses), candidates.rotor_correlation
    _errors_of(candidates.row, candidates.lit, chosen, -1, normal, fan_sum, seen, rho, losses, error)
    counted = np.count_nonzero(candidates.reached[:, chosen], axis=1)
    return float(_excess(counted, np.zeros(len(counted), dtype=np.bool_), share, losses) + _tail(error, share))


def cover(
    reached: Bools, count: int, share: float, starts: int = STARTS, seed: int = 0, losses: int = 0
) -> list[Design]:
    """Return sets of candidates by how few poses they leave unsolvable, best first, none twice.

    Args:
        reached: (Q, N), candidates lit at every pose.
        count: photodiodes of a set.
        share: q of the percentile.
        starts: number of random sets.
        seed: of the random sets.
        losses: photodiodes that may be lost at any pose, 0 or 1.
    """
    rng = np.random.default_rng(seed)
    columns = np.asfortranarray(reached, dtype=np.bool_)

    def covering(start: Ints) -> Design:
        excess = _cover(columns, start, share, losses)
        return Design(np.sort(start), float(excess))

    firsts = [rng.choice(columns.shape[1], count, replace=False).astype(np.int64) for _ in range(starts)]
    with ThreadPoolExecutor(_workers()) as pool:
        return _best(pool.map(covering, firsts))


def refine_design(candidates: Sightings, starts: Iterable[Ints], share: float, losses: int = 0) -> list[Design]:
    """Exchange every start until no exchange lowers the objective; return the results, best first, none twice.

    Args:
        candidates: what they measure.
        starts: sets (n,) of indices.
        share: q of the percentile.
        losses: photodiodes that may be lost at any pose, 0 or 1.
    """
    columns = np.asfortranarray(candidates.reached, dtype=np.bool_)

    def refined(start: Ints) -> Design:
        chosen = np.array(start, dtype=np.int64)
        rho = candidates.rotor_correlation
        value = _exchange(candidates.row, candidates.lit, columns, rho, chosen, share, losses)
        return Design(np.sort(chosen), float(value))

    with ThreadPoolExecutor(_workers()) as pool:
        return _best(pool.map(refined, starts))


def design(
    candidates: Sightings,
    count: int,
    share: float,
    *,
    starts: int = STARTS,
    finalists: int = FINALISTS,
    rounds: int = ROUNDS,
    seed: int = 0,
    losses: int = 0,
) -> list[Design]:
    """Return the best sets of candidates that were found, at most KEPT, best first.

    Args:
        candidates: what they measure.
        count: photodiodes of a set.
        share: q of the percentile.
        starts: number of random sets.
        finalists: number of sets that are refined.
        rounds: rounds of throws.
        seed: of the random sets and throws.
        losses: photodiodes that may be lost at any pose, 0 or 1.

    Raises:
        ValueError: there are fewer candidates than photodiodes, or fewer than four photodiodes.
    """
    places = candidates.lit.shape[1]
    if not FEWEST_LIT <= count <= places:
        raise ValueError(f"{count} photodiodes: at least {FEWEST_LIT} are needed, and there are {places} candidates")
    covering = cover(candidates.reached, count, share, starts, seed, losses)[:finalists]
    best = refine_design(candidates, [found.chosen for found in covering], share, losses)[:KEPT]
    rng = np.random.default_rng([seed, 1])
    for _ in range(rounds):
        thrown = [_thrown(found.chosen, places, rng) for found in best for _ in range(THROWS)]
        best = _best([*best, *refine_design(candidates, thrown, share, losses)])[:KEPT]
    return best


def _workers() -> int:
    return min(cpu_count() or 1, WORKERS_MAX)


def _best(designs: Iterable[Design]) -> list[Design]:
    """Return the designs best first, none twice."""
    found = {tuple(design.chosen.tolist()): design for design in designs}
    return sorted(found.values(), key=lambda design: design.objective)


def _thrown(chosen: Ints, places: int, rng: np.random.Generator) -> Ints:
    """Return `chosen` with a quarter of its photodiodes, two at least, moved to places drawn at random."""
    out = chosen.copy()
    free = np.setdiff1d(np.arange(places), out)
    many = min(max(2, len(out) // 4), len(free))
    out[rng.choice(len(out), many, replace=False)] = rng.choice(free, many, replace=False)
    return out
