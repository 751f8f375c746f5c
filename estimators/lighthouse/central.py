"""All craft in one least squares, as a central computer would solve it, with the sweep's rotor errors as unknowns.

A sweep angle errs by s (sqrt(rho) e_fan + sqrt(1 - rho) n), source 1 (19): e_fan is one draw per fan and sweep for the
whole swarm, n one per angle. A craft alone cannot tell e_fan from its own pose; a computer that gets every craft's
angles can try. With eps_fan = s sqrt(rho) e_fan it minimises, over the poses of C craft and eps = (eps_x, eps_y),

    F = sum_c sum_i (W f_ci - eps_fan)^2 + kappa sum_fan eps_fan^2,   kappa = (1 - rho) / rho

where W f is the angle residual of `estimators.lighthouse.pnp` and kappa makes the prior variance of eps be rho s^2.
With J_c the rows W df/dx of a craft, a Gauss-Newton step is the arrow of `estimators.lighthouse.arrow` with A_c = J_c^T
J_c, B_c = -(the sums of J_c's rows of each fan), D = the number of angles of each fan, plus kappa. For unit s,

    Cov(x_c) = (1 - rho) (A_c^-1 + Y_c S^-1 Y_c^T),   Cov(eps) = (1 - rho) S^-1

The first term alone is what would be left were the rotor errors known: no central computer does better in one period.
Frames and errors as in `estimators.lighthouse.pnp`: left, active, (attitude, position), lighthouse frame.
"""

from typing import NamedTuple

import numpy as np

from estimators import levenberg_marquardt as lm
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.arrow import Arrow, covariances_into, eliminate, empty
from estimators.lighthouse.pnp import FEWEST_LIT, ITERATIONS_MAX
from estimators.lighthouse.projection import (
    COLUMNS,
    VALUE,
    WEIGHT,
    angle_weights,
    checked,
    checked_lit,
    gather_measured,
    project,
    projections,
    spans_plane,
)
from estimators.rotation import exp_into, multiply_into


class CentralSolution(NamedTuple):
    """Poses of C craft in one period, solved together; NaN where a craft took no part or nothing converged.

    rotation: (C, 3, 3) R_l_b at the epoch. position: (C, 3) [m]. solved: (C,). iterations: of the joint problem.
    rotor_error_rad: (2,), eps of fans X and Y. covariance: (C, 6, 6) for unit angle noise; covariance_rotor_known: the
    same, were eps known. rotor_covariance: (2, 2), of eps, for unit angle noise. cost: F [rad^2].
    """

    rotation: Floats
    position: Floats
    solved: Bools
    iterations: int
    rotor_error_rad: Floats
    covariance: Floats
    covariance_rotor_known: Floats
    rotor_covariance: Floats
    cost: float


@kernel
def _linearise(
    table: Floats,
    count: Ints,
    rotation: Floats,
    position: Floats,
    shared: Floats,
    kappa: float,
    out: Arrow,
) -> float:
    """Return F [rad^2], or inf where a photodiode is behind the lighthouse; fill `out`. shared: (2,), eps.

    table: (C, 2 K, COLUMNS), every craft's angles as `gather` has them; count: (C,) photodiodes, 0: takes no part.
    """
    normal, border, gradient, corner, slope = out
    row = np.empty(6)
    cost = 0.0
    for fan in range(2):
        corner[fan], slope[fan] = kappa, kappa * shared[fan]
        cost += kappa * shared[fan] ** 2
    for c in range(len(count)):
        normal[c], border[c], gradient[c] = 0.0, 0.0, 0.0
        for fan in range(2):
            row[:] = 0.0
            for i in range(fan * count[c], (fan + 1) * count[c]):
                value, z, over, r0, r1, r2 = project(table[c], i, rotation[c], position[c, fan], position[c, 2])
                if not z > 0:
                    return np.inf
                residual = table[c, i, WEIGHT] * (value - table[c, i, VALUE]) - shared[fan]
                g = table[c, i, WEIGHT] * over
                cost += residual * residual
                corner[fan] += 1.0
                slope[fan] -= residual
                row[0], row[1], row[2], row[3 + fan], row[5] = g * r0, g * r1, g * r2, g, -g * value
                for a in range(6):
                    gradient[c, a] += row[a] * residual
                    border[c, a, fan] -= row[a]
                    for b in range(6):
                        normal[c, a, b] += row[a] * row[b]
    return cost


@kernel
def _solve(
    table: Floats,
    count: Ints,
    takes_part: Bools,
    rotation: Floats,
    position: Floats,
    shared: Floats,
    kappa: float,
    shares: bool,
    arrow: Arrow,
    trial: Arrow,
) -> tuple[bool, int, float]:
    """Levenberg-Marquardt; `rotation`, `position`, `shared` hold the start, then the answer. (converged, solves, F)."""
    craft = rotation.shape[0]
    step, spread, schur = np.zeros((craft + 1, 6)), np.zeros((craft, 6, 2)), np.zeros((2, 2))
    turned, next_rotation, next_position = np.empty((3, 3)), rotation.copy(), position.copy()
    next_shared = np.zeros(2)
    damping = 0.0
    cost = _linearise(table, count, rotation, position, shared, kappa, arrow)
    if not np.isfinite(cost):
        return False, 0, np.nan
    for iteration in range(1, ITERATIONS_MAX + 1):
        if not eliminate(arrow, takes_part, damping, shares, step, spread, schur):
            damping = lm.raised(damping)
            continue
        largest = 0.0
        for c in range(craft):
            if not takes_part[c]:
                continue
            exp_into(step[c, :3], turned)
            multiply_into(turned, rotation[c], next_rotation[c])
            for k in range(3):
                next_position[c, k] = position[c, k] + step[c, 3 + k]
            for a in range(6):
                largest = max(largest, abs(step[c, a]))
        for fan in range(2):
            next_shared[fan] = shared[fan] + step[craft, fan]
        next_cost = _linearise(table, count, next_rotation, next_position, next_shared, kappa, trial)
        converged = largest < lm.STEP_SMALL and damping < lm.FIRST_DAMPING
        accepted, damping = lm.judged(cost, next_cost, damping)
        if accepted:
            cost = next_cost
            rotation[:], position[:], shared[:] = next_rotation, next_position, next_shared
            arrow, trial = trial, arrow
            if converged:
                return True, iteration, cost
    return False, ITERATIONS_MAX, np.nan


@kernel
def _gather_all(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    takes_part: Bools,
    table: Floats,
    count: Ints,
) -> None:
    """Fill `table` and `count`; clear `takes_part` (C,) where a craft's photodiodes do not determine its pose."""
    for c in range(len(lit)):
        if not takes_part[c]:
            continue
        n = gather_measured(uv[c], weight[c], lit[c], point[c], offset[c], angular_rate[c], velocity[c], table[c])
        takes_part[c] = n >= FEWEST_LIT and spans_plane(lit[c], point[c])
        count[c] = n if takes_part[c] else 0


class _Gathered(NamedTuple):
    """Tables of angles (C, 2 K, COLUMNS), photodiodes (C,) in them, and the craft (C,) that take part."""

    table: Floats
    photodiodes: Ints
    takes_part: Bools


def _gathered(
    theta: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats, mask: Bools
) -> _Gathered:
    """Check the arguments of `solve` and gather the angles of every craft."""
    lit = checked_lit(lit)
    craft, photodiodes = lit.shape
    angles = (craft, photodiodes, 2)
    uv = projections(checked("theta", theta, angles))
    out = _Gathered(
        np.empty((craft, 2 * photodiodes, COLUMNS)),
        np.zeros(craft, dtype=np.int64),
        checked_lit(mask, (craft,)).copy(),
    )
    _gather_all(
        uv,
        angle_weights(uv),
        lit,
        checked("point_m", point_m, (craft, photodiodes, 3)),
        checked("offset_s", offset_s, angles),
        checked("angular_rate", angular_rate, (craft, 3)),
        checked("velocity", velocity, (craft, 3)),
        out.takes_part,
        out.table,
        out.photodiodes,
    )
    return out


def solve(
    theta: Floats,
    lit: Bools,
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
    rotor_correlation: float,
    mask: Bools,
) -> CentralSolution:
    """Solve the poses of C craft and the period's two rotor errors together, from starts near the answer.

    Args:
        theta: (C, K, 2) [rad], fans X and Y; ignored, NaN allowed, where not lit.
        lit: (C, K), both fans seen.
        point_m: (C, K, 3) [m], photodiodes in the body frame.
        rotation: (C, 3, 3), start R_l_b.
        position: (C, 3) [m], start, lighthouse frame.
        offset_s: (C, K, 2) [s], each angle's instant minus the epoch.
        angular_rate: (C, 3) [rad/s], assumed within the period, lighthouse frame.
        velocity: (C, 3) [m/s], likewise.
        rotor_correlation: rho of (19), in [0, 1); 0: nothing is shared, and the craft are solved side by side.
        mask: (C,), the craft that take part; those whose lit photodiodes leave their pose open do not.

    Raises:
        ValueError: an array's shape does not fit `lit`, or rho is outside [0, 1); the message names the argument.
    """
    if not 0 <= rotor_correlation < 1:
        raise ValueError(f"rotor_correlation is {rotor_correlation}, outside [0, 1)")
    gathered = _gathered(theta, lit, point_m, offset_s, angular_rate, velocity, mask)
    takes_part, craft = gathered.takes_part, len(gathered.takes_part)
    # Copies: the kernel works in place, and the starts belong to the caller.
    rotation = checked("rotation", rotation, (craft, 3, 3)).copy()
    position = checked("position", position, (craft, 3)).copy()
    shared, shares = np.zeros(2), rotor_correlation > 0
    kappa = (1 - rotor_correlation) / rotor_correlation if shares else 0.0
    arrow, trial, converged, iterations, cost = empty(craft), empty(craft), False, 0, np.nan
    if takes_part.any():
        converged, iterations, cost = _solve(
            gathered.table, gathered.photodiodes, takes_part, rotation, position, shared, kappa, shares, arrow, trial
        )
    covariance, known = np.full((2, craft, 6, 6), np.nan)
    shared_covariance = np.zeros((2, 2))
    if converged:
        _linearise(gathered.table, gathered.photodiodes, rotation, position, shared, kappa, arrow)
        covariances_into(arrow, takes_part, rotor_correlation, covariance, known, shared_covariance)
    solved = takes_part & converged
    return CentralSolution(
        rotation=np.where(solved[:, None, None], rotation, np.nan),
        position=np.where(solved[:, None], position, np.nan),
        solved=solved,
        iterations=iterations,
        rotor_error_rad=shared if converged else np.full(2, np.nan),
        covariance=covariance,
        covariance_rotor_known=known,
        rotor_covariance=shared_covariance if converged else np.full((2, 2), np.nan),
        cost=cost,
    )
