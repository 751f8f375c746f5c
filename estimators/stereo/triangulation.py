"""A light seen by two cameras, in the main camera's frame: source 2 (7), with its covariance.

Frames {C1} main camera, {C2} backup camera: x right, y down, z along the optical axis. The rig says where camera 2 is,
r1 = C_12 r2 + M_12. Image coordinates are divided by the focal length, u = x/f, v = y/f, so that f drops out (1):
u1 = X/Z, v1 = Y/Z. Each coordinate gives one linear equation in r1 = (X, Y, Z); with c_k the columns of C_12,

    e_x - u1 e_z,  e_y - v1 e_z                   times r1 = 0                             camera 1
    a_u = c_1 - u2 c_3,  a_v = c_2 - v2 c_3       times r1 = a_u . M_12,  a_v . M_12       camera 2

A r1 = B, r1 = (A^T A)^-1 A^T B (7). A's condition number is about Z / baseline, that of A^T A its square. The equations
are therefore solved in (p, q, Z), r1 = (u1 Z + p, v1 Z + q, Z): the same least squares, but scaled so that the normal
matrix's condition number stays near 1, and the only cancellation left is in a . (u1, v1, 1), the disparity itself.

For exact images the residual of (7) is zero, so that to first order an image error moves r1 by

    dr1 = (A^T A)^-1 A^T diag(Z1, Z1, Z2, Z2) (du1, dv1, du2, dv2)

with Z1, Z2 the light's depths in the two cameras. Errors of the four coordinates are independent and equally large.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.lighthouse.projection import checked
from estimators.linear import cholesky_into, solve_cholesky


class Rig(NamedTuple):
    """The pose of camera 2 in camera 1's frame, r1 = rotation r2 + origin_m: C_12 (3, 3) and M_12 (3,) [m]."""

    rotation: Floats
    origin_m: Floats

    @property
    def baseline_m(self) -> float:
        """Distance of the two cameras [m]."""
        return float(np.linalg.norm(self.origin_m))


class Triangulation(NamedTuple):
    """Points in camera 1's frame. point_m: (..., 3) [m]. covariance: (..., 3, 3) [m^2] for unit noise of u and v. NaN
    where the rays do not meet in front of both cameras, or a coordinate is not a number.
    """

    point_m: Floats
    covariance: Floats


def toed_in(baseline_m: float, toe_in_rad: float) -> Rig:
    """Return two cameras `baseline_m` apart, camera 2 on the right, each turned towards the other by `toe_in_rad`."""
    s, c = np.sin(toe_in_rad), np.cos(toe_in_rad)
    s2, c2 = np.sin(2 * toe_in_rad), np.cos(2 * toe_in_rad)
    rotation = np.array([[c2, 0.0, -s2], [0.0, 1.0, 0.0], [s2, 0.0, c2]])
    return Rig(rotation, baseline_m * np.array([c, 0.0, s]))


@kernel
def triangulate_into(uv1: Floats, uv2: Floats, rotation: Floats, origin: Floats, point: Floats, slope: Floats) -> bool:
    """Solve (7) for one light; return False, with nothing useful written, where the rays do not meet in front of both.

    Args:
        uv1: (2,), the image in camera 1.
        uv2: (2,), the image in camera 2.
        rotation: (3, 3) C_12.
        origin: (3,) [m] M_12.
        point: (3,), receives r1.
        slope: (3, 4), receives dr1/d(u1, v1, u2, v2).
    """
    row, normal, lower = np.zeros((4, 3)), np.empty((3, 3)), np.empty((3, 3))
    right = np.zeros(4)
    row[0, 0] = row[1, 1] = 1.0
    for k in range(2):
        for i in range(3):
            a = rotation[i, k] - uv2[k] * rotation[i, 2]
            right[2 + k] += a * origin[i]
            # The third unknown is the depth along camera 1's ray (u1, v1, 1).
            if i < 2:
                row[2 + k, i] = a
                row[2 + k, 2] += a * uv1[i]
            else:
                row[2 + k, 2] += a
    x = np.zeros(3)
    for i in range(3):
        for j in range(3):
            normal[i, j] = 0.0
            for k in range(4):
                normal[i, j] += row[k, i] * row[k, j]
        for k in range(4):
            x[i] += row[k, i] * right[k]
    if not cholesky_into(normal, lower):
        return False
    solve_cholesky(lower, x)
    z1 = x[2]
    point[0], point[1], point[2] = uv1[0] * z1 + x[0], uv1[1] * z1 + x[1], z1
    z2 = 0.0
    for i in range(3):
        z2 += rotation[i, 2] * (point[i] - origin[i])
    if not (z1 > 0 and z2 > 0 and np.isfinite(z1)):
        return False
    for k in range(4):
        for i in range(3):
            x[i] = row[k, i]
        solve_cholesky(lower, x)
        depth = z1 if k < 2 else z2
        slope[0, k] = depth * (uv1[0] * x[2] + x[0])
        slope[1, k] = depth * (uv1[1] * x[2] + x[1])
        slope[2, k] = depth * x[2]
    return True


@kernel
def _triangulate_all(
    uv1: Floats, uv2: Floats, rotation: Floats, origin: Floats, point: Floats, covariance: Floats
) -> None:
    slope = np.empty((3, 4))
    for n in range(uv1.shape[0]):
        if not triangulate_into(uv1[n], uv2[n], rotation, origin, point[n], slope):
            point[n] = np.nan
            covariance[n] = np.nan
            continue
        for i in range(3):
            for j in range(3):
                covariance[n, i, j] = 0.0
                for k in range(4):
                    covariance[n, i, j] += slope[i, k] * slope[j, k]


def checked_rig(rig: Rig) -> tuple[Floats, Floats]:
    """Return the rig's arrays for a kernel. Raises ValueError where a shape is wrong, or the turn is no rotation."""
    rotation, origin = checked("rig.rotation", rig.rotation, (3, 3)), checked("rig.origin_m", rig.origin_m, (3,))
    if not (np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-9 and np.linalg.det(rotation) > 0):
        raise ValueError("rig.rotation is not a rotation")
    if not (np.isfinite(origin).all() and origin.any()):
        raise ValueError(f"rig.origin_m is {origin}: two cameras need two places")
    return rotation, origin


def triangulate(uv1: Floats, uv2: Floats, rig: Rig) -> Triangulation:
    """Return lights in camera 1's frame from their images.

    Args:
        uv1: (..., 2), image in camera 1 divided by the focal length.
        uv2: (..., 2), likewise in camera 2.
        rig: the cameras' places.

    Raises:
        ValueError: the shapes differ, or the rig is none.
    """
    uv1 = np.asarray(uv1, dtype=np.float64)
    uv2 = checked("uv2", uv2, uv1.shape)
    if uv1.ndim < 1 or uv1.shape[-1] != 2:
        raise ValueError(f"uv1 has shape {uv1.shape}, expected (..., 2)")
    rotation, origin = checked_rig(rig)
    flat1, flat2 = np.ascontiguousarray(uv1).reshape(-1, 2), uv2.reshape(-1, 2)
    point, covariance = np.empty((len(flat1), 3)), np.empty((len(flat1), 3, 3))
    _triangulate_all(flat1, flat2, rotation, origin, point, covariance)
    finite: Bools = np.all(np.isfinite(point), axis=1)
    point[~finite], covariance[~finite] = np.nan, np.nan
    shape = uv1.shape[:-1]
    return Triangulation(point.reshape(*shape, 3), covariance.reshape(*shape, 3, 3))
