"""Turns under which a shape falls nearly on itself: where a pose is mistaken, it is by one of these.

A turn S about the centroid c of the surface takes the point x to S (x - c) + c. How far the turned surface is from the
surface itself, each distance cut off at w,

    u(S) = mean_i min(|S (x_i - c) + c - nearest|, w)

is looked at for turns spread evenly over SO(3); the smallest that differ are kept. Spacecraft are full of them: half a
turn of a bus with two panels, a quarter turn of a cube. Whoever has found a pose (R, p) compares it with
(R S, p + R (c - S c)) for each of them, and knows whether the scan tells them apart.
"""

from functools import lru_cache

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.pose_search import Poses, rotations
from estimators.lidar.shape import Shape

TURNS = 3000
"""Turns looked at, 13 degrees apart."""
POINTS = 200
KEPT = 8
APART_RAD = np.radians(25.0)
"""Turns nearer than this to each other, or to none at all, are one: a registration leads from one to the other."""
WIDTH = 0.1
"""The cut-off w, against the shape's radius."""


@lru_cache(maxsize=16)
def likenesses(shape: Shape) -> Floats:
    """Return the turns (k, 3, 3), k at most `KEPT`, the most alike first; takes about a second, once per shape."""
    centre = shape.point.mean(axis=0)
    some = shape.point[:: max(1, len(shape.point) // POINTS)] - centre
    turns = rotations(TURNS)
    far = rot.angle_between(turns, np.eye(3)) >= APART_RAD
    turns = turns[far]
    distance, _ = shape.tree.query(some @ np.swapaxes(turns, -1, -2) + centre)
    order = np.argsort(np.minimum(distance, WIDTH * shape.radius_m).mean(axis=1), kind="stable")
    kept: list[int] = []
    for i in order:
        if not kept or rot.angle_between(turns[kept], turns[i]).min() >= APART_RAD:
            kept.append(int(i))
            if len(kept) == KEPT:
                break
    out: Floats = turns[kept]
    return out


def mistaken(shape: Shape, rotation: Floats, position: Floats) -> Poses:
    """Return the poses for which a pose would most likely be taken, or which would be taken for it.

    Args:
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    centre, turns = shape.point.mean(axis=0), likenesses(shape)
    where = position + (centre - turns @ centre) @ rotation.T
    return Poses(rotation @ turns, where, np.zeros(len(turns)))
