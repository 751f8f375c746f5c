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
no singular attitude. Where first derivatives converge too slowly, second ones join in (`refine_one`).

Several craft are solved side by side, with the bits that each would have alone (`estimators.lanes`).
"""

from typing import NamedTuple

import numpy as np

from estimators import levenberg_marquardt as lm
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import WIDE, all_of, any_of, lane, opposite, select, wide_in
from estimators.lighthouse.dop import (
    Dilution,
    Places,
    checked_correlation,
    no_precision,
    places_for,
    precision_into,
)
from estimators.lighthouse.projection import (
    VALUE,
    WEIGHT,
    add_curvature,
    checked,
    checked_lit,
    project,
    project_all,
    projections,
    row_of,
    table_spans_plane,
    turned_by,
    write_row,
)
from estimators.lighthouse.side_by_side import (
    Given,
    Room,
    gather_craft,
    gather_measured_lanes,
    given,
    in_order,
    room_for,
    taken,
)
from estimators.linear import solve_spd
from estimators.rotation import exp_into, multiply_into
from estimators.scratch import scratch

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


_NOWHERE = places_for(0)
"""Places for no precision."""
GRADIENT, SCALE = 6, 7
"""Rows below the matrix, in what a Newton step needs (8, 6): J^T W^2 f, and the diagonal of J^T W^2 J."""


@kernel
def _evaluate(table: Floats, n: int, rotation: Floats, position: Floats, out: Floats) -> float:
    """Return F of (6), or inf if a photodiode is behind; write W J into the table, and `out` (8, 6): the lower triangle
    of a matrix, and two rows. Of numbers or of lanes.

    The matrix is J^T W^2 J of (11, 12). A row of W J has no derivative by the other fan's coordinate: what is zero is
    not added up.
    """
    cost, front = 0.0, project_all(table, n, rotation, position)
    m00 = m10 = m11 = m20 = m21 = m22 = mz0 = mz1 = mz2 = mzz = b0 = b1 = b2 = bz = 0.0
    for fan in range(2):
        mp0 = mp1 = mp2 = mpp = mzp = bp = 0.0
        for i in range(fan * n, fan * n + n):
            x, y, z, over, value = row_of(table, i)
            r0, r1, r2 = turned_by(table, i, x, y, z, value)
            w = table[i, WEIGHT]
            f, ap = w * (value - table[i, VALUE]), w * over
            a0, a1, a2, az = ap * r0, ap * r1, ap * r2, -value * ap
            write_row(table, i, a0, a1, a2, ap, az)
            cost += f * f
            m00 += a0 * a0
            m10 += a1 * a0
            m11 += a1 * a1
            m20 += a2 * a0
            m21 += a2 * a1
            m22 += a2 * a2
            mp0 += ap * a0
            mp1 += ap * a1
            mp2 += ap * a2
            mpp += ap * ap
            mz0 += az * a0
            mz1 += az * a1
            mz2 += az * a2
            mzp += az * ap
            mzz += az * az
            b0 += f * a0
            b1 += f * a1
            b2 += f * a2
            bp += f * ap
            bz += f * az
        p = 3 + fan
        out[p, 0], out[p, 1], out[p, 2], out[p, p] = mp0, mp1, mp2, mpp
        out[5, p], out[GRADIENT, p] = mzp, bp
    out[0, 0], out[1, 0], out[1, 1], out[2, 0], out[2, 1], out[2, 2] = m00, m10, m11, m20, m21, m22
    out[4, 3], out[5, 0], out[5, 1], out[5, 2], out[5, 5] = 0.0, mz0, mz1, mz2, mzz
    out[GRADIENT, 0], out[GRADIENT, 1], out[GRADIENT, 2], out[GRADIENT, 5] = b0, b1, b2, bz
    for k in range(6):
        out[SCALE, k] = out[k, k]
    return select(front, cost, np.inf)


@kernel
def _add_curvatures(table: Floats, n: int, rotation: Floats, position: Floats, mask: bool, out: Floats) -> None:
    """Add sum W^2 f d2f to the lower triangle of a matrix (6, 6) where the mask says so: it becomes F's Hessian / 2."""
    for fan in range(2):
        for row in range(fan * n, fan * n + n):
            pose = rotation, position[fan], position[2]
            residual, w = project(table, row, *pose)[0] - table[row, VALUE], table[row, WEIGHT]
            add_curvature(table, row, fan, *pose, select(mask, w * w * residual, 0.0), out)


@kernel
def _take(mask: bool, next_rotation: Floats, next_position: Floats, rotation: Floats, position: Floats) -> None:
    """Overwrite a pose by the next one where the mask says so."""
    for i in range(3):
        position[i] = select(mask, next_position[i], position[i])
        for j in range(3):
            rotation[i, j] = select(mask, next_rotation[i, j], rotation[i, j])


@kernel
def refine_one(
    table: Floats, n: int, rotation: Floats, position: Floats, open_: bool, iterations_max: int
) -> tuple[bool, float, float]:
    """Levenberg-Marquardt from `rotation` (3, 3), `position` (3,), overwritten; (converged, linear solves, F). Of
    numbers, or of lanes: a lane that has come to an end stays as it is.

    The first steps are Gauss-Newton without damping: warm starts need no more. Once one fails to lower the cost or puts
    a photodiode behind the lighthouse, steps are damped; from then on, or after STEPS_PLAIN, the residuals' curvature
    is used too (Newton): a plane that faces the lighthouse has its mirror minima so near to their ridge that J alone
    takes hundreds of steps. The search ends where `levenberg_marquardt.ends` says so of attitude and position.

    Args:
        table: (., COLUMNS), angles; receives W J at the pose from which the last step leads to the answer.
        n: rows of each fan.
        rotation: (3, 3), the start.
        position: (3,) [m], the start.
        open_: whether there is a pose to solve.
        iterations_max: linear solves at most.
    """
    sums, damped, factor = scratch(table, 2, 8, 6), scratch(table, 6, 6), scratch(table, 6, 6)
    step, turned = scratch(table, 6), scratch(table, 3, 3)
    next_rotation, next_position = scratch(table, 3, 3), scratch(table, 3)
    end_rotation, end_position = scratch(table, 3, 3), scratch(table, 3)
    cost = _evaluate(table, n, rotation, position, sums[0])
    open_ = open_ & (cost < np.inf)
    at, damping, turn_before, way_before, curved = 0, 0.0, 0.0, 0.0, open_ & opposite(open_)
    solves = select(open_, iterations_max, 0)
    converged = curved
    for iteration in range(1, iterations_max + 1):
        if not any_of(open_):
            break
        here, there = sums[at], sums[1 - at]
        for a in range(6):
            for b in range(a + 1):
                damped[a, b] = here[a, b]
            damped[a, a] += damping * here[SCALE, a]
            step[a] = -here[GRADIENT, a]
        regular = open_ & solve_spd(damped, factor, step)
        exp_into(step[:3], turned)
        multiply_into(turned, rotation, next_rotation)
        for k in range(3):
            next_position[k] = position[k] + step[3 + k]
        turn = step[0] * step[0] + step[1] * step[1] + step[2] * step[2]
        way = step[3] * step[3] + step[4] * step[4] + step[5] * step[5]
        last = regular & lm.ends(turn, way, turn_before, way_before) & (damping < lm.FIRST_DAMPING)
        if any_of(last):
            _take(last, next_rotation, next_position, end_rotation, end_position)
            # To second order in the step F changes by the product of gradient and step.
            after = cost
            for a in range(6):
                after = after + here[GRADIENT, a] * step[a]
            cost, solves = select(last, max(after, 0.0), cost), select(last, iteration, solves)
            converged, open_ = converged | last, open_ & opposite(last)
            if not any_of(open_):
                break
            regular = regular & open_
        if not all_of(open_):  # whose rows are to stay
            _take(opposite(open_), rotation, position, next_rotation, next_position)
        next_cost = _evaluate(table, n, next_rotation, next_position, there)
        bent = regular & curved & (next_cost < np.inf)
        if any_of(bent):
            _add_curvatures(table, n, next_rotation, next_position, bent, there)
        accepted = regular & lm.lowered(cost, next_cost)
        plain = accepted & opposite(damping > 0)
        turn_before, way_before = select(plain, turn, 0.0), select(plain, way, 0.0)
        damping = select(accepted, lm.fallen(damping), select(open_, lm.raised(damping), damping))
        cost = select(accepted, next_cost, cost)
        _take(accepted, next_rotation, next_position, rotation, position)
        if all_of(accepted | opposite(open_)):
            at = 1 - at
        else:
            for k in range(8):
                for m in range(6):
                    here[k, m] = select(accepted, there[k, m], here[k, m])
        bends = regular & opposite(curved)
        if iteration != STEPS_PLAIN:
            bends = bends & (damping > 0)
        if any_of(bends):
            _add_curvatures(table, n, rotation, position, bends, sums[at])
            curved = curved | bends
    _take(converged, end_rotation, end_position, rotation, position)
    return converged, solves, cost


@kernel
def _refine_all(
    uv: Floats,
    weight: Floats,
    of: Given,
    iterations_max: int,
    rho: float,
    room: Room,
    solved: Bools,
    iterations: Ints,
    residual: Floats,
    cost: Floats,
    places: Places,
) -> None:
    """`refine_one` for every craft: the poses hold the starts, then the answers or NaN.

    uv, weight: (C K, 2); weight empty: as in `gather_measured_lanes`. rho: of (19). places: receive the precision of
    the answers, unless they are for no craft.
    """
    wanted = len(places.factors) > 0
    many, count, order, table = in_order(of.lit, solved, FEWEST_LIT, room), room.counts, room.order, wide_in(room.table)
    turn, place, found, answer = scratch(table, 3, 3), scratch(table, 3), room.answer, wide_in(room.answer)
    for c in range(len(solved)):
        solved[c], iterations[c], cost[c], residual[c] = False, 0, np.nan, np.nan
    for first in range(0, many, WIDE):
        who = order[first : first + WIDE]
        n, number = count[who[WIDE - 1], 0], taken(table[0, 0], count, who, 0)
        gather_craft(who, n, of, room, turn, place)
        finite = gather_measured_lanes(room.seen, n, number, uv, weight, table)
        open_ = finite & table_spans_plane(table, n)
        converged, solves, squares = refine_one(table, n, turn, place, open_, iterations_max)
        if wanted:
            precision_into(who, table, n, number, rho, converged, places)
        answer[0], answer[1], answer[2] = solves, squares, np.sqrt(squares / (2 * number))
        for k in range(3):
            answer[3 + k] = place[k]
            for m in range(3):
                answer[6 + 3 * k + m] = turn[k, m]
        for i in range(WIDE):
            c = who[i]
            solved[c], iterations[c] = lane(converged, i), int(found[0, i])
            if solved[c]:
                cost[c], residual[c] = found[1, i], found[2, i]
                for k in range(3):
                    of.position[c, k] = found[3 + k, i]
                for k in range(9):
                    of.rotation[c, k] = found[6 + k, i]
    for c in range(len(solved)):
        if not solved[c]:
            if wanted:
                no_precision(c, places)
            for k in range(3):
                of.position[c, k] = np.nan
            for k in range(9):
                of.rotation[c, k] = np.nan


def refine_projections(
    uv: Floats,
    weight: Floats | None,
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
        weight: (C, K, 2), each one's inverse noise in any unit: cost and residual_rad are in that unit of noise. None:
            of sweep angles, (13) at the measured projections, and radians.
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
    return _solved(uv, weight, lit, point_m, (rotation, position), (offset_s, angular_rate, velocity), iterations_max)


def _solved(
    uv: Floats,
    weight: Floats | None,
    lit: Bools,
    point_m: Floats,
    start: tuple[Floats, Floats],
    motion: tuple[Floats, Floats, Floats],
    iterations_max: int = ITERATIONS_MAX,
    rho: float = 0.0,
    places: Places = _NOWHERE,
) -> PoseSolution:
    """Check the shapes and run the kernel; start: rotation, position; motion: offset_s, angular_rate, velocity."""
    lit = checked_lit(lit)
    craft, photodiodes = lit.shape
    angles = (craft, photodiodes, 2)
    # Copies: the kernel works in place, and the starts belong to the caller.
    rotation, position = (np.array(part, dtype=np.float64) for part in start)
    of = given(lit, rotation, position, point_m, *motion)
    solved, iterations = np.ones(craft, dtype=np.bool_), np.zeros(craft, dtype=np.int64)
    residual, cost = np.empty(craft), np.empty(craft)
    _refine_all(
        checked("uv", uv, angles).reshape(-1, 2),
        np.empty((0, 2)) if weight is None else checked("weight", weight, angles).reshape(-1, 2),
        of,
        iterations_max,
        rho,
        room_for(craft, photodiodes),
        solved,
        iterations,
        residual,
        cost,
        places,
    )
    return PoseSolution(of.rotation.reshape(craft, 3, 3), of.position, solved, iterations, residual, cost)


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
    start, motion = (rotation, position), (offset_s, angular_rate, velocity)
    return _solved(_projected(theta, lit), None, lit, point_m, start, motion)


def refine_with_dilution(
    theta: Floats,
    lit: Bools,
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    offset_s: Floats,
    angular_rate: Floats,
    velocity: Floats,
    rotor_correlation: float,
) -> tuple[PoseSolution, Dilution]:
    """Return `refine` and the `dop.dilution` of its poses; NaN where there is no pose.

    The precision is of the rows that the last step was solved with: at a pose that this step, below 1e-5 rad and m from
    a warm start, leads to the answer, and with (13) at the measured angles, as in (7).

    Args:
        theta: as in `refine`.
        lit: as in `refine`.
        point_m: as in `refine`.
        rotation: as in `refine`.
        position: as in `refine`.
        offset_s: as in `refine`.
        angular_rate: as in `refine`.
        velocity: as in `refine`.
        rotor_correlation: rho of (19), in [0, 1].

    Raises:
        ValueError: as `refine` and `dop.dilution`.
    """
    places = places_for(len(checked_lit(lit)))
    start, motion, rho = (
        (rotation, position),
        (offset_s, angular_rate, velocity),
        checked_correlation(rotor_correlation),
    )
    solution = _solved(_projected(theta, lit), None, lit, point_m, start, motion, rho=rho, places=places)
    return solution, places.found()


def _projected(theta: Floats, lit: Bools) -> Floats:
    """Return the projections (C, K, 2) of sweep angles."""
    return projections(checked("theta", theta, (*checked_lit(lit).shape, 2)))
