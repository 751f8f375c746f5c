"""Errors of C craft at one epoch, all at once: quaternions, distances and angles, sigmas and NEES, as kernels.

The errors are active and left, R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the
EKF's covariance NEES = e^T P^-1 e, e = (d, dp). Quaternions are wxyz, w >= 0. What is missing is NaN.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.linear import cholesky_into
from estimators.rotation import quaternion_between, quaternion_from_matrix_into
from estimators.scratch import scratch

POSE_ROWS = 6
"""Degrees of freedom of a pose's innovation."""


def referred_nis(nis: Floats, rows: Floats | Ints) -> Floats:
    """Return NIS (n,) as if all were of poses: those of single sweeps get mean and variance of 6 degrees of freedom.

    rows: number of single sweeps that were taken in, (n,); zero for a pose, or where they were refused.
    """
    known = rows > 0
    dof = np.where(known, rows, POSE_ROWS)
    out: Floats = np.where(known, POSE_ROWS + (nis - dof) * np.sqrt(POSE_ROWS / dof), nis)
    return out


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
    """Write d, R_est = Exp([d]x) R_true, into `out`.

    Args:
        truth: (4, n).
        estimate: (4, n).
        out: (3, n) [rad].
    """
    nowhere, e = scratch(0.0, 3), scratch(0.0, 6)
    nowhere[:] = 0.0
    for i in range(out.shape[1]):
        _error_into(truth[:, i], nowhere, estimate[:, i], nowhere, e)
        for k in range(3):
            out[k, i] = -e[k]


@kernel
def quaternions_into(rotation: Floats, out: Floats) -> None:
    """Write the quaternions (C, 4), w >= 0, of rotations (C, 3, 3) into `out`."""
    for c in range(len(out)):
        quaternion_from_matrix_into(rotation[c], out[c])


@kernel
def pose_errors_into(
    true_position: Floats, true_quaternion: Floats, position: Floats, quaternion: Floats, out: Floats
) -> None:
    """Write distance [m] and angle [deg] of poses from the truth into `out`.

    Args:
        true_position: (C, 3) [m].
        true_quaternion: (C, 4).
        position: (C, 3) [m].
        quaternion: (C, 4).
        out: (2, C).
    """
    e = scratch(0.0, 6)
    for c in range(out.shape[1]):
        distance, angle = _error_into(true_quaternion[c], true_position[c], quaternion[c], position[c], e)
        out[0, c], out[1, c] = distance, np.degrees(angle)


@kernel
def estimate_errors_into(
    true_position: Floats,
    true_quaternion: Floats,
    position: Floats,
    quaternion: Floats,
    covariance: Floats,
    out: Floats,
) -> None:
    """Write distance [m] and angle [deg] of estimates from the truth, their sigmas [m], [deg] and NEES into `out`.

    Args:
        true_position: (C, 3) [m].
        true_quaternion: (C, 4).
        position: (C, 3) [m].
        quaternion: (C, 4).
        covariance: (C, 12, 12) of attitude, angular rate, position, velocity.
        out: (5, C).
    """
    pose, lower, e = scratch(0.0, 6, 6), scratch(0.0, 6, 6), scratch(0.0, 6)
    for c in range(out.shape[1]):
        distance, angle = _error_into(true_quaternion[c], true_position[c], quaternion[c], position[c], e)
        out[0, c], out[1, c] = distance, np.degrees(angle)
        p = covariance[c]
        out[2, c] = np.sqrt(p[6, 6] + p[7, 7] + p[8, 8])
        out[3, c] = np.degrees(np.sqrt(p[0, 0] + p[1, 1] + p[2, 2]))
        for i in range(6):
            for j in range(i + 1):
                pose[i, j] = p[i if i < 3 else i + 3, j if j < 3 else j + 3]
        out[4, c] = np.nan
        if np.isfinite(e[0] + e[5]) and cholesky_into(pose, lower):
            nees = 0.0
            for i in range(6):
                for j in range(i):
                    e[i] -= lower[i, j] * e[j]
                e[i] /= lower[i, i]
                nees += e[i] * e[i]
            out[4, c] = nees
