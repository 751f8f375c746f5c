"""One period of telemetry, all craft at once: poses as quaternions, errors, sigmas and NEES, as one kernel.

The errors are active and left, R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the
EKF's covariance NEES = e^T P^-1 e, e = (d, dp). Quaternions are wxyz, w >= 0. What is missing is NaN.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.linear import cholesky_into
from estimators.rotation import quaternion_between, quaternion_from_matrix_into


class Rows(NamedTuple):
    """Rows of a block at which the columns of one quantity begin: a pose has seven, the errors seven, rates six.

    They are an argument, not globals: the compiled kernel in the cache on disk would keep old globals.
    """

    true: int
    pnp: int
    ekf: int
    errors: int
    true_rates: int
    ekf_rates: int


@kernel
def _error_into(a: Floats, true_position: Floats, b: Floats, position: Floats, out: Floats) -> tuple[float, float]:
    """Write (d, dp) (6,) of an estimate b (4,), position (3,) against the truth a (4,); its distance and its angle."""
    # Exp([d]x) = R_true R_est^T as quaternions: q_true times the conjugate of q_est.
    w, x, y, z = quaternion_between(a, b)
    sine = np.sqrt(x * x + y * y + z * z)
    angle = 2 * np.arctan2(sine, abs(w))
    scale = (angle / sine if sine > 0 else 2.0) * (-1 if w < 0 else 1)
    out[0], out[1], out[2] = scale * x, scale * y, scale * z
    for i in range(3):
        out[3 + i] = true_position[i] - position[i]
    return np.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5]), angle


@kernel
def attitude_errors_into(truth: Floats, estimate: Floats, out: Floats) -> None:
    """Write d (n, 3) [rad], R_est = Exp([d]x) R_true, of quaternions (n, 4) into `out`."""
    nowhere, e = np.zeros(3), np.empty(6)
    for i in range(len(out)):
        _error_into(truth[i], nowhere, estimate[i], nowhere, e)
        for k in range(3):
            out[i, k] = -e[k]


@kernel
def _pose_into(position: Floats, quaternion: Floats, out: Floats, row: int, column: int) -> None:
    """Write a pose into seven rows of a block, with w >= 0."""
    sign = -1.0 if quaternion[0] < 0 else 1.0
    for i in range(3):
        out[row + i, column] = position[i]
    for i in range(4):
        out[row + 3 + i, column] = sign * quaternion[i]


@kernel
def rows_into(
    rows: Rows,
    true_position: Floats,
    true_quaternion: Floats,
    true_velocity: Floats,
    true_rate: Floats,
    pnp_rotation: Floats,
    pnp_position: Floats,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    rate: Floats,
    covariance: Floats,
    out: Floats,
) -> None:
    """Write poses, errors and rates of C craft into the rows of `out` (columns, C).

    Args:
        rows: Where they go.
        true_position: (C, 3) [m]; with true_quaternion (C, 4), true_velocity (C, 3) [m/s], true_rate (C, 3) [rad/s].
        true_quaternion: See above.
        true_velocity: See above.
        true_rate: See above.
        pnp_rotation: (C, 3, 3), with pnp_position (C, 3) [m]: the solution of PnP.
        pnp_position: See above.
        rotation: (C, 3, 3), with position, velocity, rate (C, 3) and covariance (C, 12, 12): the filter's estimate.
        position: See above.
        velocity: See above.
        rate: See above.
        covariance: See above.
        out: Filled; the errors are in the order of `swarm.results.records.Errors`.
    """
    pose, lower = np.empty((6, 6)), np.empty((6, 6))
    e, q, errors = np.empty(6), np.empty(4), np.empty(7)
    for c in range(out.shape[1]):
        _pose_into(true_position[c], true_quaternion[c], out, rows.true, c)
        quaternion_from_matrix_into(pnp_rotation[c], q)
        _pose_into(pnp_position[c], q, out, rows.pnp, c)
        distance, angle = _error_into(true_quaternion[c], true_position[c], q, pnp_position[c], e)
        errors[0], errors[1] = distance, np.degrees(angle)

        quaternion_from_matrix_into(rotation[c], q)
        _pose_into(position[c], q, out, rows.ekf, c)
        distance, angle = _error_into(true_quaternion[c], true_position[c], q, position[c], e)
        errors[2], errors[3] = distance, np.degrees(angle)
        p = covariance[c]
        errors[4] = np.sqrt(p[6, 6] + p[7, 7] + p[8, 8])
        errors[5] = np.degrees(np.sqrt(p[0, 0] + p[1, 1] + p[2, 2]))
        for i in range(6):
            for j in range(i + 1):
                pose[i, j] = p[i if i < 3 else i + 3, j if j < 3 else j + 3]
        errors[6] = np.nan
        if np.isfinite(e[0] + e[5]) and cholesky_into(pose, lower):
            nees = 0.0
            for i in range(6):
                for j in range(i):
                    e[i] -= lower[i, j] * e[j]
                e[i] /= lower[i, i]
                nees += e[i] * e[i]
            errors[6] = nees

        for i in range(7):
            out[rows.errors + i, c] = errors[i]
        for i in range(3):
            out[rows.true_rates + i, c], out[rows.true_rates + 3 + i, c] = true_velocity[c, i], true_rate[c, i]
            out[rows.ekf_rates + i, c], out[rows.ekf_rates + 3 + i, c] = velocity[c, i], rate[c, i]
