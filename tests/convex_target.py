"""The target of source 1's static experiment, with a layout of our own: a convex dome 12.5 x 12.5 x 6.25 cm.

An octagonal frustum: four photodiodes on its top (normal +z), one on each of its eight sides, whose normals point
30 degrees up and whose heights alternate, so that no five sides lie in one plane.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.rotation import exp

ARCSEC = np.pi / 180 / 3600
ANGLE_NOISE = 8.8 * ARCSEC
RHO = 0.8717
PERIOD = 1 / 60
INCIDENCE_MAX = np.deg2rad(80)
HALF_FIELD = np.deg2rad(60)


def dome() -> tuple[Floats, Floats]:
    """Photodiodes (12, 3) [m] and outward normals (12, 3) of the dome, centred on its bounding box."""
    top = np.array([[x, y, 3.125] for x in (-2.0, 2.0) for y in (-2.0, 2.0)])
    azimuth = np.arange(8) * np.pi / 4
    radius, height = np.where(np.arange(8) % 2, 4.6, 5.8), np.where(np.arange(8) % 2, 1.2, -1.2)
    side = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    tilt = np.deg2rad(30)
    outward = [np.cos(tilt) * np.cos(azimuth), np.cos(tilt) * np.sin(azimuth), np.full(8, np.sin(tilt))]
    normal = np.concatenate([np.tile([0.0, 0.0, 1.0], (4, 1)), np.stack(outward, axis=-1)])
    return np.concatenate([top, side]) / 100, normal


def random_rotation(rng: np.random.Generator, count: int) -> Floats:
    """Uniform rotations (count, 3, 3)."""
    q = rng.standard_normal((count, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(np.linalg.norm(q[:, 1:], axis=-1), q[:, 0])
    axis = q[:, 1:] / np.linalg.norm(q[:, 1:], axis=-1, keepdims=True)
    return exp(axis * angle[:, None])


def random_position(rng: np.random.Generator, count: int, near_m: float, far_m: float) -> Floats:
    """Positions (count, 3) [m] at a uniform range, uniform in the two fan angles of the 120 x 120 degree field."""
    ray = np.concatenate([np.tan(rng.uniform(-HALF_FIELD, HALF_FIELD, (count, 2))), np.ones((count, 1))], axis=-1)
    out: Floats = ray / np.linalg.norm(ray, axis=-1, keepdims=True) * rng.uniform(near_m, far_m, (count, 1))
    return out


def visible(rotation: Floats, position: Floats, point: Floats, normal: Floats) -> Bools:
    """Photodiodes (C, K) of a convex body (K, 3) that face the lighthouse within 80 degrees and are in the field."""
    p = np.einsum("cij,kj->cki", rotation, point) + position[:, None]
    n = np.einsum("cij,kj->cki", rotation, normal)
    facing = -np.sum(p * n, axis=-1) / np.linalg.norm(p, axis=-1) > np.cos(INCIDENCE_MAX)
    z = p[..., 2]
    limit = np.tan(HALF_FIELD)
    out: Bools = facing & (z > 0) & (np.abs(p[..., 0]) < limit * z) & (np.abs(p[..., 1]) < limit * z)
    return out


def angles(
    rotation: Floats, position: Floats, point: Floats, offset: Floats, angular_rate: Floats, velocity: Floats
) -> Floats:
    """Noise-free sweep angles (C, K, 2) [rad] by (2), each at its own instant; points (C, K, 3)."""
    out = np.empty((*point.shape[:2], 2))
    for fan in range(2):
        tau = offset[..., fan, None]
        turn = exp(angular_rate[:, None] * tau)
        p = np.einsum("ckij,cjl,ckl->cki", turn, rotation, point) + position[:, None] + velocity[:, None] * tau
        out[..., fan] = np.arctan2(p[..., 2], p[..., fan])
    return out


def angle_errors(rng: np.random.Generator, craft: int, photodiodes: int, sigma: float = ANGLE_NOISE) -> Floats:
    """Angle noise (C, K, 2) [rad] with the correlation (19): one draw per fan and craft, one per angle."""
    shared = rng.standard_normal((craft, 1, 2))
    out: Floats = np.sqrt(RHO) * shared + np.sqrt(1 - RHO) * rng.standard_normal((craft, photodiodes, 2))
    return sigma * out


class Draw(NamedTuple):
    """C craft that see at least so many photodiodes of the dome, not all in one plane: truth and layout."""

    rotation: Floats
    position: Floats
    lit: Bools
    point: Floats


def draw(rng: np.random.Generator, count: int, near_m: float, far_m: float, fewest: int = 5) -> Draw:
    """Random poses, drawn until `count` of them have `fewest` photodiodes lit that are 1 mm or more off any plane."""
    point, normal = dome()
    kept: list[tuple[Floats, Floats, Bools]] = []
    while sum(len(lit) for _, _, lit in kept) < count:
        rotation, position = random_rotation(rng, count), random_position(rng, count, near_m, far_m)
        lit = visible(rotation, position, point, normal)
        enough = lit.sum(axis=1) >= fewest
        for i in np.nonzero(enough)[0]:
            inside = point[lit[i]]
            enough[i] = np.linalg.svd(inside - inside.mean(axis=0), compute_uv=False)[2] > 1e-3
        kept.append((rotation[enough], position[enough], lit[enough]))
    rotation, position, lit = (np.concatenate(parts)[:count] for parts in zip(*kept, strict=True))
    return Draw(rotation, position, lit, np.tile(point, (count, 1, 1)))


def sweep_offsets(rng: np.random.Generator, craft: int, photodiodes: int) -> Floats:
    """Instants (C, K, 2) [s] about the epoch: sweep X near -T/4, sweep Y near +T/4, each within T/6."""
    middle = np.array([-PERIOD / 4, PERIOD / 4])
    return middle + rng.uniform(-PERIOD / 6, PERIOD / 6, (craft, photodiodes, 2))
