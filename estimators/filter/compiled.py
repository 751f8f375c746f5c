"""The filter of record as one compiled loop over the craft: equations of `estimators.filter.error_state`, numbers of
filterpy.

With F = [[E, D], [0, I]] for (attitude, angular rate), [[I, dt I], [0, I]] for (position, velocity), and y = H x +
noise of covariance R, the usual forms are regrouped so that nothing is inverted:

    P <- F (F P)^T + Q                                 P is symmetric
    G = H P,  S = G H^T + R = L L^T,  Z = L^-1 G,  z = L^-1 y
    NIS = z^T z,   x = Z^T z,   P <- P - Z^T Z

filterpy takes S^-1 and the Joseph form instead. In exact arithmetic they are the same; in ours they differ by the
rounding of P, some 1e-13 of it (tested: every column of the telemetry to 1e-9).
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank, Given
from estimators.filter.error_state import (
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
    correct,
)
from estimators.kernel import kernel
from estimators.linear import cholesky_into
from estimators.rotation import exp_into, left_jacobian_into, multiply_into
from estimators.state import State


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

    def _update(self, mask: Bools, given: Given, accepted: Bools, nis: Floats) -> int:
        return _update_all(mask, given, self._state, self._covariance, accepted, nis)


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
def _update_all(mask: Bools, given: Given, state: State, covariance: Floats, accepted: Bools, nis: Floats) -> int:
    """Take in the rows of the craft of the mask; -1, or the first craft whose S is not positive definite.

    Sums go by groups: pose columns, then angular rate, then velocity. A row that has a single 1 in its pose columns, as
    those of a solved pose have, H = [I B], picks it instead of summing: the fast path of poses.
    """
    most = given.y.shape[1]
    y, g = np.empty(most), np.empty((most, STATES))
    s, lower = np.empty((most, most)), np.zeros((most, most))
    x, total, picked = np.empty((STATES, 1)), np.empty(STATES), np.empty(most, np.int64)
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
        nis[c] = squared
        accepted[c] = squared <= given.gate[n]
        if not accepted[c]:
            continue

        for i in range(STATES):
            value = 0.0
            for a in range(n):
                value += g[a, i] * y[a]
            x[i, 0] = value
            total[:] = 0.0
            for a in range(0, n - 2, 3):
                u, v, w = g[a, i], g[a + 1, i], g[a + 2, i]
                for j in range(STATES):
                    total[j] += u * g[a, j] + v * g[a + 1, j] + w * g[a + 2, j]
            for a in range(n - n % 3, n):
                for j in range(STATES):
                    total[j] += g[a, i] * g[a, j]
            for j in range(STATES):
                p[i, j] -= total[j]
        correct(state.rotation[c], state.angular_rate[c], state.position[c], state.velocity[c], x)
    return -1
