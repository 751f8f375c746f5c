"""Pose and motion of an object in a hand from the rows of some hundredths of a second, by Levenberg-Marquardt.

With the whitened residuals of `estimators.lighthouse.innovation` at the state (R, p, v, w) of the epoch and a constant
acceleration a,

    p(tau) = p + v tau + a tau^2 / 2,   R(tau) = Exp([w]x tau) R
    F = |W y|^2 + |w|^2 / s_w^2 + |v|^2 / s_v^2 + |a|^2 / s_a^2

over (d, w, p, v, a), 15 numbers. The priors are how hands move: a thing that is carried past a station at 3 m/s moves
60 mm within a turn of the rotor, and a solver that takes it to be at rest finds no pose, or the wrong mirror image.
"""

from typing import NamedTuple

import numpy as np

from estimators import levenberg_marquardt as lm
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.innovation import SWEEPS, RowBatch, StationArrays
from estimators.lighthouse.rows import row_into
from estimators.linear import invert_spd_into, solve_spd
from estimators.rotation import exp_into, multiply_into
from estimators.state import STATES, State

MOTION = 15
ITERATIONS_MAX = 40
_SETTLED = 1e-5
"""Fall of F, relative to 1 + F, that ends the iteration."""
_ROUNDING = 1e-9
"""Rise of F, relative to 1 + F, that is rounding."""


class HandMotion(NamedTuple):
    """Motion of things in a hand, standard deviations per axis: angular rate [rad/s], velocity [m/s], and acceleration
    [m/s^2], which is constant over some hundredths of a second.
    """

    angular_rate: float = 3.0
    velocity: float = 2.0
    acceleration: float = 8.0


class RowMotion(NamedTuple):
    """States of C objects at the epoch, meaningless where `solved` is False.

    state: poses and rates. covariance: (C, 12, 12) of (attitude, angular rate, position, velocity). solved: (C,).
    cost: (C,) F, and rows: (C,) their number.
    """

    state: State
    covariance: Floats
    solved: Bools
    cost: Floats
    rows: Ints


def solve_motion(rows: RowBatch, light: StationArrays, point_m: Floats, start: State, hand: HandMotion) -> RowMotion:
    """Return the states of C objects that fit their rows best, near their starts.

    Args:
        rows: rows of C objects.
        light: stations with the noise of their rows, as `innovation.light_of` returns them.
        point_m: (C, K, 3) [m], photodiodes in the body frames.
        start: of C objects.
        hand: how they may move.
    """
    craft, most = len(rows.first) - 1, int(np.diff(rows.first).max(initial=0))
    out = RowMotion(
        State._make(np.ascontiguousarray(part, dtype=np.float64).copy() for part in start),
        np.full((craft, STATES, STATES), np.nan),
        np.zeros(craft, dtype=np.bool_),
        np.full(craft, np.inf),
        np.diff(rows.first),
    )
    work = np.empty((most, MOTION)), np.empty(most)
    weight = np.zeros(MOTION)
    weight[3:6], weight[9:12], weight[12:] = hand.angular_rate**-2, hand.velocity**-2, hand.acceleration**-2
    _solve_all(rows, light, np.ascontiguousarray(point_m), weight, work[0], work[1], out)
    return out


@kernel
def _solve_all(
    rows: RowBatch, light: StationArrays, point: Floats, weight: Floats, h: Floats, y: Floats, out: RowMotion
) -> None:
    """Solve every object."""
    for c in range(len(out.solved)):
        _solve(c, rows, light, point, weight, h, y, out)


@kernel
def _whitened_into(
    c: int, rows: RowBatch, light: StationArrays, point: Floats, state: State, push: Floats, h: Floats, y: Floats
) -> bool:
    """Write the whitened residuals and their derivatives (n, 15); False where a photodiode is not before its station.

    Args:
        c: the object.
        rows: of C objects, those of one sweep together.
        light: stations with their noise.
        point: (C, K, 3) [m].
        state: of C objects.
        push: (3,) acceleration [m/s^2].
        h: receives the derivatives.
        y: receives the residuals.
    """
    first, velocity, total = rows.first[c], np.empty(3), np.empty(MOTION)
    n = rows.first[c + 1] - first
    for k in range(n):
        r = first + k
        s, tau = rows.station[r], rows.offset_s[r]
        for i in range(3):
            velocity[i] = state.velocity[c, i] + 0.5 * tau * push[i]
        y[k] = row_into(
            tau,
            rows.angle[r],
            light.rotation[s],
            light.position[s],
            light.fans[light.first[s] + rows.fan[r]],
            point[c, rows.photodiode[r]],
            state.rotation[c],
            state.position[c],
            velocity,
            state.angular_rate[c],
            h[k, :STATES],
        )
        if np.isnan(y[k]):
            return False
        for i in range(3):
            h[k, STATES + i] = 0.5 * tau * h[k, 9 + i]
    begin = 0
    while begin < n:
        r = first + begin
        key = (light.first[rows.station[r]] + rows.fan[r]) * SWEEPS + rows.sweep[r]
        end, mean, total[:] = begin, 0.0, 0.0
        while end < n:
            q = first + end
            if (light.first[rows.station[q]] + rows.fan[q]) * SWEEPS + rows.sweep[q] != key:
                break
            mean += y[end]
            for i in range(MOTION):
                total[i] += h[end, i]
            end += 1
        own, shared = light.own[rows.station[r]], light.shared[rows.station[r]]
        share = (1 - own / np.sqrt(own * own + (end - begin) * shared * shared)) / (end - begin)
        for k in range(begin, end):
            y[k] = (y[k] - share * mean) / own
            for i in range(MOTION):
                h[k, i] = (h[k, i] - share * total[i]) / own
        begin = end
    return True


@kernel
def _cost(state: State, c: int, push: Floats, y: Floats, n: int, weight: Floats) -> float:
    """Return F."""
    total = 0.0
    for k in range(n):
        total += y[k] * y[k]
    for i in range(3):
        total += weight[3] * state.angular_rate[c, i] ** 2 + weight[9] * state.velocity[c, i] ** 2
        total += weight[12] * push[i] ** 2
    return total


@kernel
def _step(state: State, c: int, push: Floats, x: Floats) -> None:
    """Move one object's state by x (15,), in place."""
    turn = np.empty((3, 3))
    exp_into(x[:3], turn)
    multiply_into(turn, state.rotation[c], state.rotation[c])
    for i in range(3):
        state.angular_rate[c, i] += x[3 + i]
        state.position[c, i] += x[6 + i]
        state.velocity[c, i] += x[9 + i]
        push[i] += x[12 + i]


@kernel
def _put(state: State, c: int, kept: State) -> None:
    """Take a state (1, ...) back."""
    state.rotation[c] = kept.rotation[0]
    state.position[c] = kept.position[0]
    state.velocity[c] = kept.velocity[0]
    state.angular_rate[c] = kept.angular_rate[0]


@kernel
def _normal_into(
    state: State, c: int, push: Floats, h: Floats, y: Floats, n: int, weight: Floats, normal: Floats, gradient: Floats
) -> None:
    """Write the normal matrix (15, 15) and the gradient (15,)."""
    normal[:] = 0.0
    gradient[:] = 0.0
    for k in range(n):
        for i in range(MOTION):
            gradient[i] += h[k, i] * y[k]
            for j in range(i + 1):
                normal[i, j] += h[k, i] * h[k, j]
    for i in range(MOTION):
        normal[i, i] += weight[i]
        for j in range(i):
            normal[j, i] = normal[i, j]
    for i in range(3):
        gradient[3 + i] -= weight[3] * state.angular_rate[c, i]
        gradient[9 + i] -= weight[9] * state.velocity[c, i]
        gradient[12 + i] -= weight[12] * push[i]


@kernel
def _solve(
    c: int,
    rows: RowBatch,
    light: StationArrays,
    point: Floats,
    weight: Floats,
    h: Floats,
    y: Floats,
    out: RowMotion,
) -> None:
    """Solve one object."""
    state, n = out.state, rows.first[c + 1] - rows.first[c]
    push, pushed, x, gradient = np.zeros(3), np.zeros(3), np.empty(MOTION), np.empty(MOTION)
    normal, damped, lower = np.empty((MOTION, MOTION)), np.empty((MOTION, MOTION)), np.empty((MOTION, MOTION))
    if n == 0 or not _whitened_into(c, rows, light, point, state, push, h, y):
        return
    cost, damping, converged = _cost(state, c, push, y, n, weight), 0.0, False
    _normal_into(state, c, push, h, y, n, weight, normal, gradient)
    for _ in range(ITERATIONS_MAX):
        damped[:] = normal
        for i in range(MOTION):
            damped[i, i] += damping * normal[i, i]
        x[:] = gradient
        if not solve_spd(damped, lower, x):
            damping = lm.raised(damping)
            continue
        kept = State(
            state.rotation[c : c + 1].copy(),
            state.position[c : c + 1].copy(),
            state.velocity[c : c + 1].copy(),
            state.angular_rate[c : c + 1].copy(),
        )
        pushed[:] = push
        _step(state, c, push, x)
        front = _whitened_into(c, rows, light, point, state, push, h, y)
        there = _cost(state, c, push, y, n, weight) if front else np.inf
        if not there <= cost + _ROUNDING * (1 + cost):
            _put(state, c, kept)
            push[:] = pushed
            small = damping > 1e6
            damping = lm.raised(damping)
            if small:
                break
            continue
        converged = cost - there <= _SETTLED * (1 + there) and damping < lm.FIRST_DAMPING
        cost = there
        damping = 0.1 * damping if damping > lm.FIRST_DAMPING**2 else 0.0
        _normal_into(state, c, push, h, y, n, weight, normal, gradient)
        if converged:
            break
    out.cost[c] = cost
    if converged and invert_spd_into(normal, damped):
        out.covariance[c] = damped[:STATES, :STATES]
        out.solved[c] = True
