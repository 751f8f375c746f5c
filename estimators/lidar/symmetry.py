"""The symmetry group of a shape, found from the shape itself: the turns that map it onto itself.

A turn S about the centre c takes the point x to S (x - c) + c. Where that is the same surface, no sensor tells the pose
(R, p) from

    (R S, p + R (c - S c))

and a pose is the class of all of these. Turns spread evenly over SO(3) are ordered by how far the turned surface is
from the surface,

    u(S) = mean_i min(|S (x_i - c) + c - nearest|, w)

and the best that differ are registered with the shape itself, along the normals. One is a symmetry where nearly all
points come to lie on the surface; products of symmetries are symmetries, until none is new. An axis about which turns
by unrelated angles are all symmetries is one of revolution: the turn about it has no meaning. Two such axes make a
sphere.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lidar.nearest import nearest
from estimators.lidar.pose_search import rotations
from estimators.lidar.ray_cast import cast
from estimators.lidar.shape import Shape

TURNS = 3000
"""Turns looked at, 13 degrees apart."""
POINTS = 200
WIDTH = 0.1
"""The cut-off w, against the shape's radius."""
MOST_ALIKE = 48
CANDIDATES = 16
"""Turns that are registered; a group needs but a few of its own, whose products are the others."""
APART_RAD = np.radians(25.0)
"""Turns nearer than this to each other, or to none at all, are one: a registration leads from one to the other."""
FITTED, STEPS, EXACT_STEPS = 400, 12, 8
"""Points and iterations of the registration of a shape with itself."""
PROMISING = 0.5
"""Share of the points on the surface without which a registration is not continued."""
SAME, ALL = 0.005, 0.995
"""Largest distance from the surface of a symmetry's points, against the radius, and their share."""
NEW_RAD = np.radians(4.0)
"""Turns of a group that differ by less are one."""
MOST = 64
"""Turns of the largest finite group that is told: 60, of the icosahedron."""
UNRELATED_RAD = np.array([0.3, 1.0, 2.2])
"""Turns that no regular prism of fewer than 64 sides shares."""
FREE_RAD = np.pi / np.sqrt(3)
"""Standard deviation of a turn of which nothing is known."""


class Symmetry(NamedTuple):
    """A symmetry group. turn: (k, 3, 3), the finite part, identity first. centre: (3,) [m], which every turn leaves in
    its place. axes: (m, 3), axes through it about which a turn has no meaning: none, one, or three of a sphere.
    """

    turn: Floats
    centre: Floats
    axes: Floats

    @property
    def trivial(self) -> bool:
        """True where the shape is like itself in one attitude only."""
        return len(self.turn) == 1 and not len(self.axes)

    def equivalents(self, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
        """Return the poses (k, 3, 3), (k, 3) that the finite part makes of one, which is the first of them."""
        turned = rotation @ self.turn
        return turned, position + (rotation - turned) @ self.centre

    def nearest(self, rotation: Floats, position: Floats, toward: Floats) -> tuple[Floats, Floats]:
        """Return the pose of the class of (`rotation`, `position`) whose attitude is nearest to another.

        Args:
            rotation: (3, 3).
            position: (3,) [m].
            toward: (3, 3), the other attitude.
        """
        if self.trivial:
            return rotation, position
        turned = self._toward(rotation @ self.turn, toward)
        best = turned[int(np.argmin(rot.angle_between(turned, toward)))]
        return best, position + (rotation - best) @ self.centre

    def angle_between(self, a: Floats, b: Floats) -> Floats:
        """Return the least angle [rad] (n,) between attitudes a (n, 3, 3) and any that is equivalent to b (3, 3)."""
        turned = self._toward(np.asarray(a)[:, None] @ self.turn, b)
        out: Floats = rot.angle_between(turned, b).min(axis=-1)
        return out

    def one_of_each(self, rotation: Floats) -> Floats:
        """Return of the attitudes (n, 3, 3) those nearest to none among their equivalents: one of each class."""
        if len(self.turn) == 1:
            return rotation
        trace = np.einsum("nij,kji->nk", rotation, self.turn)
        out: Floats = rotation[trace[:, 0] >= trace.max(axis=1) - 1e-9]
        return out

    def free(self, rotation: Floats) -> Floats:
        """Return the changes (m, 6) of a pose, ordered (attitude, position), that a turn without meaning makes."""
        axis = self.axes @ rotation.T
        return np.concatenate([axis, -np.cross(axis, rotation @ self.centre)], axis=1)

    def _toward(self, turned: Floats, toward: Floats) -> Floats:
        """Return attitudes (..., 3, 3), turned about the axis of revolution to be nearest to another."""
        if not len(self.axes):
            return turned
        if len(self.axes) > 1:
            return np.broadcast_to(toward, turned.shape)
        # The turn by f about a that makes trace(T^T R Exp(f a)) largest.
        axis, relative = self.axes[0], toward.T @ turned
        trace = np.trace(relative, axis1=-2, axis2=-1)
        along = np.einsum("i,...ij,j->...", axis, relative, axis)
        across = np.einsum("...ij,ji->...", relative, rot.skew(axis))
        return turned @ rot.exp(np.arctan2(across, trace - along)[..., None] * axis)


@lru_cache(maxsize=16)
def symmetry(shape: Shape) -> Symmetry:
    """Return the symmetry group of a shape; takes about half a second, once per shape."""
    centre = shape.point.mean(axis=0)
    group = _Group(shape)
    for turn in alike(shape)[:CANDIDATES]:
        group.take(*settled(shape, turn, centre - turn @ centre))
    centre = _centre(group.found, centre)
    axes = _axes(group, centre)
    if len(axes) == 1:
        # Of all half turns that reverse the axis, one stands for the others.
        group.found = []
        half = rot.exp(np.pi * np.linalg.svd(axes)[2][1])
        group.take(half, centre - half @ centre)
    elif len(axes):
        group.found = []
    else:
        group.close()
        centre = _centre(group.found, centre)
    return Symmetry(np.array([np.eye(3)] + [rotation for rotation, _ in group.found]), centre, axes)


@lru_cache(maxsize=16)
def alike(shape: Shape) -> Floats:
    """Return the turns (`MOST_ALIKE`, 3, 3) at most under which a shape is most like itself, the best that differ, best
    first.
    """
    centre = shape.point.mean(axis=0)
    some = shape.point[:: max(1, len(shape.point) // POINTS)] - centre
    turns = rotations(TURNS)
    turns = turns[rot.angle_between(turns, np.eye(3)) >= APART_RAD]
    turned, width = some @ np.swapaxes(turns, -1, -2) + centre, WIDTH * shape.radius_m
    index = nearest(shape.nearest, turned.reshape(-1, 3), np.eye(3), np.zeros(3), width).reshape(turned.shape[:2])
    distance = np.where(index >= 0, np.linalg.norm(turned - shape.point[index], axis=2), width)
    kept: list[int] = []
    for i in np.argsort(distance.mean(axis=1), kind="stable"):
        if not kept or rot.angle_between(turns[kept], turns[i]).min() >= APART_RAD:
            kept.append(int(i))
            if len(kept) == MOST_ALIKE:
                break
    out: Floats = turns[kept]
    return out


class _Group:
    """The symmetries of a shape that are found: turn (3, 3) and shift (3,) [m] of each, the identity left out."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        self.found: list[tuple[Floats, Floats]] = []
        self._enough = ALL * _share_on_surface(shape, np.eye(3), np.zeros(3))

    def holds(self, rotation: Floats, shift: Floats) -> bool:
        """Return whether a turn and a shift map the shape onto itself."""
        return _share_on_surface(self.shape, rotation, shift) >= self._enough

    def take(self, rotation: Floats, shift: Floats) -> None:
        """Take a turn in, with its shift, if it is a symmetry and new."""
        if self._known(rotation):
            return
        rotation, shift = _polished(self.shape, rotation, shift)
        if not self._known(rotation) and self.holds(rotation, shift):
            self.found.append((rotation, shift))

    def close(self) -> None:
        """Take the products of all turns in, until none is new."""
        done = 0
        while done < len(self.found) < MOST:
            (one, first), done = self.found[done], done + 1
            for two, second in list(self.found):
                self.take(one @ two, one @ second + first)
                self.take(two @ one, two @ first + second)

    def _known(self, rotation: Floats) -> bool:
        known = np.array([np.eye(3)] + [turn for turn, _ in self.found])
        return bool(rot.angle_between(known, rotation).min() < NEW_RAD)


def _centre(found: list[tuple[Floats, Floats]], guess: Floats) -> Floats:
    """Return the point that all symmetries leave in its place; what they leave free, as `guess` (3,) has it."""
    rows = np.concatenate([np.eye(3) - turn for turn, _ in found] + [1e-6 * np.eye(3)])
    off = np.concatenate([shift + turn @ guess - guess for turn, shift in found] + [np.zeros(3)])
    out: Floats = guess + np.linalg.lstsq(rows, off, rcond=None)[0]
    return out


def _axes(group: _Group, centre: Floats) -> Floats:
    """Return the axes of revolution: none (0, 3), one (1, 3), or of a sphere three (3, 3)."""
    axes = np.zeros((0, 3))
    for rotation, _ in group.found:
        turn = rot.log(rotation)
        axis = turn / np.linalg.norm(turn)
        if len(axes) and np.abs(axes @ axis).max() > np.cos(NEW_RAD):
            continue
        turns = rot.exp(UNRELATED_RAD[:, None] * axis)
        if all(group.holds(some, centre - some @ centre) for some in turns):
            axes = np.concatenate([axes, axis[None]])
            if len(axes) == 2:
                return np.eye(3)
    return axes


def settled(shape: Shape, rotation: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Return a turn and a shift near the given ones that bring the shape's points nearest to its surface.

    Args:
        shape: of the target.
        rotation: (3, 3), the turn.
        shift: (3,) [m].
    """
    some = shape.point[:: max(1, len(shape.point) // FITTED)]
    for _ in range(STEPS):
        moved = some @ rotation.T + shift
        distance, index = shape.tree.query(moved)
        normal = shape.normal[index]
        near = distance <= 2 * max(float(np.median(distance)), shape.spacing_m)
        gap = np.sum((shape.point[index] - moved) * normal, axis=1)
        rotation, shift = _stepped(rotation, shift, moved[near], normal[near], gap[near])
    return rotation, shift


def _polished(shape: Shape, rotation: Floats, shift: Floats) -> tuple[Floats, Floats]:
    """Return a turn and a shift that bring the shape's points onto the exact surface, along their own normals."""
    stride = max(1, len(shape.point) // FITTED)
    point, normal = shape.point[::stride], shape.normal[::stride]
    width = 6 * SAME * shape.radius_m
    for _ in range(EXACT_STEPS):
        moved, across = point @ rotation.T + shift, normal @ rotation.T
        gap, aligned = _gap(shape, moved, across, width)
        near = aligned & (np.abs(gap) < width)
        if np.count_nonzero(near) < PROMISING * len(point):
            break
        rotation, shift = _stepped(rotation, shift, moved[near], across[near], gap[near])
        width = max(0.7 * width, 2 * SAME * shape.radius_m)
    return rotation, shift


def _stepped(rotation: Floats, shift: Floats, moved: Floats, normal: Floats, gap: Floats) -> tuple[Floats, Floats]:
    """Return the turn and shift after a step that takes the points (n, 3) by `gap` (n,) [m] along `normal` (n, 3)."""
    rows = np.concatenate([np.cross(moved, normal), normal], axis=1)
    step = np.linalg.lstsq(rows.T @ rows, rows.T @ gap, rcond=1e-10)[0]
    turn = rot.exp(step[:3])
    return turn @ rotation, turn @ shift + step[3:]


def _gap(shape: Shape, point: Floats, normal: Floats, reach_m: float) -> tuple[Floats, Bools]:
    """Return how far the surface is from points (n, 3) along their normals (n, 3), from `reach_m` outside of them
    inward, and where it faces as they do, (n,).
    """
    hits = cast(shape.mesh, point + reach_m * normal, -normal)
    aligned = np.abs(np.sum(shape.mesh.normal[hits.triangle] * normal, axis=1)) > 0.9
    return reach_m - hits.distance, aligned & np.isfinite(hits.distance)


def _share_on_surface(shape: Shape, rotation: Floats, shift: Floats) -> float:
    """Return the share of the shape's points that lie on its surface, facing as it does, after a turn and a shift."""
    same = SAME * shape.radius_m
    gap, aligned = _gap(shape, shape.point @ rotation.T + shift, shape.normal @ rotation.T, 1.5 * same)
    return float(np.mean((np.abs(gap) <= same) & aligned))
