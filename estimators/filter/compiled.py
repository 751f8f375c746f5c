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

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank, Given, Independent, UpdateResult
from estimators.filter.error_state import POSE, POSE_COLUMNS, STATES, correct
from estimators.kernel import formula, inlined, kernel
from estimators.lanes import LANES, any_of, lanes_in
from estimators.linear import SINGULAR, absorb_row
from estimators.pivot import ARMS, is_wide, shear, turn_about
from estimators.rotation import exp_into, left_jacobian_into, multiply_into
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
            self._covariance,
        )

    def _update(self, mask: Bools, given: Given | Independent, result: UpdateResult) -> int:
        if isinstance(given, Independent):
            _update_one_by_one(mask, given, self._state, self._covariance, result)
            return -1
        return _update_all(mask, given, self._state, self._covariance, result)


@kernel
def step_into(angular_rate: Floats, dt: float, turn: Floats, dt_jacobian: Floats) -> None:
    """Write E and D of F for a step of `dt` [s] at an angular rate (3,) [rad/s] into matrices (3, 3).

    Args:
        angular_rate: (3,) [rad/s].
        dt: the step [s].
        turn: (3, 3), receives E.
        dt_jacobian: (3, 3), receives D.
    """
    vector = np.empty(3)
    for i in range(3):
        vector[i] = angular_rate[i] * dt
    exp_into(vector, turn)
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
    fp: Floats,
) -> None:
    """Move a covariance P, of numbers or of lanes, on by one step, in place.

    Args:
        p: (12, 12).
        turn: (3, 3), E.
        dt_jacobian: (3, 3), D.
        dt: the step [s].
        acceleration: sigma [m/s^2] of the process noise, as in `process_noise_into`.
        angular_acceleration: likewise [rad/s^2].
        fp: (3, 12), workspace.
    """
    # The first rows of F P; the others are rows of P, but for those of the position, which are summed where they count.
    for i in range(3):
        e0, e1, e2 = turn[i, 0], turn[i, 1], turn[i, 2]
        d0, d1, d2 = dt_jacobian[i, 0], dt_jacobian[i, 1], dt_jacobian[i, 2]
        for j in range(STATES):
            fp[i, j] = e0 * p[0, j] + e1 * p[1, j] + e2 * p[2, j] + (d0 * p[3, j] + d1 * p[4, j] + d2 * p[5, j])
    # F (F P)^T: what is of the position's rows, and not yet moved, first.
    for i in range(3):
        for j in range(i + 1):
            far, near = p[6 + j, 6 + i] + dt * p[9 + j, 6 + i], p[6 + j, 9 + i] + dt * p[9 + j, 9 + i]
            p[6 + i, 6 + j] = p[6 + j, 6 + i] = far + dt * near
        for j in range(3):
            p[6 + i, 3 + j] = p[3 + j, 6 + i] = p[3 + j, 6 + i] + dt * p[3 + j, 9 + i]
    for i in range(3):
        for j in range(3):
            p[9 + i, 6 + j] = p[6 + j, 9 + i] = p[6 + j, 9 + i] + dt * p[9 + j, 9 + i]
    for i in range(3):
        e0, e1, e2 = turn[i, 0], turn[i, 1], turn[i, 2]
        d0, d1, d2 = dt_jacobian[i, 0], dt_jacobian[i, 1], dt_jacobian[i, 2]
        for j in range(i + 1):
            value = e0 * fp[j, 0] + e1 * fp[j, 1] + e2 * fp[j, 2] + (d0 * fp[j, 3] + d1 * fp[j, 4] + d2 * fp[j, 5])
            p[i, j] = p[j, i] = value
        for j in range(3):
            p[3 + i, j] = p[j, 3 + i] = fp[j, 3 + i]
            p[6 + i, j] = p[j, 6 + i] = fp[j, 6 + i] + dt * fp[j, 9 + i]
            p[9 + i, j] = p[j, 9 + i] = fp[j, 9 + i]
            # What stays becomes as symmetric as the rest.
            p[9 + i, 3 + j] = p[3 + j, 9 + i]
        for j in range(i):
            p[3 + i, 3 + j], p[9 + i, 9 + j] = p[3 + j, 3 + i], p[9 + j, 9 + i]
    for first, sigma in ((0, angular_acceleration), (6, acceleration)):
        place, both, rate = sigma * dt * dt / 2, sigma * sigma * dt * dt * dt / 2, sigma * dt
        place, rate = place * place, rate * rate
        for i in range(first, first + 3):
            p[i, i] += place
            p[i, i + 3] += both
            p[i + 3, i] = p[i, i + 3]
            p[i + 3, i + 3] += rate


@kernel
def move_on(state: State, c: int, turn: Floats, dt: float) -> None:
    """Move the pose of craft c on by a step of `dt` [s] at constant rates; turn: (3, 3), E.

    Args:
        state: of C craft, changed in place.
        c: the craft.
        turn: (3, 3), E.
        dt: the step [s].
    """
    turned = np.empty((3, 3))
    multiply_into(turn, state.rotation[c], turned)
    for i in range(3):
        for j in range(3):
            state.rotation[c, i, j] = turned[i, j]
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
    turn, jacobian, fp = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, STATES))
    for c in range(len(mask)):
        if mask[c]:
            step_into(state.angular_rate[c], step[c], turn, jacobian)
            advance(covariance[c], turn, jacobian, step[c], acceleration, angular_acceleration, fp)
            move_on(state, c, turn, step[c])


@kernel
def _picked(h: Floats) -> int:
    """Return the only pose column of a row of H (12,) that is not zero, if it is 1; else -1."""
    found = -1
    for k in range(POSE):
        if h[POSE_COLUMNS[k]] != 0.0:
            if found >= 0 or h[POSE_COLUMNS[k]] != 1.0:
                return -1
            found = POSE_COLUMNS[k]
    return found


class Work(NamedTuple):
    """Places for what updates by up to m rows compute, of numbers or of lanes.

    picked: (m,), columns of `pick`. y: (m,). g: (m, 12). s, lower: (m, m). rest, half: (12, 12). left: (12,). gain:
    (1, 12). scale: (1,).
    """

    picked: Ints
    y: Floats
    g: Floats
    s: Floats
    lower: Floats
    rest: Floats
    half: Floats
    left: Floats
    gain: Floats
    scale: Floats


@kernel
def work_for(most: int) -> Work:
    """Return places for numbers of up to `most` rows."""
    square = np.empty((2, most, most)), np.empty((2, STATES, STATES))
    return Work(
        np.empty(most, np.int64),
        np.empty(most),
        np.empty((most, STATES)),
        square[0][0],
        square[0][1],
        square[1][0],
        square[1][1],
        np.empty(STATES),
        np.empty((1, STATES)),
        np.empty(1),
    )


@formula
def lanes_work_for(most: int) -> Work:
    """Return places for lanes of up to `most` rows."""
    square, large = lanes_in(np.empty((2, most, most, LANES))), lanes_in(np.empty((2, STATES, STATES, LANES)))
    return Work(
        np.empty(most, np.int64),
        lanes_in(np.empty((most, LANES))),
        lanes_in(np.empty((most, STATES, LANES))),
        square[0],
        square[1],
        large[0],
        large[1],
        lanes_in(np.empty((STATES, LANES))),
        lanes_in(np.empty((1, STATES, LANES))),
        lanes_in(np.empty((1, LANES))),
    )


@kernel
def _has_shrunk(before: Floats, left: Floats) -> bool:
    """Return whether less than SHRUNK of a variance is left, of numbers or in any lane; left: (12,), variances."""
    shrunk = left[0] < SHRUNK * before[0, 0]
    for i in range(1, STATES):
        shrunk = shrunk | (left[i] < SHRUNK * before[i, i])
    return any_of(shrunk)


@kernel
def _joseph_into(p: Floats, gain: Floats, h: Floats, r: Floats, n: int, work: Work, out: Floats) -> None:
    """Write (I - K H) P (I - K H)^T + K R K^T into `out` (12, 12).

    Args:
        p: (12, 12), P.
        gain: (m, 12), K^T.
        h: (m, 12), H.
        r: (m, m), R.
        n: number of rows.
        work: places.
        out: (12, 12), may be P.
    """
    rest, half = work.rest, work.half
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
                    total += gain[a, i] * r[a, d] * gain[d, j]
            out[i, j] = out[j, i] = total


@kernel
def pick(h: Floats, n: int, picked: Ints) -> None:
    """Find the rows of H (m, 12), of which n are used, that have a single 1 in their pose columns.

    Args:
        h: (m, 12).
        n: number of rows that are used.
        picked: (m,), receives the column of the 1, or -1.
    """
    for a in range(n):
        picked[a] = _picked(h[a])


@inlined
def weigh_rows(p: Floats, y: Floats, h: Floats, r: Floats, n: int, work: Work, x: Floats) -> tuple[bool, float, float]:
    """Weigh n rows against an error estimate x of covariance P, of numbers or of lanes; return whether S is positive
    definite, NIS, and the root of det S. Z and z stay in `work`, for `take_rows`.

    Sums go by groups: pose columns, then angular rate, then velocity. A row that has a single 1 in its pose columns, as
    those of a solved pose have, H = [I B], picks it instead of summing: the fast path of poses.

    Args:
        p: (12, 12), P.
        y: (m,), innovations of x = 0.
        h: (m, 12), H.
        r: (m, m), R.
        n: number of rows that are used.
        work: places; `picked` of these rows is known (`pick`).
        x: (12,).
    """
    z, g, s, lower, picked = work.y, work.g, work.s, work.lower, work.picked
    for a in range(n):
        value = y[a] - h[a, 0] * x[0]
        for i in range(1, STATES):
            value -= h[a, i] * x[i]
        z[a] = value
    for i in range(STATES):
        w0, w1, w2, v0, v1, v2 = p[3, i], p[4, i], p[5, i], p[9, i], p[10, i], p[11, i]
        for a in range(n):
            if picked[a] >= 0:
                value = p[picked[a], i]
            else:
                value = h[a, 0] * p[0, i] + h[a, 1] * p[1, i] + h[a, 2] * p[2, i]
                value += h[a, 6] * p[6, i] + h[a, 7] * p[7, i] + h[a, 8] * p[8, i]
            value += h[a, 3] * w0 + h[a, 4] * w1 + h[a, 5] * w2
            g[a, i] = value + (h[a, 9] * v0 + h[a, 10] * v1 + h[a, 11] * v2)
    for a in range(n):
        for d in range(a + 1):
            if picked[d] >= 0:
                value = g[a, picked[d]]
            else:
                value = g[a, 0] * h[d, 0] + g[a, 1] * h[d, 1] + g[a, 2] * h[d, 2]
                value += g[a, 6] * h[d, 6] + g[a, 7] * h[d, 7] + g[a, 8] * h[d, 8]
            value += r[a, d]
            value += g[a, 3] * h[d, 3] + g[a, 4] * h[d, 4] + g[a, 5] * h[d, 5]
            value += g[a, 9] * h[d, 9] + g[a, 10] * h[d, 10] + g[a, 11] * h[d, 11]
            s[a, d] = value

    # `cholesky_into`, and by forward substitution Z and z in the places of G and y, a row as soon as its factor is
    # known: a processor then has work while it waits for roots and quotients.
    regular, squared, volume = True, z[0] * 0.0, z[0] * 0.0 + 1.0
    for a in range(n):
        square = s[a, a]
        for k in range(a):
            square -= lower[a, k] * lower[a, k]
        regular = regular & (square > SINGULAR * s[a, a])
        root = np.sqrt(square)
        lower[a, a] = root
        for d in range(a + 1, n):
            value = s[d, a]
            for k in range(a):
                value -= lower[d, k] * lower[a, k]
            lower[d, a] = value / root
        pivot = 1 / root
        value = z[a]
        for k in range(a):
            value -= lower[a, k] * z[k]
        z[a] = value * pivot
        squared += z[a] * z[a]
        volume *= root
        for i in range(STATES):
            value = g[a, i]
            for k in range(a):
                value -= lower[a, k] * g[k, i]
            g[a, i] = value * pivot
    return regular, squared, volume


@inlined
def take_rows(p: Floats, h: Floats, r: Floats, n: int, work: Work, x: Floats) -> None:
    """Take n rows that have been weighed into an error estimate x of covariance P, of numbers or of lanes, in place.

    Args:
        p: (12, 12), P.
        h: (m, 12), H.
        r: (m, m), R.
        n: number of rows that are used.
        work: places, with Z and z of `weigh_rows`.
        x: (12,).
    """
    z, g, lower, left = work.y, work.g, work.lower, work.left
    for i in range(STATES):
        value, own = x[i], p[i, i]
        for a in range(n):
            value += g[a, i] * z[a]
            own -= g[a, i] * g[a, i]
        x[i], left[i] = value, own
    if _has_shrunk(p, left):
        for a in range(n - 1, -1, -1):  # K^T = L^-T Z
            for k in range(a + 1, n):
                factor = lower[k, a]
                for i in range(STATES):
                    g[a, i] -= factor * g[k, i]
            for i in range(STATES):
                g[a, i] /= lower[a, a]
        _joseph_into(p, g, h, r, n, work, p)
        return
    # Two rows and two columns at once: an element of Z serves twice.
    for i in range(0, STATES, 2):
        for j in range(0, i + 1, 2):
            one, two, three, four = p[i, j], p[i, j + 1], p[i + 1, j], p[i + 1, j + 1]
            for a in range(n):
                left0, left1, right0, right1 = g[a, i], g[a, i + 1], g[a, j], g[a, j + 1]
                one -= left0 * right0
                two -= left0 * right1
                three -= left1 * right0
                four -= left1 * right1
            p[i, j], p[i, j + 1], p[i + 1, j], p[i + 1, j + 1] = one, two, three, four
            p[j, i], p[j + 1, i], p[j, i + 1], p[j + 1, i + 1] = one, two, three, four


@kernel
def _joseph_row(p: Floats, h: Floats, variance: float, work: Work) -> None:
    """Take one row of independent noise into P in the form of Joseph, in place.

    The two products with I - K h differ from P, and from each other, by a column times a row:

        M = P - K (P h)^T,   P <- M - (M h) K^T + r K K^T

    Args:
        p: (12, 12), P, of numbers or of lanes.
        h: (12,).
        variance: r, of its noise.
        work: places.
    """
    gain, told, part, left = work.gain[0], work.rest[0], work.rest[1], work.half
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
    p: Floats, y: Floats, h: Floats, variance: Floats, n: int, work: Work, x: Floats, left: Floats
) -> tuple[float, float]:
    """Take n rows of independent noise into an error estimate x of covariance P, of numbers or of lanes; return NIS,
    and the root of det S.

    Args:
        p: (12, 12), P, as it was; spoilt where `left` becomes far smaller.
        y: (m,), innovations of x = 0.
        h: (m, 12), H.
        variance: (m,), of the rows.
        n: number of rows that are used.
        work: places.
        x: (12,), corrected in place.
        left: (12, 12), receives the covariance that is left.
    """
    gain, scale = work.gain, work.scale
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
        squared += absorb_row(left, x, h[a], y[a], variance[a], gain[0], scale)
        volume *= np.sqrt(scale[0])
    for i in range(STATES):
        work.left[i] = left[i, i]
    if _has_shrunk(p, work.left):
        for a in range(n):
            if _tells(h[a]):
                _joseph_row(p, h[a], variance[a], work)
        for i in range(STATES):
            for j in range(STATES):
                left[i, j] = p[i, j]
    return squared, volume


@kernel
def _update_all(mask: Bools, given: Given, state: State, covariance: Floats, result: UpdateResult) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    accepted, nis, log_determinant = result
    work, x = work_for(given.y.shape[1]), np.empty(STATES)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        n = given.rows[c]
        x[:] = 0.0
        pick(given.h[c], n, work.picked)
        regular, nis[c], volume = weigh_rows(covariance[c], given.y[c], given.h[c], given.r[c], n, work, x)
        if not regular:
            return c
        nis[c] += given.square[c]
        log_determinant[c] = 2 * np.log(volume)
        accepted[c] = nis[c] <= given.gate[given.freedoms[c]]
        if accepted[c]:
            take_rows(covariance[c], given.h[c], given.r[c], n, work, x)
            correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1


@kernel
def _update_one_by_one(mask: Bools, given: Independent, state: State, covariance: Floats, result: UpdateResult) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    accepted, nis, log_determinant = result
    work = work_for(given.y.shape[1])
    p, left, x, arms = np.empty((STATES, STATES)), np.empty((STATES, STATES)), np.empty(STATES), np.empty(ARMS)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        x[:], p[:] = 0.0, covariance[c]
        rows = given.y[c], given.h[c], given.variance[c]
        nis[c], volume = absorb_independent(p, *rows, given.rows[c], work, x, left)
        log_determinant[c] = 2 * np.log(volume)
        accepted[c] = nis[c] <= given.gate[given.freedoms[c]]
        if not accepted[c]:
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
        covariance[c] = left
