"""Every ray of the program: where a line first meets the surface of anything in a MuJoCo model, as `mj_ray` says.

A surface is that of each geom that is not fully transparent, seen from either side: meshes by their triangles, whether
or not the geom collides, whatever its group, and however many geoms a body has. A material's transparency overrides
the geom's own.

`mj_multiRay` alone does not answer so: it passes over a body whose bounding volume a ray misses, and that volume holds
only the geoms that collide. Here it works on a copy of the model without bounding volumes, where it tests every geom
as `mj_ray` does. What no ray of a batch can meet is left out first, exactly: a geom whose bounding sphere lies outside
the cone around the batch, or beyond its reach.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Bools, Floats, Ints

FEW = 32
"""Number of geoms up to which leaving some out takes longer than testing them."""
NEAR, FAR = 0, 1
"""Geom groups of the copy: geoms to test, and geoms left out."""
_ONLY_NEAR = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
SLACK = 1e-6
"""Relative margin of the bounding spheres, far above the rounding errors of their sizes."""


class Hits(NamedTuple):
    """First hits of N rays.

    distance: distance along the unit direction, (N,) [m]; -1 where nothing is met.
    geom: number of the geom, (N,); -1 where nothing is met.
    normal: MuJoCo's normal of the surface there, (N, 3).
    """

    distance: Floats
    geom: Ints
    normal: Floats


class Rays:
    """Rays through a scene of C craft that can be placed anywhere; neither the model nor the world's state changes."""

    def __init__(self, model: mujoco.MjModel, craft_bodies: Sequence[int] | Ints) -> None:
        """Take the scene.

        Args:
            model: compiled model.
            craft_bodies: root bodies of the craft, (C,), each with a free joint.

        Raises:
            ValueError: a root body has no free joint.
        """
        self._address = np.array([free_joint_address(model, int(body)) for body in craft_bodies], dtype=np.int64)
        self._model = copy.copy(model)
        self._model.body_bvhadr[:] = -1
        self._model.geom_group[:] = NEAR
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        # The sphere's centre is the geom's position; a geom without a sphere (a plane) is unbounded.
        bound = self._model.geom_rbound
        self._radius = np.where(bound > 0, bound * (1 + SLACK), np.inf)

    def place(self, position: Floats, quaternion: Floats) -> None:
        """Move all craft to `position` (C, 3) [m] with attitude `quaternion` (C, 4) wxyz; the rest stays in place."""
        self._data.qpos[self._address[:, None] + np.arange(3)] = position
        self._data.qpos[self._address[:, None] + np.arange(3, 7)] = quaternion
        mujoco.mj_kinematics(self._model, self._data)

    def cast(self, origin: Floats, direction: Floats, reach_m: float = np.inf, without_body: int = -1) -> Hits:
        """Return what each of N rays meets first.

        Args:
            origin: start of all rays, (3,) [m], or of each, (N, 3) [m].
            direction: unit directions, (N, 3).
            reach_m: distance beyond which the caller ignores hits; some of them may be left out.
            without_body: body that no ray meets; -1: none.
        """
        count = len(direction)
        hits = Hits(np.full(count, -1.0), np.full(count, -1, dtype=np.int32), np.zeros((count, 3)))
        if not count:
            return hits
        if origin.ndim == 2:
            geom = np.empty(1, dtype=np.int32)
            for i, (start, ray) in enumerate(zip(origin, direction, strict=True)):
                hits.distance[i] = mujoco.mj_ray(
                    self._model, self._data, start, ray, None, True, without_body, geom, hits.normal[i]
                )
                hits.geom[i] = geom[0]
            return hits
        if self._model.ngeom > FEW:
            self._model.geom_group[:] = np.where(self._within_reach(origin, direction, reach_m), NEAR, FAR)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            pnt=origin,
            vec=np.ascontiguousarray(direction).ravel(),
            geomgroup=_ONLY_NEAR,
            flg_static=True,
            bodyexclude=without_body,
            geomid=hits.geom,
            dist=hits.distance,
            normal=hits.normal.reshape(-1),
            nray=count,
            cutoff=mujoco.mjMAXVAL,
        )
        return hits

    def distance_to(self, geom: int, origin: Floats, direction: Floats) -> float:
        """Return how far along a ray it meets the surface of one geom.

        Args:
            geom: number of the geom.
            origin: start of the ray, (3,) [m].
            direction: unit direction, (3,).

        Returns:
            Distance [m]; -1 where nothing is met.
        """
        kind = self._model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            return float(mujoco.mj_rayMesh(self._model, self._data, geom, origin, direction))
        if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
            return float(mujoco.mj_rayHfield(self._model, self._data, geom, origin, direction))
        self._model.geom_group[:] = FAR
        self._model.geom_group[geom] = NEAR
        hit = mujoco.mj_ray(self._model, self._data, origin, direction, _ONLY_NEAR, True, -1, None)
        self._model.geom_group[:] = NEAR
        return float(hit)

    def _within_reach(self, origin: Floats, direction: Floats, reach_m: float) -> Bools:
        """Return which geoms (G,) some of the rays can meet, by their bounding spheres."""
        to_centre = self._data.geom_xpos - origin
        distance = np.linalg.norm(to_centre, axis=1)
        radius = self._radius
        axis = direction.mean(axis=0)
        length = float(np.linalg.norm(axis))
        out: Bools = distance - radius <= reach_m
        if length < 1e-3:
            return out
        axis /= length
        spread = float(np.arccos(np.clip((direction @ axis).min(), -1.0, 1.0))) + SLACK
        outside = distance > radius
        with np.errstate(divide="ignore", invalid="ignore"):
            off_axis = np.arccos(np.clip(to_centre @ axis / distance, -1.0, 1.0))
            half = np.arcsin(np.where(outside, radius / distance, 1.0))
        out &= ~outside | (off_axis <= spread + half + SLACK)
        return out


def opaque(model: mujoco.MjModel) -> Bools:
    """Return which geoms (G,) rays meet: a material's transparency overrides the geom's own."""
    alpha = model.geom_rgba[:, 3].copy()
    with_material = model.geom_matid >= 0
    alpha[with_material] = model.mat_rgba[model.geom_matid[with_material], 3]
    out: Bools = alpha != 0
    return out


def free_joint_address(model: mujoco.MjModel, body: int) -> int:
    """Return the address in qpos of the free joint of `body`: 3 of position, 4 of quaternion.

    Raises ValueError where it has none.
    """
    joint = model.body_jntadr[body]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise ValueError(f"body {model.body(body).name!r} has no free joint")
    return int(model.jnt_qposadr[joint])
