"""Which photodiodes the lighthouse's light reaches: field, range, incidence, then a ray against every craft's shape.

Lighthouse frame = MuJoCo's world frame: the light starts at the origin and goes along +z. A photodiode at p with normal
n is lit when

    z > 0,  |atan2(x, z)| and |atan2(y, z)| <= field / 2        both fans sweep over it
    range_min <= |p| <= range_max                               enough light, no glare
    -n . p / |p| >= cos(incidence_max)                          it faces the light
    first hit of the ray from the origin to p is not nearer than |p| - 1 mm

The ray meets the surfaces that MuJoCo's own `mj_ray` meets: meshes by their triangles (not their convex hull), every
geom that is not fully transparent, of every body but the lighthouse's. The millimetre is the photodiode's thickness: a
photodiode stands on a surface, which would else shade it by a rounding error, and may be drawn by a geom that thick.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import matrix_from_quaternion
from swarm.layout import Photodiodes

THICKNESS_M = 1e-3
"""A surface that is nearer than the photodiode by less than this does not shade it [m]."""


class Sight(IntEnum):
    """What a photodiode sees of the lighthouse."""

    OUTSIDE = 0
    """Out of field or range, turned away, or not there at all (padding)."""
    BLOCKED = 1
    """Within reach of the light, but something stands in between."""
    LIT = 2


class Limits(Protocol):
    """Where the lighthouse's light can be detected at all; `LighthouseSettings` has it."""

    @property
    def field_rad(self) -> float: ...  # noqa: D102
    @property
    def range_min_m(self) -> float: ...  # noqa: D102
    @property
    def range_max_m(self) -> float: ...  # noqa: D102
    @property
    def incidence_max_rad(self) -> float: ...  # noqa: D102


class Visibility:
    """Casts the lighthouse's rays in its own `MjData`; the world's state is not touched.

    A photodiode that lies more than a millimetre inside its craft is dark: give the drawn layout, on the surface. The
    mounting error shifts the photodiode against its drawing, but not into the craft.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        photodiodes: Photodiodes,
        craft_bodies: Sequence[int] | Ints,
        lighthouse_body: int,
        limits: Limits,
    ) -> None:
        """Take the craft's root bodies (C,), each with a free joint, in the order of `photodiodes`.

        Raises ValueError where a root body has no free joint, the numbers of craft differ, or the lighthouse carries
        geoms on bodies below its own (a ray leaves out one body only).
        """
        self._model = model
        self._data = mujoco.MjData(model)
        self._photodiodes = photodiodes
        self._lighthouse_body = lighthouse_body
        self._limits = limits
        self._address = np.array([_free_joint_address(model, int(body)) for body in craft_bodies], dtype=np.int64)
        if len(self._address) != photodiodes.craft_count:
            raise ValueError(f"{len(self._address)} craft bodies, but layouts of {photodiodes.craft_count} craft")
        for body in range(lighthouse_body + 1, model.nbody):
            if model.body_geomnum[body] > 0 and _is_part_of(model, body, lighthouse_body):
                raise ValueError(f"body {model.body(body).name!r} would shade the lighthouse that it belongs to")

    def lit(self, position: Floats, quaternion: Floats) -> Bools:
        """Which photodiodes (C, K) are lit with the craft at `position` (C, 3) [m], `quaternion` (C, 4) wxyz."""
        lit: Bools = self.state(position, quaternion) == Sight.LIT
        return lit

    def state(self, position: Floats, quaternion: Floats) -> NDArray[np.int8]:
        """The `Sight` of every photodiode, (C, K), for craft at `position` (C, 3) [m], `quaternion` (C, 4) wxyz."""
        craft = len(self._address)
        if position.shape != (craft, 3) or quaternion.shape != (craft, 4):
            raise ValueError(f"poses of {craft} craft needed, not {position.shape}, {quaternion.shape}")
        rotation = matrix_from_quaternion(quaternion)
        layout = self._photodiodes
        point = np.einsum("cij,ckj->cki", rotation, layout.point_m) + position[:, None, :]
        normal = np.einsum("cij,ckj->cki", rotation, layout.normal)
        within = layout.present & self._within_reach(point, normal)
        out = np.full(within.shape, Sight.OUTSIDE, dtype=np.int8)
        if np.any(within):
            self._place(position, quaternion)
            blocked = self._blocked(point[within], np.zeros(3), self._lighthouse_body)
            out[within] = np.where(blocked, Sight.BLOCKED, Sight.LIT)
        return out

    def blocked(self, origin: Floats, point: Floats, position: Floats, quaternion: Floats) -> Bools:
        """Whether something stands between `origin` (3,) [m], a camera, and each of the points (N, 3) [m].

        The craft are at `position` (C, 3), `quaternion` (C, 4). The camera's own craft blocks too: a pinhole stands
        clear of its surface.
        """
        self._place(position, quaternion)
        return self._blocked(point, origin, -1)

    def _within_reach(self, point: Floats, normal: Floats) -> Bools:
        limits = self._limits
        x, y, z = point[..., 0], point[..., 1], point[..., 2]
        half = limits.field_rad / 2
        distance = np.linalg.norm(point, axis=-1)
        facing = -np.sum(normal * point, axis=-1) >= np.cos(limits.incidence_max_rad) * distance
        in_range = (distance >= limits.range_min_m) & (distance <= limits.range_max_m)
        in_field = (z > 0) & (np.abs(np.arctan2(x, z)) <= half) & (np.abs(np.arctan2(y, z)) <= half)
        within: Bools = in_field & in_range & facing
        return within

    def _place(self, position: Floats, quaternion: Floats) -> None:
        """Move every craft's geoms; the rest of the scene stays where the model has it."""
        self._data.qpos[self._address[:, None] + np.arange(3)] = position
        self._data.qpos[self._address[:, None] + np.arange(3, 7)] = quaternion
        mujoco.mj_kinematics(self._model, self._data)

    def _blocked(self, point: Floats, origin: Floats, ignored_body: int) -> Bools:
        """Whether something but `ignored_body` stands between `origin` (3,) [m] and each of the points (N, 3) [m]."""
        ray = point - origin
        distance = np.linalg.norm(ray, axis=-1)
        count = len(point)
        geom = np.empty(count, dtype=np.int32)
        hit = np.empty(count)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            pnt=origin,
            vec=np.ascontiguousarray(ray / distance[:, None]).ravel(),
            geomgroup=None,
            flg_static=True,
            bodyexclude=ignored_body,
            geomid=geom,
            dist=hit,
            normal=None,
            nray=count,
            # What stands farther than the farthest photodiode cannot shade any.
            cutoff=float(distance.max()),
        )
        blocked: Bools = (hit >= 0) & (hit < distance - THICKNESS_M)
        return blocked


def _free_joint_address(model: mujoco.MjModel, body: int) -> int:
    """Where the free joint of `body` starts in qpos: 3 of position, 4 of quaternion."""
    joint = model.body_jntadr[body]
    if joint < 0 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise ValueError(f"body {model.body(body).name!r} has no free joint")
    return int(model.jnt_qposadr[joint])


def _is_part_of(model: mujoco.MjModel, body: int, whole: int) -> bool:
    """Whether `body` hangs below `whole`; parents come before their children, the world is nobody's part."""
    while body > whole:
        body = int(model.body_parentid[body])
    return body == whole > 0
