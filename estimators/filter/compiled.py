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

Rows of independent noise are taken in one after the other (`estimators.linear.absorb_row`), which is the same; where
much of a variance goes, into the root of P (`estimators.linear.absorb_by_root`) in the place of the form of Joseph.

filterpy takes S^-1 and the Joseph form instead. In exact arithmetic they are the same; in ours they differ by the
rounding of P, some 1e-13 of it (tested: every column of the telemetry to 1e-9).
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank, Given, Independent, UpdateResult
from estimators.filter.error_state import (
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
    correct,
)
from estimators.kernel import kernel
from estimators.linear import absorb_by_root, absorb_row, cholesky_into, square_of_root_into
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
def _advance_rows(p: Floats, turn: Floats, dt_jacobian: Floats, dt: float, out: Floats) -> None:
    """Write F P, (12, 12), into `out`."""
    for i in range(3):
        e0, e1, e2 = turn[i, 0], turn[i, 1], turn[i, 2]
        d0, d1, d2 = dt_jacobian[i, 0], dt_jacobian[i, 1], dt_jacobian[i, 2]
        for j in range(STATES):
            out[i, j] = e0 * p[0, j] + e1 * p[1, j] + e2 * p[2, j] + (d0 * p[3, j] + d1 * p[4, j] + d2 * p[5, j])
            out[3 + i, j] = p[3 + i, j]
            out[6 + i, j] = p[6 + i, j] + dt * p[9 + i, j]
            out[9 + i, j] = p[9 + i, j]


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
    turn, jacobian, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    vector = np.empty(3)
    once, other_way, twice = np.empty((STATES, STATES)), np.empty((STATES, STATES)), np.empty((STATES, STATES))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        dt, p = step[c], covariance[c]
        for i in range(3):
            vector[i] = state.angular_rate[c, i] * dt
        exp_into(vector, turn)
        left_jacobian_into(vector, jacobian)
        for i in range(3):
            for j in range(3):
                jacobian[i, j] *= dt
        _advance_rows(p, turn, jacobian, dt, once)
        for i in range(STATES):
            for j in range(STATES):
                other_way[i, j] = once[j, i]
        _advance_rows(other_way, turn, jacobian, dt, twice)
        for i in range(STATES):
            for j in range(i + 1):
                p[i, j] = p[j, i] = twice[i, j]
        for i in range(STATES):
            sigma = angular_acceleration if i < 6 else acceleration
            if i % 6 < 3:
                p[i, i] += (sigma * dt * dt / 2) ** 2
                p[i, i + 3] += sigma * sigma * dt * dt * dt / 2
                p[i + 3, i] = p[i, i + 3]
            else:
                p[i, i] += (sigma * dt) ** 2
        multiply_into(turn, state.rotation[c], turned)
        for i in range(3):
            for j in range(3):
                state.rotation[c, i, j] = turned[i, j]
            state.position[c, i] += state.velocity[c, i] * dt


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


@kernel
def _has_shrunk(before: Floats, after: Floats) -> bool:
    """Return whether less than SHRUNK of a variance is left."""
    shrunk = False
    for i in range(STATES):
        shrunk = shrunk or after[i, i] < SHRUNK * before[i, i]
    return shrunk


@kernel
def _joseph_into(p: Floats, gain: Floats, h: Floats, r: Floats, out: Floats) -> None:
    """Write (I - K H) P (I - K H)^T + K R K^T into `out` (12, 12).

    Args:
        p: (12, 12), P.
        gain: (n, 12), K^T.
        h: (n, 12), H.
        r: (n, n), R.
        out: (12, 12).
    """
    n = len(gain)
    rest, half = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    for i in range(STATES):
        for j in range(STATES):
            rest[i, j] = 1.0 if i == j else 0.0
            for a in range(n):
                rest[i, j] -= gain[a, i] * h[a, j]
    for i in range(STATES):
        for j in range(STATES):
            half[i, j] = 0.0
            for k in range(STATES):
                half[i, j] += rest[i, k] * p[k, j]
    for i in range(STATES):
        for j in range(i + 1):
            total = 0.0
            for k in range(STATES):
                total += half[i, k] * rest[j, k]
            for a in range(n):
                for d in range(n):
                    total += gain[a, i] * r[a, d] * gain[d, j]
            out[i, j] = out[j, i] = total


@kernel
def _update_all(mask: Bools, given: Given, state: State, covariance: Floats, result: UpdateResult) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite.

    Sums go by groups: pose columns, then angular rate, then velocity. A row that has a single 1 in its pose columns, as
    those of a solved pose have, H = [I B], picks it instead of summing: the fast path of poses.
    """
    accepted, nis, log_determinant = result
    most = given.y.shape[1]
    y, g = np.empty(most), np.empty((most, STATES))
    s, lower = np.empty((most, most)), np.zeros((most, most))
    left = np.empty((STATES, STATES))
    x, total, picked = np.empty(STATES), np.empty(STATES), np.empty(most, np.int64)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        p, h, n = covariance[c], given.h[c], given.rows[c]
        for a in range(n):
            y[a] = given.y[c, a]
            picked[a] = _picked(h[a])
            if picked[a] >= 0:
                g[a] = p[picked[a]]
            else:
                g[a] = 0.0
                for k in range(POSE):
                    row = p[POSE_COLUMNS[k]]
                    for i in range(STATES):
                        g[a, i] += h[a, POSE_COLUMNS[k]] * row[i]
            b0, b1, b2, b3, b4, b5 = h[a, 3], h[a, 4], h[a, 5], h[a, 9], h[a, 10], h[a, 11]
            for i in range(STATES):
                g[a, i] = (
                    g[a, i]
                    + (b0 * p[3, i] + b1 * p[4, i] + b2 * p[5, i])
                    + (b3 * p[9, i] + b4 * p[10, i] + b5 * p[11, i])
                )
        for a in range(n):
            for d in range(a + 1):
                if picked[d] >= 0:
                    value = g[a, picked[d]]
                else:
                    value = 0.0
                    for k in range(POSE):
                        value += g[a, POSE_COLUMNS[k]] * h[d, POSE_COLUMNS[k]]
                value += given.r[c, a, d]
                for k in range(POSE):
                    value += g[a, RATE_COLUMNS[k]] * h[d, RATE_COLUMNS[k]]
                s[a, d] = value
        if not cholesky_into(s[:n, :n], lower[:n, :n]):
            return c

        # Z and z by forward substitution, in the places of G and y.
        for a in range(n):
            for k in range(a):
                factor = lower[a, k]
                y[a] -= factor * y[k]
                for i in range(STATES):
                    g[a, i] -= factor * g[k, i]
            pivot = 1 / lower[a, a]
            y[a] *= pivot
            for i in range(STATES):
                g[a, i] *= pivot
        squared = 0.0
        for a in range(n):
            squared += y[a] * y[a]
        nis[c], log_determinant[c] = squared, 0.0
        for a in range(n):
            log_determinant[c] += 2 * np.log(lower[a, a])
        accepted[c] = squared <= given.gate[n]
        if not accepted[c]:
            continue

        for i in range(STATES):
            value = 0.0
            for a in range(n):
                value += g[a, i] * y[a]
            x[i] = value
            total[:] = 0.0
            for a in range(0, n - 2, 3):
                u, v, w = g[a, i], g[a + 1, i], g[a + 2, i]
                for j in range(STATES):
                    total[j] += u * g[a, j] + v * g[a + 1, j] + w * g[a + 2, j]
            for a in range(n - n % 3, n):
                for j in range(STATES):
                    total[j] += g[a, i] * g[a, j]
            for j in range(STATES):
                left[i, j] = p[i, j] - total[j]
        if _has_shrunk(p, left):
            for a in range(n - 1, -1, -1):  # K^T = L^-T Z
                for k in range(a + 1, n):
                    factor = lower[k, a]
                    for i in range(STATES):
                        g[a, i] -= factor * g[k, i]
                for i in range(STATES):
                    g[a, i] /= lower[a, a]
            _joseph_into(p, g[:n], h[:n], given.r[c, :n, :n], left)
        p[:] = left
        correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1


@kernel
def _update_one_by_one(mask: Bools, given: Independent, state: State, covariance: Floats, result: UpdateResult) -> None:
    """Take in the rows of the craft of the mask, one after the other."""
    accepted, nis, log_determinant = result
    p, x, gain = np.empty((STATES, STATES)), np.empty(STATES), np.empty(STATES)
    left, root, work = np.empty((STATES, STATES)), np.empty((STATES, STATES)), np.empty((2, STATES))
    arms, scale = np.empty(ARMS), np.empty(1)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        p[:] = covariance[c]
        x[:] = 0.0
        squared, spread, n = 0.0, 0.0, given.rows[c]
        for a in range(n):
            squared += absorb_row(p, x, given.h[c, a], given.y[c, a], given.variance[c, a], gain, scale)
            spread += np.log(scale[0])
        nis[c], log_determinant[c] = squared, spread
        accepted[c] = squared <= given.gate[n]
        if not accepted[c]:
            continue

        if _has_shrunk(covariance[c], p) and cholesky_into(covariance[c], left):
            for i in range(STATES):
                for j in range(STATES):
                    root[i, j] = left[j, i]
            for a in range(n):
                absorb_by_root(root, given.h[c, a], given.variance[c, a], work)
            square_of_root_into(root, p)
        turn_about(
            state.rotation[c],
            state.angular_rate[c],
            state.position[c],
            state.velocity[c],
            x,
            given.pivot[c],
            arms,
        )
        if is_wide(p):
            shear(p, arms)
        covariance[c] = p
