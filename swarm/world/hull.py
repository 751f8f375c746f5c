"""A craft's hull: the places on its surface where a photodiode could be mounted, found on the real geometry.

Body frame `b`, metres. The surface is that of every geom that is not fully transparent, as light meets it:
the geoms' triangles are sampled evenly by area, and a ray cast towards each sample from just outside moves it onto the
real surface, with its true normal. A sample can carry a photodiode where the disc of its housing rests on the surface
all around: not across an edge, in a corner, on a rod thinner than itself, or under another part. The places of the
photodiodes that the craft has already are included.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import matrix_from_quaternion
from swarm.errors import SwarmError
from swarm.world.craft import Visual, photodiode_sites, rigid, surfaces_of, visuals_of
from swarm.world.rays import Rays

PROUD_M = 5e-4
"""Height of a photodiode's face above its surface, as on the shipped craft [m]."""
HOUSING_M = 2.5e-3
"""Radius of the disc that must rest on the surface: 3 mm of photodiode and 1 mm of mount around it [m]."""
FLAT_M = 2.5e-4
"""Largest deviation of the surface from flat under the housing's rim [m]."""
RIM = 8
"""Number of points of the rim that are tested."""
APPROACH = 0.02
"""Distance outside a sample at which its ray starts, relative to the geom's size: the samples of round shapes lie on
chords, below the surface.
"""


class Mount(NamedTuple):
    """Places for N photodiodes, in the body frame.

    point_m: centres of the faces, (N, 3) [m].
    normal: unit normals, (N, 3).
    """

    point_m: Floats
    normal: Floats

    def at(self, index: Ints) -> "Mount":
        """Return the places with these indices."""
        return Mount(self.point_m[index], self.normal[index])


class Hull:
    """One rigid craft alone, without a lighthouse: `model` has it as body `body`, with a free joint.

    The craft needs no photodiodes yet: a hull is where they are designed. visuals: drawn surface. shipped: places of
    the file's photodiodes, perhaps none.
    """

    body = 1
    world_body = 0

    def __init__(self, path: Path) -> None:
        """Read a craft's model file. Raises SwarmError as `load_craft` does, except for missing photodiodes."""
        self.path = path
        self.model = rigid(path.resolve())[1]
        self.visuals: tuple[Visual, ...] = visuals_of(self.model)
        sites = photodiode_sites(self.model)
        self.shipped = Mount(
            self.model.site_pos[sites].reshape(-1, 3).copy(),
            matrix_from_quaternion(self.model.site_quat[sites].reshape(-1, 4))[:, :, 2],
        )
        self._rays = Rays(self.model, [self.body])
        self._rays.place(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))

    def mounts(self, samples: int) -> Mount:
        """Return places all over the hull, evenly by area: those of `samples` trial places that can carry a photodiode.

        Raises SwarmError where no photodiode fits on the craft's surface.
        """
        point, normal = self._on_surface(*_samples(surfaces_of(self.model), samples))
        rests = self._rests(point, normal) & self._outside(point + PROUD_M * normal, normal)
        if not rests.any() and not len(self.shipped.point_m):
            raise SwarmError(
                f"{self.path}: no place for a photodiode: its housing, {2e3 * HOUSING_M:g} mm across, rests nowhere "
                "flat on a geom"
            )
        return Mount(
            np.concatenate([point[rests] + PROUD_M * normal[rests], self.shipped.point_m]),
            np.concatenate([normal[rests], self.shipped.normal]),
        )

    def clear(self, point: Floats, direction: Floats) -> Bools:
        """Return whether the path from points (N, 3) just above the surface in a direction (3,) is free."""
        hit, _ = self._cast(point, np.broadcast_to(direction, point.shape).copy())
        return hit < 0

    def _on_surface(self, point: Floats, normal: Floats, reach: Floats) -> tuple[Floats, Floats]:
        """Return points and normals where rays from `reach` above the samples, against their normals, meet the hull."""
        hit, up = self._cast(point + reach[:, None] * normal, -normal)
        near = (hit >= 0) & (hit <= 2 * reach)
        out = point + (reach - hit)[:, None] * normal
        # MuJoCo's normal of a thin sheet may point away from the ray.
        up *= np.where(np.sum(up * normal, axis=1) < 0, -1.0, 1.0)[:, None]
        return out[near], up[near]

    def _rests(self, point: Floats, normal: Floats) -> Bools:
        """Return whether the housing's rim has the surface under it all around."""
        across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        along = np.cross(normal, across)
        rests = np.ones(len(point), dtype=np.bool_)
        for angle in 2 * np.pi * np.arange(RIM) / RIM:
            rim = point + HOUSING_M * (np.cos(angle) * across + np.sin(angle) * along) + PROUD_M * normal
            hit, _ = self._cast(rim, -normal)
            rests &= np.abs(hit - PROUD_M) <= FLAT_M
        return rests

    def _outside(self, point: Floats, direction: Floats) -> Bools:
        """Return whether points (N, 3) are outside every part: a ray from there meets the next surface from outside."""
        hit, normal = self._cast(point, direction)
        out: Bools = (hit < 0) | (np.sum(normal * direction, axis=1) < 0)
        return out

    def _cast(self, start: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Return the distance (N,) [m], -1 for none, and the normal (N, 3) of the first surface that each ray meets."""
        hits = self._rays.cast(start, direction, without_body=self.world_body)
        return hits.distance, hits.normal


def _samples(parts: tuple[Visual, ...], count: int) -> tuple[Floats, Floats, Floats]:
    """Return points (N, 3) evenly by area on the triangles, their normals (N, 3), and start distances of rays (N,)."""
    seen = [part.mesh for part in parts]
    corner = np.concatenate([mesh.vertex[mesh.face] for mesh in seen] or [np.empty((0, 3, 3))])
    size = np.repeat([np.ptp(mesh.vertex, axis=0).max() for mesh in seen], [len(mesh.face) for mesh in seen])
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice_area = np.linalg.norm(cross, axis=1)
    real = twice_area > 0
    corner, size, cross, twice_area = corner[real], size[real], cross[real], twice_area[real]
    if not len(corner):
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    # Low-discrepancy sampling: equal steps in area, and the R2 sequence across each triangle.
    step = np.arange(count)
    face = np.searchsorted(np.cumsum(twice_area), (step + 0.5) / count * twice_area.sum()).clip(max=len(corner) - 1)
    a, b = (0.5 + 0.7548776662466927 * step) % 1, (0.5 + 0.5698402909980532 * step) % 1
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    first, second, third = corner[face].transpose(1, 0, 2)
    point = first + a[:, None] * (second - first) + b[:, None] * (third - first)
    return point, (cross / twice_area[:, None])[face], APPROACH * size[face] + PROUD_M
