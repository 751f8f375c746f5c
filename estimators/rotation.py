"""Rotations: matrices, rotation vectors and quaternions, for any leading batch shape.

A rotation matrix R_a_b maps b coordinates to a. Rotation vectors are active, R = Exp([v]x); the passive vector of
source 1, R_l_b = exp(-[phi]x) (5), is converted here and nowhere else. Quaternions are wxyz; `xyzw_from_wxyz` and
`wxyz_from_xyzw` are the only places where they are reordered.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel

SMALL_ANGLE = 1e-4
"""Below this angle [rad] a series serves: its first neglected term, angle^4 / 120, is under one rounding error."""


def skew(v: Floats) -> Floats:
    """Cross-product matrices [v]x, (..., 3, 3), of vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _series(angle: Floats) -> tuple[Floats, Floats, Floats]:
    """sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3, finite at zero."""
    small = angle < SMALL_ANGLE
    a = np.where(small, 1.0, angle)
    square = angle**2
    sine = np.where(small, 1 - square / 6, np.sin(a) / a)
    # 2 sin^2(a/2) instead of 1 - cos(a), which cancels for small angles.
    cosine = np.where(small, 0.5 - square / 24, 2 * np.sin(a / 2) ** 2 / a**2)
    third = np.where(angle < 1e-2, 1 / 6 - square / 120 + square**2 / 5040, (a - np.sin(a)) / a**3)
    return sine, cosine, third


def exp(v: Floats) -> Floats:
    """Rotation matrices Exp([v]x), (..., 3, 3), of active rotation vectors (..., 3) [rad] (Rodrigues)."""
    sine, cosine, _ = _series(np.linalg.norm(v, axis=-1))
    k = skew(v)
    out: Floats = np.eye(3) + sine[..., None, None] * k + cosine[..., None, None] * (k @ k)
    return out


def log(rotation: Floats) -> Floats:
    """Active rotation vectors (..., 3) [rad], length at most pi, of rotation matrices (..., 3, 3)."""
    q = quaternion_from_matrix(rotation)
    vector = q[..., 1:]
    sine = np.linalg.norm(vector, axis=-1)
    half = np.arctan2(sine, q[..., 0])
    small = sine < SMALL_ANGLE
    scale = np.where(small, 2 + sine**2 / 3, 2 * half / np.where(small, 1.0, sine))
    out: Floats = scale[..., None] * vector
    return out


def left_jacobian(v: Floats) -> Floats:
    """J_l, (..., 3, 3), with Exp(v + d) = Exp(J_l(v) d) Exp(v) to first order in d."""
    _, cosine, third = _series(np.linalg.norm(v, axis=-1))
    k = skew(v)
    out: Floats = np.eye(3) + cosine[..., None, None] * k + third[..., None, None] * (k @ k)
    return out


def matrix_from_quaternion(q: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4) wxyz."""
    out = np.empty((*q.shape[:-1], 3, 3))
    _matrices_into(np.ascontiguousarray(q, dtype=np.float64).reshape(-1, 4), out.reshape(-1, 3, 3))
    return out


@kernel
def _matrices_into(q: Floats, out: Floats) -> None:
    for n in range(len(q)):
        w, x, y, z = q[n, 0], q[n, 1], q[n, 2], q[n, 3]
        out[n, 0, 0], out[n, 1, 1] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z)
        out[n, 2, 2] = 1 - 2 * (x * x + y * y)
        out[n, 0, 1], out[n, 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
        out[n, 0, 2], out[n, 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
        out[n, 1, 2], out[n, 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)


def quaternion_from_matrix(rotation: Floats) -> Floats:
    """Unit quaternions (..., 4) wxyz with w >= 0 of rotation matrices (..., 3, 3), by Shepperd's method."""
    m = rotation
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Row k of `rows` is the quaternion times four times its k-th component: take the best conditioned one.
    rows = np.empty((*m.shape[:-2], 4, 4))
    rows[..., 0, 0], rows[..., 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    rows[..., 2, 2], rows[..., 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    for i, j, k in ((1, 2, 3), (2, 3, 1), (3, 1, 2)):
        a, b = j - 1, k - 1
        rows[..., 0, i] = rows[..., i, 0] = m[..., b, a] - m[..., a, b]
        rows[..., j, k] = rows[..., k, j] = m[..., b, a] + m[..., a, b]
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    out: Floats = np.where(q[..., :1] < 0, -q, q)
    return out


def quaternion_multiply(a: Floats, b: Floats) -> Floats:
    """Hamilton product a b of quaternions (..., 4) wxyz: the rotation b, then a."""
    aw, bw = a[..., :1], b[..., :1]
    av, bv = a[..., 1:], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    out: Floats = np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)
    return out


def xyzw_from_wxyz(q: Floats) -> Floats:
    """Quaternions (..., 4) in the order of SciPy and rerun."""
    return np.roll(q, -1, axis=-1)


def wxyz_from_xyzw(q: Floats) -> Floats:
    """Quaternions (..., 4) from the order of SciPy and rerun."""
    return np.roll(q, 1, axis=-1)


def angle_between(a: Floats, b: Floats) -> Floats:
    """Angle [rad] of a b^T, shape (...), of rotation matrices (..., 3, 3), as in (25)."""
    out: Floats = np.linalg.norm(log(a @ np.swapaxes(b, -1, -2)), axis=-1)
    return out


def mean_rotation(rotation: Floats) -> Floats:
    """The rotation (3, 3) nearest to all of (N, 3, 3) in the chordal sense: the mean that (23) needs."""
    u, _, vt = np.linalg.svd(rotation.sum(axis=0))
    out: Floats = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return out


def passive_vector(rotation: Floats) -> Floats:
    """Source 1's rotation vectors phi (..., 3) [rad], R = exp(-[phi]x) (5), of matrices (..., 3, 3)."""
    return -log(rotation)


def matrix_from_passive_vector(phi: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of source 1's rotation vectors phi (..., 3) [rad] (5)."""
    return exp(-phi)


def passive_jacobian(phi: Floats) -> Floats:
    """J_r of (9), (..., 3, 3): the rotation error J_r dphi of a passive vector's error dphi (21)."""
    return left_jacobian(-phi)


@kernel
def sine_cosine(square: float) -> tuple[float, float]:
    """sin(a)/a and (1 - cos a)/a^2 of Rodrigues' formula, from a^2."""
    if square < 1e-2:
        # Taylor: the first neglected terms are below 1e-17, and no sine has to be called for a turn within a period.
        s = 1 - square * (1 / 6) * (1 - square * (1 / 20) * (1 - square * (1 / 42) * (1 - square * (1 / 72))))
        c = 0.5 - square * (1 / 24) * (1 - square * (1 / 30) * (1 - square * (1 / 56) * (1 - square * (1 / 90))))
        return s, c
    angle = np.sqrt(square)
    half = np.sin(angle / 2)
    return np.sin(angle) / angle, 2 * half * half / square


@kernel
def exp_into(v: Floats, out: Floats) -> None:
    """Write Exp([v]x) of one rotation vector (3,) [rad] into `out` (3, 3)."""
    x, y, z = v[0], v[1], v[2]
    s, c = sine_cosine(x * x + y * y + z * z)
    out[0, 0], out[0, 1], out[0, 2] = 1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    out[1, 0], out[1, 1], out[1, 2] = c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x
    out[2, 0], out[2, 1], out[2, 2] = c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)


@kernel
def multiply_into(a: Floats, b: Floats, out: Floats) -> None:
    """Write the product a b of two (3, 3) matrices into `out`, which must be neither."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
