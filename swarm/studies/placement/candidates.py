"""Candidates: where stations may stand, and which way they look there.

A station stands on a *surface*: a wall, the ceiling or the floor of a room, a sphere around the volume, or a point. On
a surface it can be moved, and what leaves it is put back. Everywhere a station may look at the middle of the volume,
and from a surface of a room or a point also straight away from it. Its y axis is as near to down as its direction
allows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import Fan
from swarm.errors import SwarmError
from swarm.studies.design.poses import GOLDEN
from swarm.studies.placement.box import Box

SPOTS = 100
"""Places of the coarse search, over all surfaces."""
ALIKE_RAD = np.radians(10.0)
"""Two directions of one place are nearer than this: one is enough."""
NEAREST_M = 1e-6
"""Places nearer to each other than this are the same."""
SIDES = {"ceiling": -1, "floor": 1}
"""The faces of a room across the direction that is up, by the sense of their normal."""


class Surface(NamedTuple):
    """A surface for stations: a rectangle from `corner` along `sides` (2, 3) [m], facing `normal`; or, with a radius, a
    sphere about `corner`. A point is a rectangle without sides.
    """

    name: str
    corner: Floats
    sides: Floats
    normal: Floats | None = None
    radius_m: float = 0.0

    @property
    def area(self) -> float:
        """Its area [m^2]."""
        if self.radius_m:
            return 4 * np.pi * self.radius_m**2
        return float(np.prod(np.linalg.norm(self.sides, axis=1)))

    def spread(self, spacing: float) -> Floats:
        """Return places (N, 3) [m] all over it, about so far apart, those of a rectangle from edge to edge."""
        if self.radius_m:
            count = max(6, round(self.area / spacing**2))
            z = 1 - (2 * np.arange(count) + 1) / count
            around = 2 * np.pi * GOLDEN * np.arange(count)
            across = np.sqrt(1 - z * z)
            ball = np.column_stack([across * np.cos(around), across * np.sin(around), z])
            return np.asarray(self.corner + self.radius_m * ball)
        steps = [
            np.linspace(0, 1, max(2, round(length / spacing) + 1)) if length > 0 else np.zeros(1)
            for length in np.linalg.norm(self.sides, axis=1)
        ]
        share = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
        return np.asarray(self.corner + share @ self.sides)

    def put_back(self, point: Floats) -> Floats:
        """Return the places on the surface (N, 3) that are nearest to points (N, 3)."""
        away = point - self.corner
        if self.radius_m:
            ahead = away / np.linalg.norm(away, axis=1, keepdims=True)
            return np.asarray(self.corner + self.radius_m * ahead)
        square = np.sum(self.sides**2, axis=1)
        share = np.clip((away @ self.sides.T) / np.where(square > 0, square, 1.0), 0, 1)
        return np.asarray(self.corner + share @ self.sides)


class Stand(NamedTuple):
    """A station that stands somewhere: rotation (3, 3) R_w_s, position (3,) [m], and the index of its surface."""

    rotation: Floats
    position: Floats
    surface: int

    def station(self, fans: Sequence[Fan]) -> Station:
        """Return it as the estimators take it."""
        return Station(self.rotation, self.position, fans)


class Site(NamedTuple):
    """Surfaces that a station may stand on, and where not: nearer to the volume than `near_m`, farther than `far_m`, or
    in one of the zones of `keep_out`. up: (3,), unit vector.
    """

    surfaces: tuple[Surface, ...]
    volume: Box
    up: Floats
    near_m: float
    far_m: float
    keep_out: tuple[Box, ...] = ()

    def allows(self, point: Floats) -> Ints:
        """Return the indices of the points (N, 3) where a station may stand."""
        distance = self.volume.distance(point)
        good = (distance >= self.near_m) & (distance <= self.far_m)
        for zone in self.keep_out:
            good &= ~zone.holds(point)
        return np.flatnonzero(good)

    @property
    def spacing(self) -> float:
        """Distance between neighbouring places of the coarse search [m]."""
        return float(np.sqrt(max(sum(surface.area for surface in self.surfaces), NEAREST_M) / SPOTS))


def room(box: Box, up: Floats, on: Sequence[str]) -> tuple[Surface, ...]:
    """Return the faces of a room.

    Args:
        box: the room.
        up: (3,), along one of the axes.
        on: kinds of faces: "walls", "ceiling", "floor".
    """
    out, axis = [], int(np.argmax(np.abs(up)))
    for normal_axis in range(3):
        for sense in (1, -1):
            normal = np.zeros(3)
            normal[normal_axis] = sense
            upward = round(float(normal @ up))
            kind = "walls" if normal_axis != axis else next(k for k, s in SIDES.items() if s == upward)
            if kind not in on:
                continue
            corner = box.low.copy()
            corner[normal_axis] = box.low[normal_axis] if sense > 0 else box.high[normal_axis]
            sides = np.diag(box.high - box.low)[[i for i in range(3) if i != normal_axis]]
            name = kind if kind != "walls" else f"wall {'xyz'[normal_axis]} = {corner[normal_axis]:g} m"
            out.append(Surface(name, corner, sides, normal))
    return tuple(out)


def shell(box: Box, radius_m: float) -> Surface:
    """Return the sphere of a radius about the middle of a volume."""
    return Surface(f"sphere of {radius_m:g} m", box.middle, np.zeros((2, 3)), None, radius_m)


def spot(point: Floats, up: Floats) -> Surface:
    """Return a single point (3,) [m] as a surface; up: (3,)."""
    return Surface("point", point, np.zeros((2, 3)), -up)


def candidates(site: Site) -> list[Stand]:
    """Return the stations of the coarse search. Raises SwarmError where a station may stand nowhere."""
    out: list[Stand] = []
    taken = np.empty((0, 3))
    for index, surface in enumerate(site.surfaces):
        points = surface.spread(site.spacing)
        for point in points[site.allows(points)]:
            if (np.linalg.norm(taken - point, axis=1) < NEAREST_M).any():
                continue
            taken = np.vstack([taken, point])
            towards = [site.volume.middle - point] + ([] if surface.normal is None else [surface.normal])
            out += [Stand(look(each, site.up), point, index) for each in _different(towards)]
    if not out:
        zones = ", outside of the keep-out zones" if site.keep_out else ""
        raise SwarmError(
            f"a station may stand nowhere: no place on {', '.join(surface.name for surface in site.surfaces)} is "
            f"{site.near_m:g} m to {site.far_m:g} m from the volume{zones}"
        )
    return out


def look(towards: Floats, up: Floats) -> Floats:
    """Return the rotation (3, 3) of a station that looks in a direction, its y axis as near to down as possible.

    Args:
        towards: (3,), direction of its z axis.
        up: (3,), unit vector.
    """
    ahead = towards / np.linalg.norm(towards)
    down = -up + (up @ ahead) * ahead
    if np.linalg.norm(down) < NEAREST_M:
        down = np.eye(3)[np.argmin(np.abs(ahead))]
        down = down - (down @ ahead) * ahead
    down /= np.linalg.norm(down)
    return np.column_stack([np.cross(down, ahead), down, ahead])


def moved(stand: Stand, site: Site, step_m: float, turn_rad: float) -> list[Stand]:
    """Return a station's neighbours: moved on its surface by a step, or turned, or both so that it still looks at the
    same point.

    Args:
        stand: the station.
        site: what it may stand on.
        step_m: length of a step [m].
        turn_rad: angle of a turn [rad].
    """
    surface = site.surfaces[stand.surface]
    right, down, ahead = stand.rotation.T
    target = stand.position + ahead * max(float(ahead @ (site.volume.middle - stand.position)), step_m)
    out = [
        Stand(look(np.cos(turn_rad) * ahead + np.sin(turn_rad) * side, site.up), stand.position, stand.surface)
        for side in (right, -right, down, -down)
    ]
    flat = surface.sides if not surface.radius_m else np.stack([right, down])
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    ways = (flat / np.where(length > 0, length, 1.0))[length[:, 0] > 0]
    points = [stand.position + sense * step_m * way for way in ways for sense in (1, -1)]
    if points:
        back = surface.put_back(np.array(points))
        for point in back[site.allows(back)]:
            if np.linalg.norm(point - stand.position) > NEAREST_M:
                out.append(Stand(stand.rotation, point, stand.surface))
                out.append(Stand(look(target - point, site.up), point, stand.surface))
    return out


def _different(towards: Sequence[Floats]) -> list[Floats]:
    """Return the directions without those of no length, and those nearly along an earlier one."""
    out: list[Floats] = []
    for each in towards:
        length = float(np.linalg.norm(each))
        if length < NEAREST_M:
            continue
        unit = each / length
        if all(float(unit @ other) < np.cos(ALIKE_RAD) for other in out):
            out.append(unit)
    return out
