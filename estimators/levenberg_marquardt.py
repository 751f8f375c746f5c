"""The damping of Levenberg-Marquardt, one policy for every least squares in this package.

A step solves (N + damping diag(N)) step = -gradient with the normal matrix N (Marquardt's scaling). Damping is 0 at
first, which is Gauss-Newton. It rises tenfold, at least to `FIRST_DAMPING`, when a step fails, and falls tenfold when
a step is accepted, to 0 below the square of that. A step that damping made small proves nothing: convergence asks for
less than `FIRST_DAMPING`.
"""

import numpy as np

from estimators.kernel import kernel
from estimators.lanes import select

FIRST_DAMPING = 1e-3
"""Damping after the first failed step, relative to the diagonal of the normal matrix."""

ROUNDING = 1e-15
"""Rounding of the cost relative to the root of the cost: residuals are differences of numbers near 1."""

STEP_SMALL = 1e-7
"""A search has converged where it has less than this to go in attitude [rad] and in position [m]."""


RISE = 8.0
"""Times that the next step may shrink less than the last one did: what shrinks fast is gone first."""


@kernel
def ends(turn: float, way: float, turn_before: float, way_before: float) -> bool:
    """Return whether a step leaves less than `STEP_SMALL` to go, of numbers or of lanes.

    Near the minimum every step of Gauss-Newton is shorter than the one before by about that factor by which residuals
    are smaller than what they are measured on; the slower one of attitude and position tells it of both. The search
    ends if the step is small, or if the next one would be, though it shrinks `RISE` times less. Squared lengths of
    steps:

    Args:
        turn: by attitude [rad^2].
        way: by position [m^2].
        turn_before: of the step before, zero if there is none to compare with: a damped one shrinks by damping.
        way_before: likewise.
    """
    small, most = STEP_SMALL**2, RISE**2 * max(turn, way)
    out: bool = ((turn < small) & (way < small)) | (
        (turn * most < small * turn_before) & (way * most < small * way_before)
    )
    return out


@kernel
def raised(damping: float) -> float:
    """Return the damping after a step that failed or could not be solved, of numbers or of lanes."""
    return max(10 * damping, FIRST_DAMPING)


@kernel
def fallen(damping: float) -> float:
    """Return the damping after a step that was accepted, of numbers or of lanes."""
    return select(damping > FIRST_DAMPING**2, 0.1 * damping, 0.0)


@kernel
def lowered(cost: float, next_cost: float) -> bool:
    """Return whether a step is accepted, of numbers or of lanes.

    Near the minimum the gain of a step drowns in the rounding of the residuals: the step is accepted none the less.

    Args:
        cost: sum of squared residuals before the step.
        next_cost: the same after it; inf where the step leaves the domain.
    """
    out: bool = next_cost <= cost + ROUNDING * np.sqrt(cost)
    return out


@kernel
def judged(cost: float, next_cost: float, damping: float) -> tuple[bool, float]:
    """Return whether a step from `cost` to `next_cost` is accepted (`lowered`), and the damping of the next step.

    Args:
        cost: sum of squared residuals before the step.
        next_cost: the same after it; inf where the step leaves the domain.
        damping: the step's.
    """
    if lowered(cost, next_cost):
        return True, fallen(damping)
    return False, raised(damping)
