"""Turns under which a shape falls nearly on itself: where a pose is mistaken, it is by one of these.

Spacecraft are full of them: half a turn of a bus with two panels, a quarter turn of a cube with one dish. Whoever has
found a pose (R, p) compares it with (R S, p + R (c - S c)) for each such turn S about the centroid c of the surface,
and knows whether the scan tells them apart. Turns that differ by a symmetry of the shape are one: no scan does, and the
pose means all of them (`estimators.lidar.symmetry`).
"""

from functools import lru_cache

import numpy as np

from estimators.arrays import Floats
from estimators.lidar.pose_search import Poses
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import APART_RAD, alike, settled, symmetry

KEPT = 8


@lru_cache(maxsize=16)
def likenesses(shape: Shape) -> Poses:
    """Return the turns (k, 3, 3) and their shifts (k, 3) [m], k at most `KEPT`, the most alike first; takes less than
    a second, once per shape.
    """
    group, centre = symmetry(shape), shape.point.mean(axis=0)
    turns, shifts = [np.eye(3)], [np.zeros(3)]
    for turn in alike(shape):
        if group.angle_between(np.array(turns), turn).min() < APART_RAD:
            continue
        rotation, shift = settled(shape, turn, centre - turn @ centre)
        # Where the registration leads back to what is kept, the turn itself stands.
        if group.angle_between(np.array(turns), rotation).min() < APART_RAD:
            rotation, shift = turn, centre - turn @ centre
        turns.append(rotation)
        shifts.append(shift)
        if len(turns) > KEPT:
            break
    return Poses(np.array(turns[1:]).reshape(-1, 3, 3), np.array(shifts[1:]).reshape(-1, 3), np.zeros(len(turns) - 1))


def mistaken(shape: Shape, rotation: Floats, position: Floats) -> Poses:
    """Return the poses for which a pose would most likely be taken, or which would be taken for it.

    Args:
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    turns, shifts, score = likenesses(shape)
    return Poses(rotation @ turns, position + shifts @ rotation.T, score)
