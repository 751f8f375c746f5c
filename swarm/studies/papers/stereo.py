"""Source 2's simulation, section 3: cameras, marker and poses, and errors gathered by distance.

The distance d is between the docking points, the tips of the two docking booms. The cameras stand 1 m behind the one,
the marker 1 m behind the other (`models/craft/chaser`, `models/craft/marker-target`), so that the lights are d + 2 m
away: at less than 1.8 m a marker 0.6 m wide does not fit into both fields of 24 deg, and at d = 0 there must be a pose.
The rig's middle frame has its origin halfway between the pinholes and its z axis along the approach; results are in the
main camera's frame {C1}, as source 2 has them.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.stereo.triangulation import Rig, toed_in

FOCAL_M, FIELD_RAD = 0.028, np.deg2rad(24.0)
BASELINE_M, TOE_IN_RAD = 0.3, np.deg2rad(2.0)
IMAGE_NOISE_M = 1e-6 / 3
"""1 um is 3 sigma."""
RANGE_M = 30
SET_BACK_M = 2.0
"""From the cameras to their docking point, and from the other docking point to the marker."""
MARKER_M = np.array([[0.3, 0, 0], [0, 0.3, 0], [-0.3, 0, 0], [0, -0.3, 0], [0, 0, -0.2]])
"""Four lights on a circle and the fifth raised towards the cameras, with the marker's z axis along their view."""
TURN_RAD = np.deg2rad(5.0)
"""Poses are turned by up to this about each axis."""
ASIDE_M, ASIDE = 0.03, 0.1
"""... and lie aside by up to ASIDE_M + ASIDE d in each axis."""


class Poses(NamedTuple):
    """Relative poses: distance_m (N,) d, rotation (N, 3, 3) C, position (N, 3) M [m], in {C1}."""

    distance_m: Floats
    rotation: Floats
    position: Floats

    def rows(self, chosen: slice | Bools | Ints) -> "Poses":
        """Return the chosen poses."""
        return Poses(self.distance_m[chosen], self.rotation[chosen], self.position[chosen])

    def repeat(self, count: int) -> "Poses":
        """Return every pose `count` times, one after the other."""
        return self.rows(np.repeat(np.arange(len(self.distance_m)), count))

    def lights(self, marker_m: Floats) -> Floats:
        """Return where the lights (K, 3) [m] of a marker are at every pose, (N, K, 3) [m]."""
        out: Floats = np.einsum("nij,kj->nki", self.rotation, marker_m) + self.position[:, None]
        return out


def rig(baseline_m: float = BASELINE_M) -> Rig:
    """Return the two cameras, `baseline_m` [m] apart."""
    return toed_in(baseline_m, TOE_IN_RAD)


def draw_poses(per_metre: int, rng: np.random.Generator) -> Poses:
    """Draw poses at d = 0 ... 30 m, `per_metre` to the metre, both ends included: 15 361 for 512."""
    distance = np.arange(RANGE_M * per_metre + 1) / per_metre
    return random_poses(distance, rng)


def random_poses(distance_m: Floats, rng: np.random.Generator, baseline_m: float = BASELINE_M) -> Poses:
    """Draw one pose at each distance.

    Args:
        distance_m: Distances of the docking points (N,) [m].
        rng: Source of the draws.
        baseline_m: Distance between the cameras [m].
    """
    count = len(distance_m)
    turned = rot.exp(TURN_RAD * rng.uniform(-1, 1, (count, 3)))
    aside = (ASIDE_M + ASIDE * distance_m[:, None]) * rng.uniform(-1, 1, (count, 2))
    middle = np.column_stack([aside, distance_m + SET_BACK_M])
    to_main = rot.exp(np.array([0.0, -TOE_IN_RAD, 0.0]))
    return Poses(distance_m, to_main @ turned, (middle + np.array([baseline_m / 2, 0.0, 0.0])) @ to_main.T)


def images(poses: Poses, marker_m: Floats, cameras: Rig) -> Floats:
    """Return exact images.

    Args:
        poses: N poses.
        marker_m: The marker's lights (K, 3) [m].
        cameras: Both cameras.

    Returns:
        u = x/f and v = y/f of the lights in both cameras, (N, 2, K, 2).
    """
    r = poses.lights(marker_m)
    other = (r - cameras.origin_m) @ cameras.rotation
    return np.stack([r[..., :2] / r[..., 2:], other[..., :2] / other[..., 2:]], axis=1)


def in_field(uv: Floats) -> Bools:
    """Tell which images (..., 2) lie in the cameras' field, (...)."""
    inside: Bools = np.all(np.abs(np.arctan(uv)) <= FIELD_RAD / 2, axis=-1)
    return inside


def all_seen(uv: Floats) -> Bools:
    """Return the mask (N, 2, K) of images (N, 2, K, 2) that are all seen."""
    return np.ones(uv.shape[:-1], dtype=np.bool_)


def errors(poses: Poses, rotation: Floats, position: Floats) -> Floats:
    """Return the errors of solved poses.

    Args:
        poses: N true poses.
        rotation: Solved attitudes (N, 3, 3).
        position: Solved positions (N, 3) [m].

    Returns:
        Attitude [rad], from the left, and position [m] by which the truth differs from what was solved, (N, 6).
    """
    turn = rot.log(poses.rotation @ np.swapaxes(rotation, -1, -2))
    return np.concatenate([turn, poses.position - position], axis=1)


def sizes(error: Floats) -> Floats:
    """Return the angle [rad] and the distance [m] (N, 2) of errors (N, 6)."""
    return np.stack([np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)], axis=1)


def sigmas(covariance: Floats) -> Floats:
    """Return the roots of the diagonals of covariances (..., n, n), (..., n)."""
    out: Floats = np.sqrt(np.diagonal(covariance, axis1=-1, axis2=-2))
    return out


def largest_by_metre(distance_m: Floats, values: Floats) -> Floats:
    """Return the largest absolute values (30, M) of values (N, M), metre by metre of their distances (N,) [m]."""
    metre = np.minimum(distance_m.astype(np.int64), RANGE_M - 1)
    return np.stack([np.abs(values[metre == m]).max(axis=0) for m in range(RANGE_M)])
