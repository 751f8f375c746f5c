"""Rotations: matrices, rotation vectors and quaternions, for any leading batch shape, and as kernels for one.

A rotation matrix R_a_b maps b coordinates to a. Rotation vectors are active, R = Exp([v]x); the passive vector of
source 1, R_l_b = exp(-[phi]x) (5), is converted here and nowhere else. Quaternions are wxyz; `xyzw_from_wxyz` and
`wxyz_from_xyzw` are the only places where they are reordered.

Kernels, whose names end in `_into` or which return tuples, stand after the array forms. An array form and its kernel
may differ in their last bits.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import inlined, kernel
from estimators.lanes import all_of, lane, width, with_lane
from estimators.scratch import scratch

Row = tuple[float, float, float]
Rows = tuple[Row, Row, Row]
"""The rows of one rotation matrix."""

SMALL_ANGLE = 1e-4
"""Below this angle [rad] a series serves: its first neglected term, angle^4 / 120, is under one rounding error."""


def skew(v: Floats) -> Floats:
    """Return the cross-product matrices [v]x, (..., 3, 3), of vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _series(angle: Floats) -> tuple[Floats, Floats, Floats]:
    """Return sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3, finite at zero."""
    small = angle < SMALL_ANGLE
    a = np.where(small, 1.0, angle)
    square = angle**2
    sine = np.where(small, 1 - square / 6, np.sin(a) / a)
    # 2 sin^2(a/2) instead of 1 - cos(a), which cancels for small angles.
    cosine = np.where(small, 0.5 - square / 24, 2 * np.sin(a / 2) ** 2 / a**2)
    third = np.where(angle < 1e-2, 1 / 6 - square / 120 + square**2 / 5040, (a - np.sin(a)) / a**3)
    return sine, cosine, third


def exp(v: Floats) -> Floats:
    """Return the rotation matrices Exp([v]x), (..., 3, 3), of active rotation vectors (..., 3) [rad] (Rodrigues)."""
    sine, cosine, _ = _series(np.linalg.norm(v, axis=-1))
    k = skew(v)
    out: Floats = np.eye(3) + sine[..., None, None] * k + cosine[..., None, None] * (k @ k)
    return out


def cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products (n, 3) of rows (n, 3), as `np.cross` does, which takes longer where n is small."""
    out = np.empty(a.shape)
    out[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    out[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    out[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return out


def log(rotation: Floats) -> Floats:
    """Return the active rotation vectors (..., 3) [rad], length at most pi, of rotation matrices (..., 3, 3)."""
    q = quaternion_from_matrix(rotation)
    vector = q[..., 1:]
    sine = np.linalg.norm(vector, axis=-1)
    half = np.arctan2(sine, q[..., 0])
    small = sine < SMALL_ANGLE
    scale = np.where(small, 2 + sine**2 / 3, 2 * half / np.where(small, 1.0, sine))
    out: Floats = scale[..., None] * vector
    return out


def left_jacobian(v: Floats) -> Floats:
    """Return J_l, (..., 3, 3), with Exp(v + d) = Exp(J_l(v) d) Exp(v) to first order in d."""
    _, cosine, third = _series(np.linalg.norm(v, axis=-1))
    k = skew(v)
    out: Floats = np.eye(3) + cosine[..., None, None] * k + third[..., None, None] * (k @ k)
    return out


def matrix_from_quaternion(q: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4) wxyz."""
    out = np.empty((*q.shape[:-1], 3, 3))
    _matrices_into(np.ascontiguousarray(q, dtype=np.float64).reshape(-1, 4), out.reshape(-1, 3, 3))
    return out


@kernel
def _matrices_into(q: Floats, out: Floats) -> None:
    for n in range(len(q)):
        matrix_from_quaternion_into(q[n], out[n])


def quaternion_from_matrix(rotation: Floats) -> Floats:
    """Return unit quaternions (..., 4) wxyz with w >= 0 of rotation matrices (..., 3, 3), by Shepperd's method."""
    out = np.empty((*rotation.shape[:-2], 4))
    _quaternions_into(np.ascontiguousarray(rotation, dtype=np.float64).reshape(-1, 3, 3), out.reshape(-1, 4))
    return out


@kernel
def _quaternions_into(rotation: Floats, out: Floats) -> None:
    for n in range(len(rotation)):
        w, x, y, z = _shepperd(rotation[n])
        size = np.sqrt(w * w + x * x + y * y + z * z)
        size = -size if w < 0 else size
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = w / size, x / size, y / size, z / size


def quaternion_multiply(a: Floats, b: Floats) -> Floats:
    """Return the Hamilton product a b of quaternions (..., 4) wxyz: first the rotation b, then a."""
    aw, bw = a[..., :1], b[..., :1]
    av, bv = a[..., 1:], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    out: Floats = np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)
    return out


def xyzw_from_wxyz(q: Floats) -> Floats:
    """Return quaternions (..., 4) in the order of SciPy and rerun."""
    return np.roll(q, -1, axis=-1)


def wxyz_from_xyzw(q: Floats) -> Floats:
    """Return quaternions (..., 4) wxyz from the order of SciPy and rerun."""
    return np.roll(q, 1, axis=-1)


def angle_between(a: Floats, b: Floats) -> Floats:
    """Return the angle [rad] of a b^T, shape (...), of rotation matrices (..., 3, 3), as in (25)."""
    out: Floats = np.linalg.norm(log(a @ np.swapaxes(b, -1, -2)), axis=-1)
    return out


def mean_rotation(rotation: Floats) -> Floats:
    """Return the rotation (3, 3) nearest to all of (N, 3, 3) in the chordal sense, the mean in (23)."""
    u, _, vt = np.linalg.svd(rotation.sum(axis=0))
    out: Floats = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return out


def passive_vector(rotation: Floats) -> Floats:
    """Return source 1's rotation vectors phi (..., 3) [rad], R = exp(-[phi]x) (5), of matrices (..., 3, 3)."""
    return -log(rotation)


def matrix_from_passive_vector(phi: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) of source 1's rotation vectors phi (..., 3) [rad] (5)."""
    return exp(-phi)


def passive_jacobian(phi: Floats) -> Floats:
    """Return J_r of (9), (..., 3, 3): the rotation error J_r dphi of a passive vector's error dphi (21)."""
    return left_jacobian(-phi)


SMALL_TURN = 1e-2
"""Below this angle^2 [rad^2] a longer series serves: its first neglected terms are below 1e-17, and no sine has to be
called for a turn within a period."""


@kernel
def sine_cosine(square: float) -> tuple[float, float]:
    """Return sin(a)/a and (1 - cos a)/a^2 of Rodrigues' formula, from a^2, numbers or lanes."""
    s = 1 - square * (1 / 6) * (1 - square * (1 / 20) * (1 - square * (1 / 42) * (1 - square * (1 / 72))))
    c = 0.5 - square * (1 / 24) * (1 - square * (1 / 30) * (1 - square * (1 / 56) * (1 - square * (1 / 90))))
    if not all_of(square < SMALL_TURN):
        for i in range(width(square)):
            one = lane(square, i)
            if not one < SMALL_TURN:
                angle = np.sqrt(one)
                half = np.sin(angle / 2)
                s, c = with_lane(s, i, np.sin(angle) / angle), with_lane(c, i, 2 * half * half / one)
    return s, c


@inlined
def exp_rows(x: float, y: float, z: float) -> Rows:
    """Return the rows of Exp([v]x) as tuples, of numbers or lanes: nothing is allocated.

    Args:
        x: v_x [rad].
        y: v_y [rad].
        z: v_z [rad].
    """
    s, c = sine_cosine(x * x + y * y + z * z)
    return (
        (1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y),
        (c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x),
        (c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)),
    )


@kernel
def exp_into(v: Floats, out: Floats) -> None:
    """Write Exp([v]x) of one rotation vector (3,) [rad] into `out` (3, 3)."""
    a, b, c = exp_rows(v[0], v[1], v[2])
    out[0, 0], out[0, 1], out[0, 2] = a
    out[1, 0], out[1, 1], out[1, 2] = b
    out[2, 0], out[2, 1], out[2, 2] = c


@kernel
def turned(a: float, b: float, c: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return Exp([v]x) p, three numbers.

    Args:
        a: v_x [rad].
        b: v_y [rad].
        c: v_z [rad].
        x: p_x.
        y: p_y.
        z: p_z.
    """
    sine, cosine = sine_cosine(a * a + b * b + c * c)
    # p + sin(.)/(.) v x p + (1 - cos(.))/(.)^2 v x (v x p)
    u0, u1, u2 = b * z - c * y, c * x - a * z, a * y - b * x
    return (
        x + sine * u0 + cosine * (b * u2 - c * u1),
        y + sine * u1 + cosine * (c * u0 - a * u2),
        z + sine * u2 + cosine * (a * u1 - b * u0),
    )


@kernel
def log_into(rotation: Floats, out: Floats) -> None:
    """Write the rotation vector [rad], at most pi long, of `rotation` (3, 3) into `out` (3,)."""
    m = rotation
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    q = scratch(0.0, 4)  # the unit quaternion times an unknown factor
    if trace > 0:
        q[0], q[1], q[2], q[3] = 1 + trace, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        i = 0
        if m[1, 1] > m[i, i]:
            i = 1
        if m[2, 2] > m[i, i]:
            i = 2
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0], q[1 + i] = m[k, j] - m[j, k], 1 + m[i, i] - m[j, j] - m[k, k]
        q[1 + j], q[1 + k] = m[i, j] + m[j, i], m[i, k] + m[k, i]
    if q[0] < 0:
        for i in range(4):
            q[i] = -q[i]
    sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    # atan(s)/s = 1 - s^2/3 + ..., whose next term is below rounding at s = 1e-4.
    scale = 2 * np.arctan2(sine, q[0]) / sine if sine > 1e-4 * q[0] else (2 - 2 * (sine / q[0]) ** 2 / 3) / q[0]
    for i in range(3):
        out[i] = scale * q[1 + i]


@kernel
def left_jacobian_into(v: Floats, out: Floats) -> None:
    """Write J_l(v) (3, 3) of a rotation vector (3,) [rad], with Exp(v + d) = Exp(J_l d) Exp(v), into `out`."""
    a, b, c = left_jacobian_rows(v[0], v[1], v[2])
    out[0, 0], out[0, 1], out[0, 2] = a
    out[1, 0], out[1, 1], out[1, 2] = b
    out[2, 0], out[2, 1], out[2, 2] = c


@kernel
def left_jacobian_rows(x: float, y: float, z: float) -> Rows:
    """Return the rows of J_l(v), of `left_jacobian_into`, as tuples, of numbers or lanes: nothing is allocated.

    Args:
        x: v_x [rad].
        y: v_y [rad].
        z: v_z [rad].
    """
    square = x * x + y * y + z * z
    c, t = 0.5 - square / 24 + square * square / 720, 1 / 6 - square / 120 + square * square / 5040
    if not all_of(np.sqrt(square) < 1e-2):
        for i in range(width(square)):
            one = lane(square, i)
            angle = np.sqrt(one)
            if not angle < 1e-2:
                half = np.sin(angle / 2)
                c = with_lane(c, i, 2 * half * half / one)
                t = with_lane(t, i, (angle - np.sin(angle)) / (angle * one))
    # I + c [v]x + t [v]x^2, with [v]x^2 = v v^T - |v|^2 I
    one = 1 - t * square
    return (
        (t * x * x + one, t * x * y - c * z, t * x * z + c * y),
        (t * y * x + c * z, t * y * y + one, t * y * z - c * x),
        (t * z * x - c * y, t * z * y + c * x, t * z * z + one),
    )


@kernel
def quaternion_rows(w: float, x: float, y: float, z: float) -> Rows:
    """Return the rows of the rotation matrix of a unit quaternion as tuples: nothing is allocated.

    Args:
        w: the scalar part.
        x: the vector part's x.
        y: the vector part's y.
        z: the vector part's z.
    """
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@kernel
def matrix_from_quaternion_into(q: Floats, out: Floats) -> None:
    """Write the rotation matrix of one unit quaternion (4,) wxyz into `out` (3, 3)."""
    a, b, c = quaternion_rows(q[0], q[1], q[2], q[3])
    out[0, 0], out[0, 1], out[0, 2] = a
    out[1, 0], out[1, 1], out[1, 2] = b
    out[2, 0], out[2, 1], out[2, 2] = c


@kernel
def _shepperd(m: Floats) -> tuple[float, float, float, float]:
    """Return the quaternion wxyz of a rotation matrix (3, 3) times four times its largest component.

    That component is the best conditioned one.
    """
    w, x, y, z = (
        1 + m[0, 0] + m[1, 1] + m[2, 2],
        1 + m[0, 0] - m[1, 1] - m[2, 2],
        1 - m[0, 0] + m[1, 1] - m[2, 2],
        1 - m[0, 0] - m[1, 1] + m[2, 2],
    )
    if w >= x and w >= y and w >= z:
        x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    elif x >= y and x >= z:
        w, y, z = m[2, 1] - m[1, 2], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]
    elif y >= z:
        w, x, z = m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], m[2, 1] + m[1, 2]
    else:
        w, x, y = m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    return w, x, y, z


@kernel
def quaternion_from_matrix_into(m: Floats, out: Floats) -> None:
    """Write the unit quaternion (4,) wxyz, w >= 0, of a rotation matrix (3, 3) into `out`."""
    w, x, y, z = _shepperd(m)
    scale = 1 / np.sqrt(w * w + x * x + y * y + z * z)
    scale = -scale if w < 0 else scale
    out[0], out[1], out[2], out[3] = scale * w, scale * x, scale * y, scale * z


@kernel
def quaternion_between(a: Floats, b: Floats) -> tuple[float, float, float, float]:
    """Return the product a b* (wxyz) of two unit quaternions (4,): the rotation that takes b to a."""
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3],
        -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
        -a[0] * b[2] + a[2] * b[0] - a[3] * b[1] + a[1] * b[3],
        -a[0] * b[3] + a[3] * b[0] - a[1] * b[2] + a[2] * b[1],
    )


@kernel
def multiply_into(a: Floats, b: Floats, out: Floats) -> None:
    """Write a matrix product into `out`.

    Args:
        a: the left factor (3, 3).
        b: the right factor (3, 3).
        out: receives a b (3, 3); may be `b` itself, but not `a`.
    """
    for j in range(3):
        x, y, z = b[0, j], b[1, j], b[2, j]
        for i in range(3):
            out[i, j] = a[i, 0] * x + a[i, 1] * y + a[i, 2] * z
