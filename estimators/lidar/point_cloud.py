"""Point clouds: planes by RANSAC, principal components, and the alignment of two clouds by them.

Numbers in brackets are equations of Feng et al. 2024 ("Attitude measurement of non-cooperative spacecraft based on
LiDAR"); the formulae themselves are rebuilt, the text had lost them.

    plane through three points    n = (b - a) x (c - a) / |...|                                       (4)
    distance of a point from it   d_i = |n . (x_i - a)|                                               (5)
    centroid, covariance          x_c = sum x_i / N,   C = sum (x_i - x_c)(x_i - x_c)^T / N           (15), (16)
    principal axes                C = U diag(l) U^T, l falling                                        (17)
    rotation, translation         R = U_b S U_a^T,   T = x_b - R x_a                                  (18), (19)

S = diag(+-1, +-1, +-1) with det R = 1: the signs of eigenvectors mean nothing, four rotations are possible, and the one
nearest to a known attitude is taken. Where two eigenvalues are nearly equal the axes themselves mean nothing, and there
is no answer.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats

LEAST_RATIO = 1.3
"""Least ratio of neighbouring eigenvalues: below it their axes turn with the noise."""


class Plane(NamedTuple):
    """A plane n . x = offset_m. normal: (3,) unit. inlier: (n,), points within the tolerance."""

    normal: Floats
    offset_m: float
    inlier: Bools


class Principal(NamedTuple):
    """Principal components. centroid: (3,) [m]. axes: (3, 3), eigenvectors as columns, right-handed. variance: (3,)
    [m^2], falling.
    """

    centroid: Floats
    axes: Floats
    variance: Floats

    @property
    def distinct(self) -> bool:
        """True where the axes mean something."""
        large, middle, small = self.variance
        return bool(large > LEAST_RATIO * middle > LEAST_RATIO**2 * small and small >= 0)


class Alignment(NamedTuple):
    """Rotation (3, 3) and translation (3,) [m] with b = R a + T; NaN where not `determined`."""

    rotation: Floats
    translation: Floats
    determined: bool


def checked(point: Floats, least: int = 3) -> Floats:
    """Return the points (n, 3) as floats.

    Raises ValueError where they are not (n, 3), are fewer than `least`, or not finite.
    """
    out = np.asarray(point, dtype=np.float64)
    if out.ndim != 2 or out.shape[1] != 3:
        raise ValueError(f"point: expected (n, 3), got {out.shape}")
    if len(out) < least:
        raise ValueError(f"point: {len(out)} points, at least {least} are needed")
    if not np.isfinite(out).all():
        raise ValueError(f"point: {np.count_nonzero(~np.isfinite(out).all(axis=1))} points are not finite")
    return out


def ransac_plane(point: Floats, tolerance_m: float, rng: np.random.Generator, draws: int = 200) -> Plane:
    """Return the plane with the most points within a tolerance, of planes through three points (4), (5).

    It is then fitted to its inliers by least squares.

    Args:
        point: (n, 3) [m].
        tolerance_m: largest distance of an inlier [m].
        rng: of the draws.
        draws: number of planes.

    Raises:
        ValueError: as `checked`, and where all points are on one line.
    """
    point = checked(point)
    corner = point[rng.integers(0, len(point), (draws, 3))]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(normal, axis=1)
    real = size > 1e-9 * float(np.ptp(point, axis=0).max()) ** 2
    if not real.any():
        raise ValueError("point: all points are on one line")
    normal, corner = normal[real] / size[real, None], corner[real]
    distance = np.abs(point @ normal.T - np.sum(normal * corner[:, 0], axis=1))
    inlier: Bools = distance[:, np.argmax(np.count_nonzero(distance < tolerance_m, axis=0))] < tolerance_m
    axes = principal(point[inlier])
    n = axes.axes[:, 2]
    offset = float(n @ axes.centroid)
    return Plane(n, offset, np.abs(point @ n - offset) < tolerance_m)


def principal(point: Floats) -> Principal:
    """Return the centroid (15), covariance (16) and principal axes by SVD (17). Raises ValueError as `checked`."""
    point = checked(point)
    centroid = point.mean(axis=0)
    centred = point - centroid
    axes, variance, _ = np.linalg.svd(centred.T @ centred / len(point))
    axes[:, 2] *= np.linalg.det(axes)
    return Principal(centroid, axes, variance)


def align_principal(a: Floats, b: Floats, nearest_to: Floats) -> Alignment:
    """Return the rotation and translation that take the principal axes of one cloud to those of another, (18), (19).

    Args:
        a: (n, 3) [m].
        b: (m, 3) [m].
        nearest_to: (3, 3), the rotation that tells the four combinations of signs apart.

    Raises:
        ValueError: as `checked`.
    """
    of_a, of_b = principal(a), principal(b)
    if not (of_a.distinct and of_b.distinct):
        unknown = np.full((3, 3), np.nan)
        return Alignment(unknown, unknown[0], False)
    sign = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=np.float64)
    candidate = (of_b.axes * sign[:, None, :]) @ of_a.axes.T
    rotation = candidate[int(np.argmin(rot.angle_between(candidate, nearest_to)))]
    return Alignment(rotation, of_b.centroid - rotation @ of_a.centroid, True)
