"""Reflections: by way of which flat faces of other craft the lighthouse's light reaches a photodiode.

A face with outward normal n lies in the plane n . x + d = 0 of the lighthouse frame. The light from the origin meets a
photodiode at p by way of the point q where the line from the origin's mirror image o' to p passes the plane:

    o' = -2 d n,    q = o' + (p - o') d / (d + h),    h = n . p + d

q is on the face if it is inside all other planes of the convex solid that has the face; origin and p lie in front of it
(d > 0, h > 0). The photodiode sees the light if it comes from within its incidence limit, q is in the lighthouse's
field, the way is not longer than its range, and nothing stands in either leg. It is swept when the fan passes q.

Every flat face is a perfect mirror: those of boxes and of convex meshes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.rotation import matrix_from_quaternion
from swarm.hardware import Photodiodes
from swarm.sensors.hits import BOX, HULL
from swarm.sensors.solids import Solids
from swarm.sensors.visibility import WIDEST_HALF_FIELD_RAD, Visibility
from swarm.units import SI

ON_FACE_M = 1e-9
OFF_FACE_M = 1e-4
"""A leg begins so far in front of the face: not in it."""


class Ghost(NamedTuple):
    """Light by way of mirrors: photodiode (n,); q (n, 3) [m] in the lighthouse frame; length of the way (n,) [m]."""

    photodiode: Ints
    point_m: Floats
    way_m: Floats


def faces_of(solids: Solids, craft: int) -> list[Floats]:
    """The planes (P, 4), n . x + d <= 0 inside, in the body frame, of each convex solid with flat faces of a craft."""
    shape = int(solids.shape[craft])
    if shape < 0:
        return []
    out = []
    for m in range(int(solids.first[shape]), int(solids.first[shape + 1])):
        if solids.kind[m] == HULL:
            out.append(solids.plane[slice(*solids.planes[m])])
        elif solids.kind[m] == BOX:
            normal = np.concatenate([np.eye(3), -np.eye(3)]) @ solids.rotation[m].T
            height = np.tile(solids.size[m], 2) + normal @ solids.position[m]
            out.append(np.column_stack([normal, -height]))
    return out


def ghosts(
    visibility: Visibility,
    layout: Photodiodes,
    craft: int,
    mirrors: Sequence[int],
    limits: SI,
    position: Floats,
    quaternion: Floats,
) -> Ghost:
    """Return the light that reaches one craft's photodiodes by way of other craft, with all craft at these poses.

    position: (C, 3) [m]. quaternion: (C, 4). mirrors: the craft whose faces are considered.
    """
    rotation = matrix_from_quaternion(quaternion)
    present = np.flatnonzero(layout.present[craft])
    p = layout.point_m[craft, present] @ rotation[craft].T + position[craft]
    normal = layout.normal[craft, present] @ rotation[craft].T
    slope = float(np.tan(min(limits.field_rad / 2, WIDEST_HALF_FIELD_RAD)))
    who, where, way = [], [], []
    for mirror in mirrors:
        for planes in faces_of(visibility.solids, mirror):
            n = planes[:, :3] @ rotation[mirror].T
            d = planes[:, 3] - n @ position[mirror]
            height = p @ n.T + d
            image = -2 * d[:, None] * n
            with np.errstate(divide="ignore", invalid="ignore"):
                q = image + (p[:, None] - image) * (d / (d + height))[..., None]
                back = q - p[:, None]
                arm = np.linalg.norm(back, axis=-1)
                length = np.linalg.norm(q, axis=-1) + arm
                # Against every plane of the solid: on its own one the point lies anyway.
                inside = np.max(q @ n.T + d, axis=-1) <= ON_FACE_M
                facing = np.sum(back * normal[:, None], axis=-1) >= np.cos(limits.incidence_max_rad) * arm
            in_field = (q[..., 2] > 0) & np.all(np.abs(q[..., :2]) <= slope * q[..., 2:], axis=-1)
            seen = inside & facing & in_field & (d > 0) & (height > 0) & (length <= limits.range_max_m)
            for k, face in zip(*np.nonzero(seen), strict=True):
                point, start = q[k, face], q[k, face] + OFF_FACE_M * n[face]
                scene = position, quaternion
                if visibility.blocked(np.zeros(3), point[None], *scene, through_lighthouse=True)[0]:
                    continue
                if visibility.blocked(start, p[k][None], *scene, through_lighthouse=True)[0]:
                    continue
                who.append(int(present[k]))
                where.append(point)
                way.append(float(length[k, face]))
    return Ghost(np.array(who, dtype=np.int64), np.array(where).reshape(-1, 3), np.array(way))
