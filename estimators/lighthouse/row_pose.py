"""Pose from the rows of any number of stations: Levenberg-Marquardt on the innovations, with the rotors' error.

With W y(T) the whitened residuals of `estimators.lighthouse.innovation` at the pose T = (R, p), which are independent
and of variance one whatever rows share a draw of the rotor's error,

    F(T) = |W y(T)|^2,   step: (N + damping diag(N)) (d, dp) = (W H)^T W y,   N = (W H)^T W H,   R <- Exp([d]x) R

F is chi-square with as many degrees of freedom as there are rows, less six; N^-1 the covariance of (d, dp). Each angle
has its own instant, for which the rates of the start move the craft; an error of the rates moves the pose by B times
it, B = N^-1 (W H_pose)^T W H_rates.

Of a plane that is nearly face-on the tilt enters F to fourth order only, and N^-1 claims too much or too little. Along
the axis v of the attitude's largest uncertainty s, F itself is therefore asked: where it rises by less than a half over
s on either side, v gets the variance of the least multiple of s over which it rises by one on both (`_flatness`).
"""

from typing import NamedTuple

import numpy as np

from estimators import levenberg_marquardt as lm
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import Innovations, RowBatch, StationArrays, whitened_into
from estimators.linear import invert_spd_into, solve_spd
from estimators.pivot import PIVOT
from estimators.rotation import exp_into, multiply_into
from estimators.state import STATES, State

POSE = 6
FEWEST_ROWS = 6
"""Rows that a pose needs."""
ITERATIONS_MAX = 40
WIDEST_RAD = 0.6
"""Uncertainty of the attitude [rad] beyond which a first-order covariance means nothing."""
_GROWTH = 1.5


class RowPose(NamedTuple):
    """Poses of C craft at the epoch, world frame; NaN where `solved` is False.

    rotation: (C, 3, 3) R_w_b. position: (C, 3) [m]. covariance: (C, 6, 6) of (attitude, position) [rad, m]. coupling:
    (C, 6, 6) [s], B by (angular rate, velocity). solved: (C,). iterations: (C,) linear solves. residual_rad: (C,) RMS
    of the residuals. cost: (C,) F, and rows: (C,) their number.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    coupling: Floats
    solved: Bools
    iterations: Ints
    residual_rad: Floats
    cost: Floats
    rows: Ints


def solve_rows(
    rows: RowBatch, kept: Bools, mask: Bools, light: StationArrays, point_m: Floats, start: State
) -> RowPose:
    """Return the poses of the craft of the mask that fit their rows best, near their starts.

    Args:
        rows: rows of C craft.
        kept: (N,), the rows that are used.
        mask: (C,), the craft concerned.
        light: stations with the noise of their rows, as `innovation.light_of` returns them.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        start: of C craft: start poses, and rates, which are taken as known.
    """
    craft, most = len(mask), int(np.diff(rows.first).max(initial=0))
    out = RowPose(
        np.full((craft, 3, 3), np.nan),
        np.full((craft, 3), np.nan),
        np.full((craft, POSE, POSE), np.nan),
        np.full((craft, POSE, POSE), np.nan),
        np.zeros(craft, dtype=np.bool_),
        np.zeros(craft, dtype=np.int64),
        np.full(craft, np.nan),
        np.full(craft, np.nan),
        np.zeros(craft, dtype=np.int64),
    )
    inner = Innovations(
        np.empty((craft, most)),
        np.empty((craft, most, STATES)),
        np.zeros(craft, dtype=np.int64),
        np.zeros((craft, PIVOT)),
    )
    work = State._make(np.ascontiguousarray(part, dtype=np.float64).copy() for part in start)
    _solve_all(mask, rows, kept, light, np.ascontiguousarray(point_m), work, inner, out)
    return out


@kernel
def _solve_all(
    mask: Bools,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    inner: Innovations,
    out: RowPose,
) -> None:
    """Solve every craft of the mask; `state` is moved from the starts to the solutions."""
    work = np.empty((2, inner.y.shape[1]), np.int64)
    for c in range(len(mask)):
        if mask[c]:
            _solve(c, rows, kept, light, point, state, inner, work, out)


@kernel
def _cost(y: Floats, n: int) -> float:
    """Return the sum of the first n squares."""
    total = 0.0
    for k in range(n):
        total += y[k] * y[k]
    return total


@kernel
def _normal_into(h: Floats, y: Floats, n: int, normal: Floats, gradient: Floats) -> None:
    """Write N (6, 6) and (W H)^T W y (6,) of n whitened rows."""
    normal[:] = 0.0
    gradient[:] = 0.0
    for k in range(n):
        for i in range(POSE):
            a = h[k, i if i < 3 else i + 3]
            gradient[i] += a * y[k]
            for j in range(i + 1):
                normal[i, j] += a * h[k, j if j < 3 else j + 3]
    for i in range(POSE):
        for j in range(i):
            normal[j, i] = normal[i, j]


@kernel
def _step(state: State, c: int, x: Floats, factor: float) -> None:
    """Move one craft's pose by `factor` times x (6,), in place."""
    turn = np.empty((3, 3))
    exp_into(factor * x[:3], turn)
    multiply_into(turn, state.rotation[c], state.rotation[c])
    for i in range(3):
        state.position[c, i] += factor * x[3 + i]


@kernel
def _put(state: State, c: int, rotation: Floats, position: Floats) -> None:
    state.rotation[c] = rotation
    state.position[c] = position


@kernel
def _solve(
    c: int,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    inner: Innovations,
    work: Ints,
    out: RowPose,
) -> None:
    """Solve one craft."""
    normal, damped, lower = np.empty((POSE, POSE)), np.empty((POSE, POSE)), np.empty((POSE, POSE))
    gradient, x = np.empty(POSE), np.empty(POSE)
    square, front = whitened_into(c, rows, kept, light, point, state, inner, work, False)
    n = inner.number[c]
    if not front or n < FEWEST_ROWS:
        return
    cost, damping, converged = _cost(inner.y[c], n), 0.0, False
    _normal_into(inner.h[c], inner.y[c], n, normal, gradient)
    rotation, position = state.rotation[c].copy(), state.position[c].copy()
    unit = np.min(light.own) ** 2
    for iteration in range(ITERATIONS_MAX):
        out.iterations[c] = iteration + 1
        damped[:] = normal
        for i in range(POSE):
            damped[i, i] += damping * normal[i, i]
        x[:] = gradient
        if not solve_spd(damped, lower, x):
            damping = lm.raised(damping)
            continue
        _step(state, c, x, 1.0)
        square_there, front = whitened_into(c, rows, kept, light, point, state, inner, work, False)
        there = _cost(inner.y[c], n) if front else np.inf
        # In radians, for which the rounding that `judged` forgives is meant.
        accepted, next_damping = lm.judged(unit * cost, unit * there, damping)
        if not accepted:
            _put(state, c, rotation, position)
            damping = next_damping
            continue
        small = max(np.max(np.abs(x[:3])), np.max(np.abs(x[3:]))) < lm.STEP_SMALL
        converged = small and damping < lm.FIRST_DAMPING
        cost, square, damping = there, square_there, next_damping
        _normal_into(inner.h[c], inner.y[c], n, normal, gradient)
        rotation[:], position[:] = state.rotation[c], state.position[c]
        if converged:
            break
    if not converged or not invert_spd_into(normal, damped):
        _put(state, c, rotation, position)
        return
    out.rotation[c], out.position[c], out.covariance[c], out.solved[c] = rotation, position, damped, True
    out.residual_rad[c], out.cost[c], out.rows[c] = np.sqrt(square / n), cost, n
    _coupling_into(damped, inner.h[c], n, out.coupling[c])
    _flatness(c, rows, kept, light, point, state, inner, work, cost, out.covariance[c])
    _put(state, c, rotation, position)


@kernel
def _coupling_into(covariance: Floats, h: Floats, n: int, out: Floats) -> None:
    """Write B (6, 6) of n whitened rows."""
    cross = np.zeros((POSE, POSE))
    for k in range(n):
        for i in range(POSE):
            a = h[k, i if i < 3 else i + 3]
            for j in range(POSE):
                cross[i, j] += a * h[k, 3 + j if j < 3 else 6 + j]
    out[:] = 0.0
    for i in range(POSE):
        for j in range(POSE):
            for k in range(POSE):
                out[i, j] += covariance[i, k] * cross[k, j]


@kernel
def _weakest_into(covariance: Floats, v: Floats) -> float:
    """Write the pose's change (6,) at one sigma along the most uncertain axis of the attitude; return that sigma."""
    axis = np.empty(3)
    # The columns of a power of the matrix tend to its first eigenvector.
    a, b = covariance[:3, :3].copy(), np.empty((3, 3))
    for _ in range(12):
        total = a[0, 0] + a[1, 1] + a[2, 2]
        for i in range(3):
            for j in range(3):
                b[i, j] = 0.0
                for k in range(3):
                    b[i, j] += a[i, k] * a[k, j] / (total * total)
        a[:] = b
    best = 0
    for j in range(1, 3):
        if a[j, j] > a[best, best]:
            best = j
    length = np.sqrt(a[0, best] ** 2 + a[1, best] ** 2 + a[2, best] ** 2)
    for i in range(3):
        axis[i] = a[i, best] / length
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += axis[i] * covariance[i, j] * axis[j]
    sigma = np.sqrt(variance)
    # The mean of the other parameters given this one's: the regression on it.
    for i in range(POSE):
        v[i] = 0.0
        for j in range(3):
            v[i] += covariance[i, j] * axis[j] / sigma
    return float(sigma)


@kernel
def _flatness(
    c: int,
    rows: RowBatch,
    kept: Bools,
    light: StationArrays,
    point: Floats,
    state: State,
    inner: Innovations,
    work: Ints,
    cost: float,
    covariance: Floats,
) -> None:
    """Widen the covariance of one craft's pose along its weakest axis to where F rises by one, in place."""
    v = np.empty(POSE)
    sigma = _weakest_into(covariance, v)
    rotation, position = state.rotation[c].copy(), state.position[c].copy()
    factor = 1.0
    while factor * sigma < WIDEST_RAD:
        least = np.inf
        for side in (-1.0, 1.0):
            _step(state, c, v, side * factor)
            _, front = whitened_into(c, rows, kept, light, point, state, inner, work, False)
            if front:
                least = min(least, _cost(inner.y[c], inner.number[c]) - cost)
            _put(state, c, rotation, position)
        if least >= (0.5 if factor == 1.0 else 1.0):
            break
        factor *= _GROWTH
    if factor > 1.0:
        for i in range(POSE):
            for j in range(POSE):
                covariance[i, j] += (factor * factor - 1) * v[i] * v[j]
