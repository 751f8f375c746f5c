"""Pose from sweep angles: Levenberg-Marquardt on the reprojection error, source 1 (6) to (12).

With p_i = (x, y, z) = R w_p_i + t (3), R = R_l_b and t in the lighthouse frame, the residuals of photodiode i are

    f_i = (x/z - cot theta_x, y/z - cot theta_y),   F = sum |W_i f_i|^2                  (6, 7)
    W_i = diag(sin^2 theta_x, sin^2 theta_y), which is (13) at the measured angle

Source 1 leaves W out. W f is the angle residual to first order, and it is the angles that have equal noise: without W
the position is up to twice as uncertain as its Cramer-Rao bound 60 deg off boresight and 0.1 % to 0.7 % within 20 deg;
with it the excess is 0.1 % in the whole field (3 % for the worst of 3000 random poses at 1 m to 3 m), and (18) holds.

Only (u, v) = (cot theta_x, cot theta_y) and W enter, so that a pinhole camera's u = x/f with W = I serves as well:
`refine_projections`. Every angle has its own instant tau after the epoch, for which the craft's assumed motion moves
the photodiode: p_i(tau) = Exp([w]x tau) R w_p_i + t + v tau, w and v in the lighthouse frame.

The attitude is updated from the left, R <- Exp([d]x) R, so that dp_i/dd = -[p_i - t]x at tau = 0. Source 1 writes the
same derivative as (8), dp_i/dphi = [p_i - t]x J_r(phi), in its passive vector phi, R = exp(-[phi]x): a change dphi
turns the craft by d = -J_r(phi) dphi (9, 21), and the chain rule makes the two equal (tested). The local form has
no singular attitude. Where first derivatives converge too slowly, second ones join in (`_refine_one`).
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.linear import cholesky_into, solve_cholesky
from estimators.projection import (
    add_curvature,
    angle_weights,
    arm_into,
    checked,
    checked_lit,
    project_into,
    projections,
    spans_plane,
    turns_into,
)
from estimators.rotation import exp_into, multiply_into

FEWEST_LIT = 4
"""Photodiodes that a pose needs: three leave up to four poses (P3P)."""

ITERATIONS_MAX = 30
STEP_SMALL = 1e-7
"""A last step below this in attitude [rad] and in position [m] is convergence."""

STEPS_PLAIN = 4
"""Undamped Gauss-Newton steps before the residuals' curvature is asked for help."""

DAMPING_FIRST = 1e-3
"""First damping after a step that did not lower the cost, against the normal matrix's diagonal (Marquardt)."""


ROUNDING = 1e-15
"""Rounding of the cost is some 1e-15 of the size of the residuals (each one the difference of numbers near 1)."""


class PoseSolution(NamedTuple):
    """Poses of C craft at the epoch; NaN where `solved` is False.

    rotation: (C, 3, 3) R_l_b. position: (C, 3) [m], lighthouse frame. solved: (C,) converged, finite, not collinear,
    every lit photodiode in front (z > 0), at least 4 lit. iterations: (C,) linear solves, 0 where not attempted.
    residual_rad: (C,) RMS of the angle residuals W f over the 2 n angles. cost: (C,) their sum of squares F [rad^2].
    """

    rotation: Floats
    position: Floats
    solved: Bools
    iterations: Ints
    residual_rad: Floats
    cost: Floats


@kernel
def _evaluate(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    rotation: Floats,
    position: Floats,
    turn: Floats,
    offset: Floats,
    velocity: Floats,
    curved: bool,
    normal: Floats,
    scale: Floats,
    gradient: Floats,
) -> float:
    """F of (6), or inf if a photodiode is behind; writes `normal` (6, 6), `scale` (6,) and `gradient` (6,).

    normal: J^T W^2 J of (11, 12), or where `curved` the Hessian of F / 2, which adds sum W^2 f d2f. scale: the diagonal
    of J^T W^2 J. gradient: J^T W^2 f.
    """
    normal[:] = 0.0
    scale[:] = 0.0
    gradient[:] = 0.0
    row, arm = np.empty(6), np.empty(3)
    cost = 0.0
    for i in range(uv.shape[0]):
        if not lit[i]:
            continue
        arm_into(rotation, point[i], arm)
        for fan in range(2):
            value, z = project_into(fan, arm, turn[i, fan], position, velocity, offset[i, fan], row)
            if not z > 0:
                return np.inf
            w = weight[i, fan] * weight[i, fan]
            f = value - uv[i, fan]
            cost += w * f * f
            for a in range(6):
                gradient[a] += w * row[a] * f
                scale[a] += w * row[a] * row[a]
                for b in range(a + 1):
                    normal[a, b] += w * row[a] * row[b]
            if curved:
                add_curvature(fan, arm, turn[i, fan], row, value, z, w * f, normal)
    for a in range(6):
        for b in range(a):
            normal[b, a] = normal[a, b]
    return cost


@kernel
def _refine_one(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    rotation: Floats,
    position: Floats,
    turn: Floats,
    offset: Floats,
    velocity: Floats,
    iterations_max: int,
) -> tuple[bool, int, float]:
    """Levenberg-Marquardt from `rotation` (3, 3), `position` (3,), overwritten; (converged, linear solves, F).

    The first steps are Gauss-Newton without damping: warm starts need no more. Once one fails to lower the cost or puts
    a photodiode behind the lighthouse, steps are damped; from then on, or after STEPS_PLAIN, the residuals' curvature
    is used too (Newton): a plane that faces the lighthouse has its mirror minima so near to their ridge that J alone
    takes hundreds of steps.
    """
    normal, scale, gradient = np.empty((6, 6)), np.empty(6), np.empty(6)
    next_normal, next_scale, next_gradient = np.empty((6, 6)), np.empty(6), np.empty(6)
    damped, lower, step = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    turned, next_rotation, next_position = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    seen = (uv, weight, lit, point)
    motion = (turn, offset, velocity)
    damping, curved = 0.0, False
    cost = _evaluate(*seen, rotation, position, *motion, curved, normal, scale, gradient)
    if not np.isfinite(cost):
        return False, 0, np.nan
    for iteration in range(1, iterations_max + 1):
        damped[:] = normal
        for a in range(6):
            damped[a, a] += damping * scale[a]
            step[a] = -gradient[a]
        if not cholesky_into(damped, lower):
            damping = max(10 * damping, DAMPING_FIRST)
            continue
        solve_cholesky(lower, step)
        exp_into(step[:3], turned)
        multiply_into(turned, rotation, next_rotation)
        for k in range(3):
            next_position[k] = position[k] + step[3 + k]
        small = (
            step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < STEP_SMALL**2
            and step[3] ** 2 + step[4] ** 2 + step[5] ** 2 < STEP_SMALL**2
        )
        next_cost = _evaluate(
            *seen, next_rotation, next_position, *motion, curved, next_normal, next_scale, next_gradient
        )
        # Near the minimum a step's gain drowns in the rounding of the residuals, 1e-16 each: it is taken none the less.
        if next_cost <= cost + ROUNDING * np.sqrt(cost):
            cost = next_cost
            rotation[:] = next_rotation
            position[:] = next_position
            normal, next_normal = next_normal, normal
            scale, next_scale = next_scale, scale
            gradient, next_gradient = next_gradient, gradient
            # A step that damping made small proves nothing.
            if small and damping < DAMPING_FIRST:
                return True, iteration, cost
            damping = 0.1 * damping if damping > DAMPING_FIRST**2 else 0.0
        else:
            damping = max(10 * damping, DAMPING_FIRST)
        if not curved and (damping > 0 or iteration == STEPS_PLAIN):
            curved = True
            _evaluate(*seen, rotation, position, *motion, curved, normal, scale, gradient)
    return False, iterations_max, np.nan


@kernel
def _refine_all(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point: Floats,
    rotation: Floats,
    position: Floats,
    offset: Floats,
    angular_rate: Floats,
    velocity: Floats,
    iterations_max: int,
    solved: Bools,
    iterations: Ints,
    residual: Floats,
    cost: Floats,
) -> None:
    """`_refine_one` for every craft: `rotation` and `position` hold the starts, then the answers or NaN."""
    turn = np.empty((uv.shape[1], 2, 3, 3))
    for c in range(uv.shape[0]):
        count, usable = 0, True
        for i in range(uv.shape[1]):
            if lit[c, i]:
                count += 1
                for fan in range(2):
                    usable = usable and np.isfinite(weight[c, i, fan] * uv[c, i, fan])
        solved[c], iterations[c], cost[c] = False, 0, np.nan
        if usable and count >= FEWEST_LIT and spans_plane(lit[c], point[c]):
            turns_into(offset[c], angular_rate[c], turn)
            solved[c], iterations[c], cost[c] = _refine_one(
                uv[c],
                weight[c],
                lit[c],
                point[c],
                rotation[c],
                position[c],
                turn,
                offset[c],
                velocity[c],
                iterations_max,
            )
        residual[c] = np.sqrt(cost[c] / (2 * count))
        if not solved[c]:
            rotation[c] = np.nan
            position[c] = np.nan
            cost[c] = np.nan
            residual[c] = np.nan


def refine_projections(
    uv: Floats,
    weight: Floats,
    lit: Bools,
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
    iterations_max: int = ITERATIONS_MAX,
) -> PoseSolution:
    """Poses of C craft from projections.

    uv: (C, K, 2), (x/z, y/z). weight: (C, K, 2), each one's inverse noise, in any unit: cost and residual_rad are in
    that unit of noise (radians for the weights (13) of sweep angles). The rest, and what is raised, as in `refine`.
    """
    lit = checked_lit(lit)
    craft, photodiodes = lit.shape
    angles = (craft, photodiodes, 2)
    # Copies: the kernel works in place, and the starts belong to the caller.
    rotation = checked("rotation", rotation, (craft, 3, 3)).copy()
    position = checked("position", position, (craft, 3)).copy()
    solved, iterations = np.zeros(craft, dtype=np.bool_), np.zeros(craft, dtype=np.int64)
    residual, cost = np.empty(craft), np.empty(craft)
    _refine_all(
        checked("uv", uv, angles),
        checked("weight", weight, angles),
        lit,
        checked("point_m", point_m, (craft, photodiodes, 3)),
        rotation,
        position,
        checked("offset_s", offset_s, angles),
        checked("angular_rate", angular_rate, (craft, 3)),
        checked("velocity", velocity, (craft, 3)),
        iterations_max,
        solved,
        iterations,
        residual,
        cost,
    )
    return PoseSolution(rotation, position, solved, iterations, residual, cost)


def refine(
    theta: Floats,
    lit: Bools,
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
) -> PoseSolution:
    """Poses of C craft at the epoch from sweep angles, by Levenberg-Marquardt on (7) from a start near the answer.

    Args:
        theta: (C, K, 2) [rad], fans X and Y; ignored, NaN allowed, where not lit.
        lit: (C, K), both fans seen.
        point_m: (C, K, 3) [m], photodiodes in the body frame.
        rotation: (C, 3, 3), start R_l_b.
        position: (C, 3) [m], start, lighthouse frame.
        offset_s: (C, K, 2) [s], each angle's instant minus the epoch.
        angular_rate: (C, 3) [rad/s], assumed within the period, lighthouse frame.
        velocity: (C, 3) [m/s], likewise.

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
    """
    lit = checked_lit(lit)
    theta = checked("theta", theta, (*lit.shape, 2))
    uv = projections(theta)
    motion = offset_s, angular_rate, velocity
    return refine_projections(uv, angle_weights(uv), lit, point_m, rotation, position, *motion)
