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

from estimators import levenberg_marquardt as lm
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.projection import (
    COLUMNS,
    VALUE,
    WEIGHT,
    add_curvature,
    angle_weights,
    checked,
    checked_lit,
    gather_measured,
    project,
    projections,
    spans_plane,
)
from estimators.linear import solve_spd
from estimators.rotation import exp_into, multiply_into

FEWEST_LIT = 4
"""Photodiodes that a pose needs: three leave up to four poses (P3P)."""

ITERATIONS_MAX = 30
STEPS_PLAIN = 4
"""Undamped Gauss-Newton steps before the residuals' curvature is asked for help."""


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


GRADIENT, SCALE = 6, 7
"""Rows below the matrix, in what a Newton step needs (8, 6): J^T W^2 f, and the diagonal of J^T W^2 J."""


@kernel
def _evaluate(table: Floats, n: int, rotation: Floats, position: Floats, curved: bool, out: Floats, at: int) -> float:
    """Return F of (6), or inf if a photodiode is behind; write 8 rows of `out` (., 6) from `at` on: the lower
    triangle of a matrix, and two rows.

    The matrix is J^T W^2 J of (11, 12), or where `curved` the Hessian of F / 2, which adds sum W^2 f d2f. A row of J
    has no derivative by the other fan's coordinate: what is zero is not added up.
    """
    for k in range(8):
        for m in range(6):
            out[at + k, m] = 0.0
    cost = 0.0
    for fan in range(2):
        m00 = m10 = m11 = m20 = m21 = m22 = 0.0
        across0 = across1 = across2 = ahead0 = ahead1 = ahead2 = 0.0
        across_across = across_ahead = ahead_ahead = 0.0
        b0 = b1 = b2 = b_across = b_ahead = 0.0
        for row in range(fan * n, fan * n + n):
            value, ahead, r0, r1, r2, g, gz = project(table, row, rotation, position[fan], position[2])
            if not ahead > 0:
                return np.inf
            w = table[row, WEIGHT]
            f = value - table[row, VALUE]
            w0, w1, w2, wg, wz, wf = w * r0, w * r1, w * r2, w * g, w * gz, w * f
            cost += wf * f
            m00 += w0 * r0
            m10 += w1 * r0
            m11 += w1 * r1
            m20 += w2 * r0
            m21 += w2 * r1
            m22 += w2 * r2
            across0 += w0 * g
            across1 += w1 * g
            across2 += w2 * g
            ahead0 += w0 * gz
            ahead1 += w1 * gz
            ahead2 += w2 * gz
            across_across += wg * g
            across_ahead += wg * gz
            ahead_ahead += wz * gz
            b0 += wf * r0
            b1 += wf * r1
            b2 += wf * r2
            b_across += wf * g
            b_ahead += wf * gz
        a = 3 + fan
        out[at + 0, 0] += m00
        out[at + 1, 0] += m10
        out[at + 1, 1] += m11
        out[at + 2, 0] += m20
        out[at + 2, 1] += m21
        out[at + 2, 2] += m22
        out[at + a, 0] += across0
        out[at + a, 1] += across1
        out[at + a, 2] += across2
        out[at + a, a] += across_across
        out[at + 5, 0] += ahead0
        out[at + 5, 1] += ahead1
        out[at + 5, 2] += ahead2
        out[at + 5, a] += across_ahead
        out[at + 5, 5] += ahead_ahead
        out[at + GRADIENT, 0] += b0
        out[at + GRADIENT, 1] += b1
        out[at + GRADIENT, 2] += b2
        out[at + GRADIENT, a] += b_across
        out[at + GRADIENT, 5] += b_ahead
    for k in range(6):
        out[at + SCALE, k] = out[at + k, k]
    if curved:
        for fan in range(2):
            for row in range(fan * n, fan * n + n):
                pose = rotation, position[fan], position[2]
                residual = project(table, row, *pose)[0] - table[row, VALUE]
                add_curvature(table, row, fan, *pose, table[row, WEIGHT] * residual, out[at : at + 6])
    return cost


@kernel
def _take(next_rotation: Floats, next_position: Floats, rotation: Floats, position: Floats) -> None:
    """Overwrite a pose by the next one."""
    for i in range(3):
        position[i] = next_position[i]
        for j in range(3):
            rotation[i, j] = next_rotation[i, j]


@kernel
def _refine_one(
    table: Floats, n: int, rotation: Floats, position: Floats, iterations_max: int, work: Floats
) -> tuple[bool, int, float]:
    """Levenberg-Marquardt from `rotation` (3, 3), `position` (3,), overwritten; (converged, linear solves, F).

    The first steps are Gauss-Newton without damping: warm starts need no more. Once one fails to lower the cost or puts
    a photodiode behind the lighthouse, steps are damped; from then on, or after STEPS_PLAIN, the residuals' curvature
    is used too (Newton): a plane that faces the lighthouse has its mirror minima so near to their ridge that J alone
    takes hundreds of steps. work: scratch (34, 6).
    """
    damped, lower, step = work[16:22], work[22:28], work[33]
    # Both contiguous, as `rotation` is: then what is called with them is compiled once.
    scratch = work[28:31].reshape(2, 3, 3)
    turned, next_rotation, next_position = scratch[0], scratch[1], work[31, :3]
    here, damping, curved = 0, 0.0, False
    cost = _evaluate(table, n, rotation, position, curved, work, 0)
    if not np.isfinite(cost):
        return False, 0, np.nan
    for iteration in range(1, iterations_max + 1):
        for a in range(6):
            for b in range(a + 1):
                damped[a, b] = work[here + a, b]
            damped[a, a] += damping * work[here + SCALE, a]
            step[a] = -work[here + GRADIENT, a]
        if not solve_spd(damped, lower, step):
            damping = lm.raised(damping)
            continue
        exp_into(step[:3], turned)
        multiply_into(turned, rotation, next_rotation)
        for k in range(3):
            next_position[k] = position[k] + step[3 + k]
        small = (
            step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < lm.STEP_SMALL**2
            and step[3] ** 2 + step[4] ** 2 + step[5] ** 2 < lm.STEP_SMALL**2
        )
        if small and damping < lm.FIRST_DAMPING:
            _take(next_rotation, next_position, rotation, position)
            # To second order in the step F changes by the product of gradient and step.
            for a in range(6):
                cost += work[here + GRADIENT, a] * step[a]
            return True, iteration, max(cost, 0.0)
        next_cost = _evaluate(table, n, next_rotation, next_position, curved, work, 8 - here)
        accepted, damping = lm.judged(cost, next_cost, damping)
        if accepted:
            cost = next_cost
            _take(next_rotation, next_position, rotation, position)
            here = 8 - here
        if not curved and (damping > 0 or iteration == STEPS_PLAIN):
            curved = True
            _evaluate(table, n, rotation, position, curved, work, here)
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
    table, work = np.empty((2 * uv.shape[1], COLUMNS)), np.zeros((34, 6))
    for c in range(uv.shape[0]):
        solved[c], iterations[c], cost[c], residual[c] = False, 0, np.nan, np.nan
        n = 0
        if spans_plane(lit[c], point[c]):
            n = gather_measured(uv[c], weight[c], lit[c], point[c], offset[c], angular_rate[c], velocity[c], table)
        if n >= FEWEST_LIT:
            solved[c], iterations[c], cost[c] = _refine_one(table, n, rotation[c], position[c], iterations_max, work)
        if solved[c]:
            residual[c] = np.sqrt(cost[c] / (2 * n))
        else:
            rotation[c] = np.nan
            position[c] = np.nan
            cost[c] = np.nan


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
    """Solve the poses of C craft from projections.

    Args:
        uv: (C, K, 2), (x/z, y/z); ignored, NaN allowed, where not lit.
        weight: (C, K, 2), each one's inverse noise in any unit: cost and residual_rad are in that unit of noise
            (radians
            for the weights (13) of sweep angles).
        lit: (C, K).
        point_m: (C, K, 3) [m], photodiodes in the body frame.
        rotation: (C, 3, 3), start R_l_b.
        position: (C, 3) [m], start.
        offset_s: (C, K, 2) [s], each instant minus the epoch.
        angular_rate: (C, 3) [rad/s], assumed.
        velocity: (C, 3) [m/s], assumed.
        iterations_max: linear solves at most.

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
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
    """Solve the poses of C craft at the epoch from sweep angles, by Levenberg-Marquardt on (7) from a start near the
    answer.

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
