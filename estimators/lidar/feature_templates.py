"""Acquisition as in the paper: a cloud falls into panels, antenna and body; the most complete is matched to templates.

Feng et al. 2024, section 1.2 (numbers in brackets: its equations; *derived*: rebuilt by us):

    panels    the plane with the most points, by RANSAC (4), (5)
    antenna   quadric fits (6) to (14); seeds of large curvature, grown; the largest region, of what is left
    body      what is left
    confidence of a feature   p_k = N_k / N_k,model, *derived*
    templates  64 of each feature: turned about X, Y and Z by multiples of 90 degrees (24 of them differ)
    score     sum of squared closest-point distances, centroids matched; the best gives R0, T0
    then      registration with the whole reference cloud, (1) to (3) for the angles

The templates are 90 degrees apart, so that the start is up to 60 degrees off: whether the registration then finds the
pose is measured, not assumed (`swarm reproduce lidar-acquisition`, benchmarks/lidar_attitudes.py).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.lidar.curvature import curvature, grow
from estimators.lidar.point_cloud import checked, ransac_plane
from estimators.lidar.registration import Registration, register
from estimators.lidar.shape import Shape

FEWEST = 12
"""Points of a feature that can be matched."""


@dataclass(frozen=True)
class SegmentationSettings:
    """Settings of the segmentation. tolerance_m: of the panels' plane. radius_m: of the quadric fits and of growing.
    curved_per_m: least curvature of the antenna (largest principal curvature). draws: of RANSAC. seed: of its draws.
    """

    tolerance_m: float = 0.03
    radius_m: float = 0.2
    curved_per_m: float = 0.8
    draws: int = 300
    seed: int = 0


class Features(NamedTuple):
    """Indices of the points of each feature."""

    panels: Ints
    antenna: Ints
    body: Ints


class TemplateMatch(NamedTuple):
    """Result of the paper's acquisition. feature: the one that was matched. confidence: of the three, in the order of
    `Features`. start_rotation (3, 3), start_position (3,): R0, T0, of the best template. fit: the registration.
    """

    feature: str
    confidence: Floats
    start_rotation: Floats
    start_position: Floats
    fit: Registration


def right_angles() -> Floats:
    """Return the paper's 64 rotations (64, 3, 3): R = Rz(k 90) Ry(j 90) Rx(i 90), i, j, k = 0 to 3 (1)."""
    x, y, z = (rot.exp(np.arange(4)[:, None] * np.pi / 2 * np.eye(3)[axis]) for axis in range(3))
    return np.array([c @ b @ a for c in z for b in y for a in x])


def angles_zyx(rotation: Floats) -> Floats:
    """Return (roll, pitch, yaw) [rad], (..., 3), of R = Rz(yaw) Ry(pitch) Rx(roll) (2), (3)."""
    r = rotation
    roll = np.arctan2(r[..., 2, 1], r[..., 2, 2])
    pitch = np.arctan2(-r[..., 2, 0], np.hypot(r[..., 0, 0], r[..., 1, 0]))
    out: Floats = np.stack([roll, pitch, np.arctan2(r[..., 1, 0], r[..., 0, 0])], axis=-1)
    return out


def from_angles_zyx(angles: Floats) -> Floats:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll), (..., 3, 3), of (roll, pitch, yaw) [rad] (..., 3) (1)."""
    x, y, z = (rot.exp(angles[..., axis, None] * np.eye(3)[axis]) for axis in range(3))
    out: Floats = z @ y @ x
    return out


def segment(point: Floats, settings: SegmentationSettings | None = None) -> Features:
    """Return the three features of a cloud (n, 3) [m]; a feature can be empty. Raises ValueError as `checked`."""
    s = settings or SegmentationSettings()
    point = checked(point)
    plane = ransac_plane(point, s.tolerance_m, np.random.default_rng(s.seed), s.draws)
    rest = np.flatnonzero(~plane.inlier)
    bent = np.abs(curvature(point[rest], s.radius_m).principal[:, 0])
    regions = grow(point[rest], bent, 1.5 * s.curved_per_m, s.curved_per_m, s.radius_m)
    antenna = rest[regions[0]] if regions else np.zeros(0, dtype=np.int64)
    return Features(np.flatnonzero(plane.inlier), antenna, np.setdiff1d(rest, antenna))


class Templates:
    """The reference cloud of a target, segmented once, in every one of the 64 attitudes."""

    def __init__(self, point: Floats, settings: SegmentationSettings | None = None) -> None:
        """Segment the reference. point: (n, 3) [m], the whole target, in its own frame, at the density of a scan times
        the number of views.
        """
        self.settings = settings or SegmentationSettings()
        self.features = segment(point, self.settings)
        self._whole = np.asarray(point, dtype=np.float64)
        self._cloud = [point[members] for members in self.features]
        self.rotation = right_angles()

    def acquire(self, point: Floats, shape: Shape, noise_m: float, *, compare_whole: bool = False) -> TemplateMatch:
        """Return the pose of a scanned cloud.

        Args:
            point: (n, 3) [m].
            shape: of the target.
            noise_m: 1 sigma of a range.
            compare_whole: let the template win in whose attitude the *whole* cloud lies nearest to the whole reference,
                since
                a feature may look the same in several; the paper compares the feature alone.

        Raises:
            ValueError: as `segment`, and where no feature is there.
        """
        found = segment(point, self.settings)
        usable = np.array([len(a) >= FEWEST and len(b) >= FEWEST for a, b in zip(found, self.features, strict=True)])
        if not usable.any():
            raise ValueError(f"point: no feature has {FEWEST} points")
        share = np.array([len(a) / max(len(b), 1) for a, b in zip(found, self.features, strict=True)])
        best = int(np.argmax(np.where(usable, share, -1)))
        seen, model = point[found[best]], self._cloud[best]
        # Turning the scan back is the same as turning the template.
        where = seen.mean(axis=0) - self.rotation @ model.mean(axis=0)
        cloud, tree = (point, cKDTree(self._whole)) if compare_whole else (seen, cKDTree(model))
        own = np.einsum("kni,kij->knj", cloud[None] - where[:, None], self.rotation)
        chosen = int(np.argmin(np.sum(tree.query(own)[0] ** 2, axis=1)))
        rotation, position = self.rotation[chosen], where[chosen]
        fit = register(point, shape, rotation, position, noise_m, reach_m=0.3 * shape.radius_m)
        return TemplateMatch(Features._fields[best], share, rotation, position, fit)
