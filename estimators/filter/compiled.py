"""The filter of record as one compiled loop over the craft: equations of `estimators.filter.error_state`, numbers of
filterpy.

With F = [[E, D], [0, I]] for (attitude, angular rate), [[I, dt I], [0, I]] for (position, velocity), and y = H x +
noise of covariance R, the usual forms are regrouped so that nothing is inverted:

    P <- F (F P)^T + Q                                 P is symmetric
    G = H P,  S = G H^T + R = L L^T,  Z = L^-1 G,  z = L^-1 y
    NIS = z^T z,   x = Z^T z,   P <- P - Z^T Z

Where an update leaves less than `SHRUNK` of a variance, as the first ones do of the rates', the difference loses as
many digits, and a quiet model forgets so little that they stay lost. There P is computed in the form of Joseph,

    K = Z^T L^-T,   P <- (I - K H) P (I - K H)^T + K R K^T

Rows of independent noise are taken in one after the other (`estimators.linear.absorb_row`), which is the same.

filterpy takes S^-1 and the Joseph form instead. In exact arithmetic they are the same; in ours they differ by the
rounding of P, some 1e-13 of it (tested: every column of the telemetry to 1e-9).
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank, Given, Independent, Poses, UpdateResult
from estimators.filter.error_state import POSE, STATES, correct, pose_difference_into, pose_rows_into
from estimators.kernel import inlined, kernel
from estimators.lanes import any_in_four, any_of, select
from estimators.linear import SINGULAR, absorb_row
from estimators.pivot import ARMS, is_wide, shear, turn_about
from estimators.rotation import exp_into, left_jacobian_into, multiply_into
from estimators.scratch import scratch
from estimators.state import State

SHRUNK = 1e-3
"""Share of a variance that an update may leave before the covariance is computed in the form of Joseph."""


class CompiledFilterBank(FilterBank):
    """A bank of one array per quantity: some 1 us per craft and period."""

    def _begin(self, mask: Bools) -> None:
        # The arrays of the base are the filters.
        return

    def _predict(self, mask: Bools, step: Floats) -> None:
        _predict_all(
            mask,
            step,
            self.acceleration_noise_m_s2,
            self.angular_acceleration_noise_rad_s2,
            self._state,
            self._p,
        )

    def _update(self, mask: Bools, given: Given | Independent | Poses, result: UpdateResult) -> int:
        if isinstance(given, Independent):
            _update_one_by_one(mask, given, self._state, self._p, result)
            return -1
        if isinstance(given, Poses):
            return _update_poses(mask, given, self._state, self._p, result)
        work = work_for(given.y.shape[1])
        return _update_rows(mask, given, work, self._state, self._p, result)


@kernel
def turn_into(angular_rate: Floats, dt: float, turn: Floats) -> None:
    """Write E of F for a step.

    Args:
        angular_rate: (3,) [rad/s].
        dt: the step [s].
        turn: (3, 3), receives E.
    """
    vector = scratch(dt, 3)
    for i in range(3):
        vector[i] = angular_rate[i] * dt
    exp_into(vector, turn)


@kernel
def step_into(angular_rate: Floats, dt: float, turn: Floats, dt_jacobian: Floats) -> None:
    """Write E and D of F for a step of `dt` [s] at an angular rate (3,) [rad/s] into matrices (3, 3).

    Args:
        angular_rate: (3,) [rad/s].
        dt: the step [s].
        turn: (3, 3), receives E.
        dt_jacobian: (3, 3), receives D.
    """
    vector = scratch(dt, 3)
    for i in range(3):
        vector[i] = angular_rate[i] * dt
    turn_into(angular_rate, dt, turn)
    left_jacobian_into(vector, dt_jacobian)
    for i in range(3):
        for j in range(3):
            dt_jacobian[i, j] *= dt


@kernel
def advance(
    p: Floats,
    turn: Floats,
    dt_jacobian: Floats,
    dt: float,
    acceleration: float,
    angular_acceleration: float,
    pf: Floats,
) -> None:
    """Move a covariance P, of numbers or of lanes, on by one step, in place.

    Args:
        p: (12, 12), the lower triangle.
        turn: (3, 3), E.
        dt_jacobian: (3, 3), D.
        dt: the step [s].
        acceleration: sigma [m/s^2] of the process noise, as in `process_noise_into`.
        angular_acceleration: likewise [rad/s^2].
        pf: (12, 3), workspace.
    """
    # The first columns of P F^T; the others are those of P, but for the position's, which are summed where they count.
    for i in range(3):
        e0, e1, e2 = turn[i, 0], turn[i, 1], turn[i, 2]
        d0, d1, d2 = dt_jacobian[i, 0], dt_jacobian[i, 1], dt_jacobian[i, 2]
        for j in range(3):
            value = e0 * p[j, 0] + e1 * p[max(j, 1), min(j, 1)] + e2 * p[2, j]
            pf[j, i] = value + (d0 * p[3, j] + d1 * p[4, j] + d2 * p[5, j])
        for j in range(3, 6):
            value = e0 * p[j, 0] + e1 * p[j, 1] + e2 * p[j, 2]
            pf[j, i] = value + (d0 * p[j, 3] + d1 * p[max(j, 4), min(j, 4)] + d2 * p[5, j])
        for j in range(6, STATES):
            value = e0 * p[j, 0] + e1 * p[j, 1] + e2 * p[j, 2]
            pf[j, i] = value + (d0 * p[j, 3] + d1 * p[j, 4] + d2 * p[j, 5])
    # F (P F^T): what is of the position's rows, and not yet moved, first.
    for i in range(3):
        for j in range(i + 1):
            far, near = p[6 + i, 6 + j] + dt * p[9 + j, 6 + i], p[9 + i, 6 + j] + dt * p[9 + i, 9 + j]
            p[6 + i, 6 + j] = far + dt * near
        for j in range(3):
            p[6 + i, 3 + j] = p[6 + i, 3 + j] + dt * p[9 + i, 3 + j]
    for i in range(3):
        for j in range(3):
            p[9 + i, 6 + j] = p[9 + i, 6 + j] + dt * p[9 + max(i, j), 9 + min(i, j)]
    for i in range(3):
        e0, e1, e2 = turn[i, 0], turn[i, 1], turn[i, 2]
        d0, d1, d2 = dt_jacobian[i, 0], dt_jacobian[i, 1], dt_jacobian[i, 2]
        for j in range(i + 1):
            value = e0 * pf[0, j] + e1 * pf[1, j] + e2 * pf[2, j]
            p[i, j] = value + (d0 * pf[3, j] + d1 * pf[4, j] + d2 * pf[5, j])
        for j in range(3):
            p[3 + i, j] = pf[3 + i, j]
            p[6 + i, j] = pf[6 + i, j] + dt * pf[9 + i, j]
            p[9 + i, j] = pf[9 + i, j]
    for first, sigma in ((0, angular_acceleration), (6, acceleration)):
        place, both, rate = sigma * dt * dt / 2, sigma * sigma * dt * dt * dt / 2, sigma * dt
        place, rate = place * place, rate * rate
        for i in range(first, first + 3):
            p[i, i] += place
            p[i + 3, i] += both
            p[i + 3, i + 3] += rate


@inlined
def _row_into(p: Floats, i: int, row: Floats) -> None:
    """Write row i of a covariance (12, 12) whose lower triangle is given, of numbers or of lanes, to `row` (12,)."""
    for j in range(STATES):
        row[j] = p[max(i, j), min(i, j)]


@inlined
def _mirror(p: Floats) -> None:
    """Complete a covariance (12, 12) whose lower triangle is given."""
    for i in range(STATES):
        for j in range(i):
            p[j, i] = p[i, j]


@kernel
def move_on(state: State, c: int, turn: Floats, dt: float) -> None:
    """Move the pose of craft c on by a step of `dt` [s] at constant rates; turn: (3, 3), E.

    Args:
        state: of C craft, changed in place.
        c: the craft.
        turn: (3, 3), E.
        dt: the step [s].
    """
    multiply_into(turn, state.rotation[c], state.rotation[c])
    for i in range(3):
        state.position[c, i] += state.velocity[c, i] * dt


@kernel
def _predict_all(
    mask: Bools,
    step: Floats,
    acceleration: float,
    angular_acceleration: float,
    state: State,
    covariance: Floats,
) -> None:
    """Move the craft of the mask on by step (C,) [s]; sigmas [m/s^2], [rad/s^2] as in `process_noise_into`."""
    turn, jacobian, pf = scratch(0.0, 3, 3), scratch(0.0, 3, 3), scratch(0.0, STATES, 3)
    for c in range(len(mask)):
        if mask[c]:
            step_into(state.angular_rate[c], step[c], turn, jacobian)
            advance(covariance[c], turn, jacobian, step[c], acceleration, angular_acceleration, pf)
            _mirror(covariance[c])
            move_on(state, c, turn, step[c])


class Work(NamedTuple):
    """Places for what updates by up to m rows compute, of numbers or of lanes.

    y: (m,). g: (m, 12). s: (m, m). pivot: (m,).
    """

    y: Floats
    g: Floats
    s: Floats
    pivot: Floats


def work_for(most: int, *lanes: int) -> Work:
    """Return places for up to `most` rows; lanes: WIDE, where they are of wide lanes."""
    return Work(
        np.empty((most, *lanes)),
        np.empty((most, STATES, *lanes)),
        np.empty((most, most, *lanes)),
        np.empty((most, *lanes)),
    )


@kernel
def _shrunk(before: Floats, left: Floats) -> bool:
    """Return whether less than SHRUNK of a variance is left, of numbers, or of lanes in any of a four.

    Args:
        before: (12, 12), P.
        left: (12,), variances.
    """
    shrunk = left[0] < SHRUNK * before[0, 0]
    for i in range(1, STATES):
        shrunk = shrunk | (left[i] < SHRUNK * before[i, i])
    return any_in_four(shrunk)


@kernel
def _joseph(p: Floats, gain: Floats, h: Floats, r: Floats, n: int) -> None:
    """Make (I - K H) P (I - K H)^T + K R K^T of P, in place.

    Args:
        p: (12, 12), P.
        gain: (m, 12), K^T.
        h: (m, 12), H.
        r: (m, m), R, of which the lower triangle is read.
        n: number of rows.
    """
    rest, half = scratch(p, STATES, STATES), scratch(p, STATES, STATES)
    for i in range(STATES):
        for j in range(STATES):
            rest[i, j] = 1.0 if i == j else 0.0
            for a in range(n):
                rest[i, j] -= gain[a, i] * h[a, j]
    for i in range(STATES):
        for j in range(STATES):
            half[i, j] = rest[i, 0] * p[0, j]
            for k in range(1, STATES):
                half[i, j] += rest[i, k] * p[k, j]
    for i in range(STATES):
        for j in range(i + 1):
            total = half[i, 0] * rest[j, 0]
            for k in range(1, STATES):
                total += half[i, k] * rest[j, k]
            for a in range(n):
                for d in range(n):
                    total += gain[a, i] * r[max(a, d), min(a, d)] * gain[d, j]
            p[i, j] = p[j, i] = total


@inlined
def _row_times(h: Floats, x: Floats) -> float:
    """Return a row (12,) of H times x (12,), of numbers or of lanes: pose, then angular rate, then velocity."""
    value: float = h[0] * x[0] + h[1] * x[1] + h[2] * x[2] + h[6] * x[6] + h[7] * x[7] + h[8] * x[8]
    value += h[3] * x[3] + h[4] * x[4] + h[5] * x[5]
    value += h[9] * x[9] + h[10] * x[10] + h[11] * x[11]
    return value


@inlined
def _pose_row_times(h: Floats, a: int, x: Floats) -> float:
    """`_row_times` of row a of H = [I B] (6, 12)."""
    value: float = x[a + a // 3 * 3] + (h[a, 3] * x[3] + h[a, 4] * x[4] + h[a, 5] * x[5])
    value += h[a, 9] * x[9] + h[a, 10] * x[10] + h[a, 11] * x[11]
    return value


@inlined
def weigh_rows(p: Floats, y: Floats, h: Floats, r: Floats, n: int, work: Work, x: Floats) -> tuple[bool, float, float]:
    """Weigh n rows against an error estimate x of covariance P, of numbers or of lanes; return whether S is positive
    definite, NIS, and the root of det S. Z and z stay in `work`, for `take_rows`.

    Args:
        p: (12, 12), P, the lower triangle.
        y: (m,), innovations of x = 0.
        h: (m, 12), H.
        r: (m, m), R, of which the lower triangle is read.
        n: number of rows that are used.
        work: places.
        x: (12,).
    """
    z, g, s, row = work.y, work.g, work.s, scratch(p, STATES)
    for i in range(STATES):
        _row_into(p, i, row)
        for a in range(n):
            g[a, i] = _row_times(h[a], row)
    for a in range(n):
        z[a] = y[a] - _row_times(h[a], x)
        for d in range(a + 1):
            s[a, d] = r[a, d] + _row_times(h[d], g[a])
    return _standardise(n, work)


@inlined
def weigh_pose(p: Floats, y: Floats, h: Floats, r: Floats, work: Work, x: Floats) -> tuple[bool, float, float]:
    """`weigh_rows` for a solved pose, H = [I B], whose rows pick a column of the pose each.

    Args:
        p: (12, 12), P, the lower triangle.
        y: (6,), innovations of x = 0.
        h: (6, 12), H.
        r: (6, 6), R, of which the lower triangle is read.
        work: places.
        x: (12,).
    """
    z, g, s, row = work.y, work.g, work.s, scratch(p, STATES)
    for a in range(POSE):
        z[a] = y[a] - _pose_row_times(h, a, x)
    for i in range(STATES):
        _row_into(p, i, row)
        for a in range(POSE):
            g[a, i] = _pose_row_times(h, a, row)
    for a in range(POSE):
        for d in range(a + 1):
            s[a, d] = r[a, d] + _pose_row_times(h, d, g[a])
    return _standardise(POSE, work)


@inlined
def _standardise(n: int, work: Work) -> tuple[bool, float, float]:
    """Put L, Z and z in the places of S, G and y of n rows; return as `weigh_rows`.

    The elements of L before they are divided by their pivots stand beyond the diagonal, the pivots' inverse squares on
    it: a pivot waits for the quotient of the one before and for no root. Every row of Z comes behind its pivot, so that
    a processor has work while it waits for the next one.
    """
    z, g, s, pivot = work.y, work.g, work.s, work.pivot
    regular, squared, volume = True, z[0] * 0.0, z[0] * 0.0 + 1.0
    for d in range(n):
        square, left = s[d, d], z[d]
        for a in range(d):
            value = s[d, a]
            for k in range(a):
                value -= s[k, d] * (s[k, a] * s[k, k])
            square -= value * (value * s[a, a])
            s[a, d], s[d, a] = value, value * pivot[a]
            left -= s[d, a] * z[a]
        regular = regular & (square > SINGULAR * s[d, d])
        s[d, d] = 1 / square
        over = np.sqrt(s[d, d])
        left *= over
        volume *= square * over
        squared += left * left
        pivot[d], z[d] = over, left
        for i in range(0, STATES, 4):  # in registers: a sum in memory waits for the one before
            one, two, three, four = g[d, i], g[d, i + 1], g[d, i + 2], g[d, i + 3]
            for k in range(d):
                factor = s[d, k]
                one -= factor * g[k, i]
                two -= factor * g[k, i + 1]
                three -= factor * g[k, i + 2]
                four -= factor * g[k, i + 3]
            g[d, i], g[d, i + 1], g[d, i + 2], g[d, i + 3] = one * over, two * over, three * over, four * over
    return regular, squared, volume


@inlined
def take_rows(p: Floats, h: Floats, r: Floats, n: int, work: Work, x: Floats) -> None:
    """Take n rows that have been weighed into an error estimate x of covariance P, of numbers or of lanes, in place.

    Args:
        p: (12, 12), P, the lower triangle.
        h: (m, 12), H.
        r: (m, m), R, of which the lower triangle is read.
        n: number of rows that are used.
        work: places, with Z and z of `weigh_rows`.
        x: (12,).
    """
    z, g, s, left, before = work.y, work.g, work.s, scratch(p, STATES), scratch(p, STATES, STATES)
    for i in range(STATES):
        value, own = x[i], p[i, i]
        for a in range(n):
            value += g[a, i] * z[a]
            own -= g[a, i] * g[a, i]
        x[i], left[i] = value, own
    shrunk = _shrunk(p, left)
    if any_of(shrunk):
        for i in range(STATES):
            for j in range(i + 1):
                before[i, j] = before[j, i] = p[i, j]
    # Two rows and two columns at once: an element of Z serves twice.
    for i in range(0, STATES, 2):
        for j in range(0, i, 2):
            one, two, three, four = p[i, j], p[i, j + 1], p[i + 1, j], p[i + 1, j + 1]
            for a in range(n):
                left0, left1, right0, right1 = g[a, i], g[a, i + 1], g[a, j], g[a, j + 1]
                one -= left0 * right0
                two -= left0 * right1
                three -= left1 * right0
                four -= left1 * right1
            p[i, j], p[i, j + 1], p[i + 1, j], p[i + 1, j + 1] = one, two, three, four
        value = p[i + 1, i]
        for a in range(n):
            value -= g[a, i + 1] * g[a, i]
        p[i, i], p[i + 1, i], p[i + 1, i + 1] = left[i], value, left[i + 1]
    if any_of(shrunk):
        for a in range(n - 1, -1, -1):  # K^T = L^-T Z
            for k in range(a + 1, n):
                factor = s[k, a]
                for i in range(STATES):
                    g[a, i] -= factor * g[k, i]
            for i in range(STATES):
                g[a, i] *= work.pivot[a]
        _joseph(before, g, h, r, n)
        for i in range(STATES):
            for j in range(i + 1):
                p[i, j] = select(shrunk, before[i, j], p[i, j])


@kernel
def _joseph_row(p: Floats, h: Floats, variance: float) -> None:
    """Take one row of independent noise into P in the form of Joseph, in place.

    The two products with I - K h differ from P, and from each other, by a column times a row:

        M = P - K (P h)^T,   P <- M - (M h) K^T + r K K^T

    Args:
        p: (12, 12), P, of numbers or of lanes.
        h: (12,).
        variance: r, of its noise.
    """
    gain, told, part = scratch(p, STATES), scratch(p, STATES), scratch(p, STATES)
    left = scratch(p, STATES, STATES)
    s = p[0, 0] * 0.0 + variance
    for i in range(STATES):
        value = h[0] * p[0, i]
        for j in range(1, STATES):
            value += h[j] * p[j, i]
        told[i] = value
        s += h[i] * value
    over = 1 / s
    for i in range(STATES):
        gain[i] = told[i] * over
    for i in range(STATES):
        for j in range(STATES):
            left[i, j] = p[i, j] - gain[i] * told[j]
        value = left[i, 0] * h[0]
        for j in range(1, STATES):
            value += left[i, j] * h[j]
        part[i] = variance * gain[i] - value
    for i in range(STATES):
        for j in range(i + 1):
            p[i, j] = p[j, i] = left[i, j] + part[i] * gain[j]


@kernel
def _tells(h: Floats) -> bool:
    """Return whether a row (12,) of H tells anything of the state; if not, it is for the gate only."""
    told = False
    for i in range(STATES):
        told = told or h[i] != 0.0
    return told


@kernel
def absorb_independent(
    p: Floats, y: Floats, h: Floats, variance: Floats, n: int, x: Floats, left: Floats
) -> tuple[float, float]:
    """Take n rows of independent noise into an error estimate x of covariance P, of numbers or of lanes; return NIS,
    and the root of det S.

    Args:
        p: (12, 12), P, as it was; spoilt where `left` becomes far smaller.
        y: (m,), innovations of x = 0.
        h: (m, 12), H.
        variance: (m,), of the rows.
        n: number of rows that are used.
        x: (12,), corrected in place.
        left: (12, 12), receives the covariance that is left.
    """
    gain, scale, variances = scratch(p, STATES), scratch(p, 1), scratch(p, STATES)
    squared, volume = x[0] * 0.0, x[0] * 0.0 + 1.0
    for i in range(STATES):
        for j in range(STATES):
            left[i, j] = p[i, j]
    for a in range(n):
        if not _tells(h[a]):
            pivot = 1 / np.sqrt(variance[a])
            squared += (y[a] * pivot) * (y[a] * pivot)
            volume *= np.sqrt(variance[a])
            continue
        squared += absorb_row(left, x, h[a], y[a], variance[a], gain, scale)
        volume *= np.sqrt(scale[0])
    for i in range(STATES):
        variances[i] = left[i, i]
    if any_of(_shrunk(p, variances)):
        for a in range(n):
            if _tells(h[a]):
                _joseph_row(p, h[a], variance[a])
        for i in range(STATES):
            for j in range(STATES):
                left[i, j] = p[i, j]
    return squared, volume


@kernel
def _update_rows(mask: Bools, given: Given, work: Work, state: State, covariance: Floats, result: UpdateResult) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    x = scratch(0.0, STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        p, h, r, n = covariance[c], given.h[c], given.r[c], given.rows[c]
        _no_error(x)
        regular, squared, volume = weigh_rows(p, given.y[c], h, r, n, work, x)
        if not regular:
            return c
        if _let_in(c, squared + given.square[c], volume, given.gate[given.freedoms[c]], result):
            take_rows(p, h, r, n, work, x)
            _mirror(p)
            correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1


@kernel
def _update_poses(mask: Bools, poses: Poses, state: State, covariance: Floats, result: UpdateResult) -> int:
    """Take in the poses of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    work = Work(scratch(0.0, POSE), scratch(0.0, POSE, STATES), scratch(0.0, POSE, POSE), scratch(0.0, POSE))
    x, y, h = scratch(0.0, STATES), scratch(0.0, POSE), scratch(0.0, POSE, STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        p, r = covariance[c], poses.covariance[c]
        _no_error(x)
        pose_difference_into(poses.rotation[c], poses.position[c], state.rotation[c], state.position[c], y)
        pose_rows_into(poses.coupling[c], h)
        regular, squared, volume = weigh_pose(p, y, h, r, work, x)
        if not regular:
            return c
        if _let_in(c, squared, volume, poses.gate[POSE], result):
            take_rows(p, h, r, POSE, work, x)
            _mirror(p)
            correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1


@kernel
def _no_error(x: Floats) -> None:
    """Make the error state (12,) zero."""
    for i in range(STATES):
        x[i] = 0.0


@kernel
def _let_in(c: int, squared: float, volume: float, gate: float, result: UpdateResult) -> bool:
    """Write the fate of craft c, and return whether its measurement is let in.

    Args:
        c: the craft.
        squared: NIS.
        volume: root of det S.
        gate: largest NIS that is let in.
        result: receives the fate.
    """
    result.nis[c], result.log_determinant[c] = squared, 2 * np.log(volume)
    result.accepted[c] = squared <= gate
    return bool(result.accepted[c])


@kernel
def _update_one_by_one(mask: Bools, given: Independent, state: State, covariance: Floats, result: UpdateResult) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    p, left = scratch(0.0, STATES, STATES), scratch(0.0, STATES, STATES)
    x, arms = scratch(0.0, STATES), scratch(0.0, ARMS)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        _no_error(x)
        for i in range(STATES):
            for j in range(STATES):
                p[i, j] = covariance[c, i, j]
        rows = given.y[c], given.h[c], given.variance[c]
        squared, volume = absorb_independent(p, *rows, given.rows[c], x, left)
        if not _let_in(c, squared, volume, given.gate[given.freedoms[c]], result):
            continue
        turn_about(
            state.rotation[c],
            state.angular_rate[c],
            state.position[c],
            state.velocity[c],
            x,
            given.pivot[c],
            arms,
        )
        if is_wide(left):
            shear(left, arms)
        for i in range(STATES):
            for j in range(STATES):
                covariance[c, i, j] = left[i, j]
