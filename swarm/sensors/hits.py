"""Exact intersection tests of a ray with convex solids, as kernels, in the frame of the body that carries the solid.

A ray x = o + t d, |d| = 1, from the lighthouse at o, is blocked where it crosses the solid's surface at 0 <= t < reach.
The part of a line inside a convex solid is one interval [enter, leave] (empty: a miss), and its surface is crossed at
the interval's ends: where the ray starts inside, `leave` is the distance that `mj_ray` would report.

    half spaces (hull, box)   enter = max of -(n . o - h) / (n . d) over n . d < 0,  leave = min over n . d > 0
    ellipsoid                 |A (o + t d)| = 1 with A = diag(1 / size): a quadratic in t
    cylinder                  a disc's quadratic across, a slab along z
    capsule                   the union of a cylinder without caps and two spheres: the union of their intervals
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import inlined, kernel
from estimators.lanes import alike, all_of, opposite, select
from estimators.rotation import Row

HULL, BOX, ELLIPSOID, CYLINDER, CAPSULE, OTHER = range(6)
"""Kinds of solids; an `OTHER` solid is not convex, and only its bounding box is known."""

Interval = tuple[float, float]


@kernel
def crossed(enter: float, leave: float, reach: float) -> bool:
    """Return whether the surface is crossed at 0 <= t < reach, of numbers or lanes.

    Args:
        enter: t at which the line enters the solid [m].
        leave: t at which the line leaves it [m]; below `enter` where the line misses.
        reach: length of the ray [m].
    """
    first = select(enter < 0, leave, enter)
    return (enter <= leave) & (first >= 0) & (first < reach)


@inlined
def hull_hit(plane: Floats, first: int, past: int, o: Floats, d: Row, reach: float, asked: bool) -> bool:
    """Return whether rays from one place cross the surface of a hull, of numbers or lanes.

    Args:
        plane: planes of all hulls, (P, 4).
        first: row of the hull's first plane.
        past: row after the hull's last plane.
        o: start of the rays, (3,) [m], body frame.
        d: unit directions of the rays, body frame.
        reach: lengths of the rays [m].
        asked: rays that matter; no other one hits.
    """
    enter, leave, outside = alike(reach, -np.inf), alike(reach, np.inf), opposite(asked)
    for i in range(first, past):
        n = plane[i]
        height = n[0] * o[0] + n[1] * o[1] + n[2] * o[2] + n[3]
        slope = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
        # The whole ray is outside this plane.
        outside = outside | ((height > 0) & (height + reach * slope >= 0))
        if all_of(outside):
            break
        t = -height / slope
        enter, leave = select(slope < 0, max(enter, t), enter), select(slope > 0, min(leave, t), leave)
    return opposite(outside) & crossed(enter, leave, reach)


@kernel
def slab(o: float, d: float, half: float) -> Interval:
    """Return the interval of t where |o + t d| <= half.

    Args:
        o: coordinate of the ray's start [m].
        d: component of its direction.
        half: half thickness of the slab [m].
    """
    if d == 0:
        return (-np.inf, np.inf) if abs(o) <= half else (np.inf, -np.inf)
    a, b = (-half - o) / d, (half - o) / d
    return min(a, b), max(a, b)


@kernel
def round_interval(a: float, b: float, c: float) -> Interval:
    """Return the interval of t where a t^2 + 2 b t + c <= 0.

    Args:
        a: coefficient of t^2, not negative.
        b: half the coefficient of t.
        c: constant.
    """
    if a == 0:
        return (-np.inf, np.inf) if c <= 0 else (np.inf, -np.inf)
    square = b * b - a * c
    if square < 0:
        return np.inf, -np.inf
    root = np.sqrt(square)
    return (-b - root) / a, (-b + root) / a


@kernel
def solid_interval(
    kind: int, size: Floats, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float
) -> Interval:
    """Return the interval of t where a ray is inside a solid that is not a hull; for `OTHER`, inside its bounding box.

    Args:
        kind: kind of the solid.
        size: MuJoCo's sizes of the solid, (3,) [m].
        ox: start of the ray along the solid's x axis [m].
        oy: start along y [m].
        oz: start along z [m].
        dx: direction of the ray along the solid's x axis.
        dy: direction along y.
        dz: direction along z.
    """
    if kind == ELLIPSOID:
        ax, ay, az = ox / size[0], oy / size[1], oz / size[2]
        bx, by, bz = dx / size[0], dy / size[1], dz / size[2]
        return round_interval(bx * bx + by * by + bz * bz, ax * bx + ay * by + az * bz, ax * ax + ay * ay + az * az - 1)
    if kind == CYLINDER:
        enter, leave = round_interval(dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - size[0] * size[0])
        low, high = slab(oz, dz, size[1])
        return max(enter, low), min(leave, high)
    if kind == CAPSULE:
        radius_squared = size[0] * size[0]
        enter, leave = round_interval(dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - radius_squared)
        low, high = slab(oz, dz, size[1])
        enter, leave = max(enter, low), min(leave, high)
        if not enter <= leave:
            enter, leave = np.inf, -np.inf
        for side in range(2):
            z = oz - size[1] if side == 0 else oz + size[1]
            low, high = round_interval(
                dx * dx + dy * dy + dz * dz, ox * dx + oy * dy + z * dz, ox * ox + oy * oy + z * z - radius_squared
            )
            if low <= high:
                enter, leave = min(enter, low), max(leave, high)
        return enter, leave
    enter, leave = slab(ox, dx, size[0])
    low, high = slab(oy, dy, size[1])
    enter, leave = max(enter, low), min(leave, high)
    low, high = slab(oz, dz, size[2])
    return max(enter, low), min(leave, high)


@kernel
def solid_hit(kind: int, size: Floats, position: Floats, rotation: Floats, o: Floats, d: Floats, reach: float) -> bool:
    """Return whether a ray crosses the surface of a solid that is not a hull; for `OTHER`, whether it meets the box.

    Args:
        kind: kind of the solid.
        size: MuJoCo's sizes of the solid, (3,) [m].
        position: position of the solid, (3,) [m], body frame.
        rotation: attitude of the solid in the body frame, (3, 3).
        o: start of the ray, (3,) [m], body frame.
        d: unit direction of the ray, (3,), body frame.
        reach: length of the ray [m].
    """
    x, y, z = o[0] - position[0], o[1] - position[1], o[2] - position[2]
    enter, leave = solid_interval(
        kind,
        size,
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
        rotation[0, 0] * d[0] + rotation[1, 0] * d[1] + rotation[2, 0] * d[2],
        rotation[0, 1] * d[0] + rotation[1, 1] * d[1] + rotation[2, 1] * d[2],
        rotation[0, 2] * d[0] + rotation[1, 2] * d[1] + rotation[2, 2] * d[2],
    )
    if kind == OTHER:
        return enter <= leave and enter < reach and leave >= 0
    return crossed(enter, leave, reach)
