"""Reflections: the lighthouse's light that reaches a photodiode by way of the flat faces of other craft.

A face with outward normal n lies in the plane n . x + d = 0 of the lighthouse frame. The light from the origin meets a
photodiode at p by way of the point q where the line from the origin's mirror image o' to p passes the plane:

    o' = -2 d n,    q = o' + (p - o') d / (d + h),    h = n . p + d

q is on the face if it is inside all other planes of the convex solid that has the face; origin and p lie in front of it
(d > 0, h > 0). The photodiode sees the light if it comes from within its incidence limit, q is in the lighthouse's
field, the path is not longer than its range, and nothing blocks either leg. It is swept when the fan passes q.

Every flat face of a box or a convex mesh is a perfect mirror.
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
"""Distance in front of the face at which a leg begins, so that it does not start inside the face [m]."""


class Ghost(NamedTuple):
    """Light by way of mirrors: the photodiodes that n reflections reach.

    photodiode: index of the photodiode, (n,).
    point_m: point of reflection q in the lighthouse frame, (n, 3) [m].
    way_m: length of the path, (n,) [m].
    """

    photodiode: Ints
    point_m: Floats
    way_m: Floats


def faces_of(solids: Solids, craft: int) -> list[Floats]:
    """Return the planes (P, 4) of each convex solid with flat faces of a craft: n . x + d <= 0 inside, body frame."""
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
    """Return the reflections of the lighthouse that reach the photodiodes of one craft.

    Args:
        visibility: the scene's rays and solids.
        layout: photodiodes of all craft.
        craft: index of the craft whose photodiodes are lit.
        mirrors: indices of the craft whose faces reflect.
        limits: the station's table in SI units.
        position: positions of all craft, (C, 3) [m].
        quaternion: attitudes of all craft, (C, 4) wxyz.
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
                # All planes of the solid are tested: the point lies on its own face's plane anyway.
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
