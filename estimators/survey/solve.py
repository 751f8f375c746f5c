"""Levenberg-Marquardt on the sparse problem of a survey, with a robust loss, and the covariance of the result.

Each row counts by Cauchy's weight 1 / (1 + (r / C)^2) of its whitened residual r, C = `ROBUST` standard deviations, so
that reflections and mistaken hits lose their pull smoothly. Normal equations are solved by SuperLU: every window joins
the others through the stations alone, so the factor stays sparse.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from estimators.arrays import Floats
from estimators.levenberg_marquardt import judged, raised
from estimators.survey.problem import Problem, Room

ROBUST = 3.0
"""Residual [standard deviations] of half weight; 90 % efficient where the noise is normal."""
ROUNDS = 60
_SETTLED = 1e-6
"""Relative gain of a step that ends the rounds: of a cost of 1000, a thirtieth of a standard deviation."""
_DAMPING_MAX = 1e9
_FLOOR = 1e-12
"""Added to the diagonal, for unknowns that no row depends on."""


class Solution(NamedTuple):
    """A least-squares solution.

    room: the result. residual: whitened residuals of the rows (M,). raw: the same not whitened [rad]. weight: robust
    weights (M,). cost: the robust cost. normal: the weighted normal matrix. rounds: number of steps.
    """

    room: Room
    residual: Floats
    raw: Floats
    weight: Floats
    cost: float
    normal: sparse.csc_array
    rounds: int


def solve(problem: Problem, room: Room, *, scale: float = 1.0, rounds: int = ROUNDS) -> Solution:
    """Return the least-squares solution from a start.

    Args:
        problem: the problem.
        room: the start.
        scale: factor of `ROBUST`, for starts that are far off.
        rounds: steps at most.
    """
    limit = ROBUST * scale
    damping, cost = 0.0, _cost(problem, room, limit)
    taken, system = 0, _system(problem, room, limit)
    for _ in range(rounds):
        diagonal = system.normal.diagonal()
        accepted, settled = False, False
        while damping < _DAMPING_MAX:
            factor = _factored(system.normal, damping, diagonal)
            if factor is not None:
                step = factor.solve(system.slope)
                trial = problem.take(room, step)
                next_cost = _cost(problem, trial, limit)
                accepted, damping = judged(cost, next_cost, damping)
                if accepted:
                    settled = cost - next_cost < _SETTLED * max(cost, 1.0)
                    room, cost = trial, next_cost
                    break
            else:
                damping = raised(damping)
        taken += 1
        if not accepted:
            break
        system = _system(problem, room, limit)
        if settled:
            break
    return Solution(room, system.residual, system.raw, system.weight, cost, system.normal, taken)


def shared_covariance(problem: Problem, solution: Solution) -> Floats:
    """Return the covariance of the unknowns that all windows share, whose noise is of unit variance, (n, n)."""
    count = problem.size - problem.shared_at
    if not count:
        return np.zeros((0, 0))
    factor = _factored(solution.normal, 0.0, solution.normal.diagonal())
    if factor is None:
        return np.full((count, count), np.inf)
    unit = np.zeros((problem.size, count))
    unit[problem.shared_at :] = np.eye(count)
    out: Floats = factor.solve(unit)[problem.shared_at :]
    return (out + out.T) / 2


def degrees_of_freedom(problem: Problem, solution: Solution) -> float:
    """Return the number of rows that count, by their weights, less that of the unknowns that they decide."""
    return float(np.sum(solution.weight)) - problem.size


class _System(NamedTuple):
    """Normal equations at a room."""

    normal: sparse.csc_array
    slope: Floats
    residual: Floats
    raw: Floats
    weight: Floats


def _system(problem: Problem, room: Room, limit: float) -> _System:
    raw, matrix = problem.linearise(room)
    residual, white = problem.whitening @ raw, problem.whitening @ matrix
    weight = 1 / (1 + (residual / limit) ** 2)
    known, prior = problem.priors(room)
    weighted = sparse.diags_array(weight) @ white
    normal = (weighted.T @ white + prior.T @ prior).tocsc()
    slope = weighted.T @ residual + prior.T @ known
    return _System(normal, slope, residual, raw, weight)


def _cost(problem: Problem, room: Room, limit: float) -> float:
    residual = problem.whitening @ problem.residuals(room)
    known, _ = problem.priors(room)
    return float(np.sum(limit**2 * np.log1p((residual / limit) ** 2)) + known @ known)


def _factored(normal: sparse.csc_array, damping: float, diagonal: Floats) -> SuperLU | None:
    """Return the factor of the damped normal matrix, None if it is singular."""
    try:
        damped = normal + sparse.diags_array(damping * diagonal + _FLOOR * (1 + diagonal))
        return splu(damped.tocsc(), options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    except RuntimeError:
        return None
