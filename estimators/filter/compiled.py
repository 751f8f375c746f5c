"""The filter of record as one compiled loop over the craft: equations of `estimators.filter.error_state`, numbers of
filterpy.

With F = [[E, D], [0, I]] for (attitude, angular rate), [[I, dt I], [0, I]] for (position, velocity), and H = [I B] of
the innovation y, R = s^2 H of (18), the usual forms are regrouped so that nothing is inverted:

    P <- F (F P)^T + Q                                 P is symmetric
    G = H P,  S = G H^T + R = L L^T,  Z = L^-1 G,  z = L^-1 y
    NIS = z^T z,   x = Z^T z,   P <- P - Z^T Z

filterpy takes S^-1 and the Joseph form instead. In exact arithmetic they are the same; in ours they differ by the
rounding of P, some 1e-13 of it (tested: every column of the telemetry to 1e-9).
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.error_state import (
    POSE,
    POSE_COLUMNS,
    RATE_COLUMNS,
    STATES,
    correct,
)
from estimators.kernel import kernel
from estimators.linear import cholesky_into
from estimators.rotation import exp_into, left_jacobian_into, log_into, multiply_into


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
            self._rotation,
            self._angular_rate,
            self._position,
            self._velocity,
            self._covariance,
        )

    def _update(
        self,
        mask: Bools,
        rotation: Floats,
        position: Floats,
        covariance: Floats,
        rate_coupling: Floats,
        accepted: Bools,
        nis: Floats,
    ) -> None:
        state = self._rotation, self._angular_rate, self._position, self._velocity, self._covariance
        indefinite = _update_all(mask, rotation, position, covariance, rate_coupling, self.gate, *state, accepted, nis)
        if indefinite >= 0:
            raise ValueError(f"covariance: not positive definite for craft {indefinite}")


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
    rotation: Floats,
    angular_rate: Floats,
    position: Floats,
    velocity: Floats,
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
            vector[i] = angular_rate[c, i] * dt
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
        multiply_into(turn, rotation[c], turned)
        for i in range(3):
            for j in range(3):
                rotation[c, i, j] = turned[i, j]
            position[c, i] += velocity[c, i] * dt


@kernel
def _update_all(
    mask: Bools,
    rotation_z: Floats,
    position_z: Floats,
    noise: Floats,
    rate_coupling: Floats,
    gate: float,
    rotation: Floats,
    angular_rate: Floats,
    position: Floats,
    velocity: Floats,
    covariance: Floats,
    accepted: Bools,
    nis: Floats,
) -> int:
    """Take in the poses of the craft of the mask; -1, or the first craft whose S is not positive definite."""
    difference, y = np.empty((3, 3)), np.empty(POSE)
    g, s, lower = np.empty((POSE, STATES)), np.empty((POSE, POSE)), np.zeros((POSE, POSE))
    x = np.empty((STATES, 1))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        p, b = covariance[c], rate_coupling[c]
        multiply_into(rotation_z[c], rotation[c].T, difference)
        log_into(difference, y[:3])
        for i in range(3):
            y[3 + i] = position_z[c, i] - position[c, i]

        for a in range(POSE):
            row = p[POSE_COLUMNS[a]]
            b0, b1, b2, b3, b4, b5 = b[a, 0], b[a, 1], b[a, 2], b[a, 3], b[a, 4], b[a, 5]
            for i in range(STATES):
                g[a, i] = (
                    row[i]
                    + (b0 * p[3, i] + b1 * p[4, i] + b2 * p[5, i])
                    + (b3 * p[9, i] + b4 * p[10, i] + b5 * p[11, i])
                )
        for a in range(POSE):
            for d in range(a + 1):
                value = g[a, POSE_COLUMNS[d]] + noise[c, a, d]
                for k in range(POSE):
                    value += g[a, RATE_COLUMNS[k]] * b[d, k]
                s[a, d] = value
        if not cholesky_into(s, lower):
            return c

        # Z and z by forward substitution, in the places of G and y.
        for a in range(POSE):
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
        for a in range(POSE):
            squared += y[a] * y[a]
        nis[c] = squared
        accepted[c] = squared <= gate
        if not accepted[c]:
            continue

        for i in range(STATES):
            value = 0.0
            for a in range(POSE):
                value += g[a, i] * y[a]
            x[i, 0] = value
            for j in range(STATES):
                p[i, j] -= (
                    g[0, i] * g[0, j]
                    + g[1, i] * g[1, j]
                    + g[2, i] * g[2, j]
                    + (g[3, i] * g[3, j] + g[4, i] * g[4, j] + g[5, i] * g[5, j])
                )
        correct(rotation[c], angular_rate[c], position[c], velocity[c], x)
    return -1
