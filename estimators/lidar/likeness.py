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
from estimators.lidar.ray_cast import cast
from estimators.lidar.shape import Shape

TURNS = 3000
"""Turns looked at, 13 degrees apart."""
POINTS = 200
KEPT = 8
APART_RAD = np.radians(25.0)
"""Turns nearer than this to each other, or to none at all, are one: a registration leads from one to the other."""
SAME, ALL = 0.01, 0.99
"""Largest distance from the surface of a symmetry's points, against the radius, and their share."""
FITTED, STEPS = 600, 12
"""Points and iterations of the registration of a shape with itself."""
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


@lru_cache(maxsize=16)
def symmetries(shape: Shape) -> Poses:
    """Return the turns (k, 3, 3) and shifts (k, 3) [m] that map the shape onto itself, at most `KEPT`.

    Every likeness is registered with the shape itself, point to plane. It is a symmetry where nearly all points come to
    lie on the surface, within `SAME` of the radius, as many as of the shape that is not turned: then no scan at all can
    tell a pose from the turned one. Likenesses are 13 degrees apart, too far for a scan's registration to find it.
    """
    whole = _share_on_surface(shape, np.eye(3), np.zeros(3))
    centre = shape.point.mean(axis=0)
    kept = []
    for turn in likenesses(shape):
        rotation, shift = _settled(shape, turn, centre - turn @ centre)
        turned = rot.angle_between(rotation, np.eye(3)) >= APART_RAD
        if turned and _share_on_surface(shape, rotation, shift) >= ALL * whole:
            kept.append((rotation, shift))
    turns = np.array([rotation for rotation, _ in kept]).reshape(-1, 3, 3)
    return Poses(turns, np.array([shift for _, shift in kept]).reshape(-1, 3), np.zeros(len(kept)))


def _settled(shape: Shape, rotation: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Return a turn and a shift near the given ones that bring the shape's points nearest to its surface."""
    some = shape.point[:: max(1, len(shape.point) // FITTED)]
    for _ in range(STEPS):
        moved = some @ rotation.T + shift
        distance, index = shape.tree.query(moved)
        normal = shape.normal[index]
        near = distance <= 2 * max(float(np.median(distance)), shape.spacing_m)
        gap = np.sum((shape.point[index] - moved) * normal, axis=1)
        rows = np.concatenate([np.cross(moved, normal), normal], axis=1)[near]
        step = np.linalg.lstsq(rows, gap[near], rcond=1e-6)[0]
        turn = rot.exp(step[:3])
        rotation, shift = turn @ rotation, turn @ shift + step[3:]
    return rotation, shift


def _share_on_surface(shape: Shape, rotation: Floats, shift: Floats) -> float:
    """Return the share of the shape's points that lie on its surface, facing as it does, after a turn and a shift."""
    point, normal = shape.point @ rotation.T + shift, shape.normal @ rotation.T
    same = SAME * shape.radius_m
    hits = cast(shape.mesh, point + 1.5 * same * normal, -normal)
    aligned = np.abs(np.sum(shape.mesh.normal[hits.triangle] * normal, axis=1)) > 0.9
    return float(np.mean((np.abs(hits.distance - 1.5 * same) <= same) & aligned))


def mistaken(shape: Shape, rotation: Floats, position: Floats) -> Poses:
    """Return the poses for which a pose would most likely be taken, or which would be taken for it.

    Args:
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    centre, turns = shape.point.mean(axis=0), likenesses(shape)
    where = position + (centre - turns @ centre) @ rotation.T
    same = symmetries(shape)
    turns = np.concatenate([turns, same.rotation])
    where = np.concatenate([where, position + same.position @ rotation.T])
    return Poses(rotation @ turns, where, np.zeros(len(turns)))
