"""Errors of C craft at one epoch, all at once: quaternions, distances and angles, sigmas and NEES, as kernels.

The errors are active and left, R_true = Exp([d]x) R_est and p_true = p_est + dp, and with the 6x6 pose part P of the
EKF's covariance NEES = e^T P^-1 e, e = (d, dp). Quaternions are wxyz, w >= 0. What is missing is NaN.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import WIDE, select, wide_in
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
def attitude_errors_into(truth: tuple[Floats, ...], estimate: tuple[Floats, ...], out: tuple[Floats, ...]) -> None:
    """Write d, R_est = Exp([d]x) R_true, into `out`, NaN where a component is missing.

    Args:
        truth: The four components of quaternions, (n,) each.
        estimate: Likewise.
        out: The three of d, (n,) each [rad].
    """
    nowhere, a, b, e = scratch(0.0, 3), scratch(0.0, 4), scratch(0.0, 4), scratch(0.0, 6)
    nowhere[:] = 0.0
    for i in range(len(out[0])):
        a[0], a[1], a[2], a[3] = truth[0][i], truth[1][i], truth[2][i], truth[3][i]
        b[0], b[1], b[2], b[3] = estimate[0][i], estimate[1][i], estimate[2][i], estimate[3][i]
        _error_into(a, nowhere, b, nowhere, e)
        out[0][i], out[1][i], out[2][i] = -e[0], -e[1], -e[2]


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
    own, e, pose = scratch(0.0, 6), scratch(0.0, 6, WIDE), scratch(0.0, 6, 6, WIDE)
    errors, poses = wide_in(e), wide_in(pose)
    lower, craft = scratch(poses, 6, 6), out.shape[1]
    for first in range(0, craft, WIDE):
        count = min(WIDE, craft - first)
        for lane in range(WIDE):
            # Where craft end, the last one fills the lanes.
            c = first + min(lane, count - 1)
            distance, angle = _error_into(true_quaternion[c], true_position[c], quaternion[c], position[c], own)
            out[0, c], out[1, c] = distance, np.degrees(angle)
            p = covariance[c]
            out[2, c] = np.sqrt(p[6, 6] + p[7, 7] + p[8, 8])
            out[3, c] = np.degrees(np.sqrt(p[0, 0] + p[1, 1] + p[2, 2]))
            for i in range(6):
                e[i, lane] = own[i]
                for j in range(i + 1):
                    pose[i, j, lane] = p[i if i < 3 else i + 3, j if j < 3 else j + 3]
        regular, nees = cholesky_into(poses, lower), 0.0
        for i in range(6):
            x = errors[i]
            for j in range(i):
                x -= lower[i, j] * errors[j]
            x /= lower[i, i]
            errors[i] = x
            nees += x * x
        errors[0] = select(regular, nees, np.nan)
        for lane in range(count):
            out[4, first + lane] = e[0, lane]
