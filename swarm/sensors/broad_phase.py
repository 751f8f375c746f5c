"""Broad phase of the rays: the craft that could block each ray, from spheres around them on a grid of directions.

A ray goes from the origin through (u, v, 1), u = x/z and v = y/z, inside the field |u|, |v| <= w = tan(field / 2). A
sphere (x, y, z), radius r, seen along y is a circle; the two tangents to it from the origin touch it at

    u = (x z -+ r s) / (z^2 - r^2),   s^2 = x^2 + z^2 - r^2,   z > r

and likewise v: a rectangle that holds every ray that meets the sphere, exact in u and in v. A sphere that reaches
behind the plane z = r takes the whole width. The field is cut into cells, and each lists the spheres whose rectangle
overlaps it. All rays to one craft lie in the cone about a sphere p, r around it, and meet another sphere m, s only
where the cones meet and m begins before p ends:

    p . m >= |p| |m| cos(asin(r / |p|) + asin(s / |m|)) = sqrt((p^2 - r^2) (m^2 - s^2)) - r s,  |m| - s <= |p| + r

Spheres that are larger by a share SLACK of their radius hold the craft until one of them has moved by as much: so long
the owners that rays to each craft could meet, `Met`, are found once.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.rotation import matrix_from_quaternion_into

MOST_CELLS = 512
"""Largest number of cells along u or v."""
SLACK = 0.1
"""Share of its radius by which an owner may move before what rays could meet is found anew."""


class Placed(NamedTuple):
    """Owners of solids at one instant, in the lighthouse frame.

    rotation: attitudes of the owners' bodies, (N, 3, 3).
    position: positions of the owners' bodies, (N, 3) [m].
    origin: the lighthouse in each owner's body frame, (N, 3) [m].
    centre: centres of the spheres around the owners, (N, 3) [m].
    """

    rotation: Floats
    position: Floats
    origin: Floats
    centre: Floats


class Grid(NamedTuple):
    """Grid of direction cells: cell (i, j) lists the owners `owner[start[n * i + j] : start[n * i + j + 1]]`, n = side.

    side: number of cells along u and along v.
    half_width: half width of the field on the plane z = 1.
    start: index of each cell's first entry in `owner`, (side^2 + 1,).
    owner: owners in the cells, one cell after the other.
    cells: first and last cell of each owner along u, and along v, (N, 4).
    """

    side: int
    half_width: float
    start: Ints
    owner: Ints
    cells: Ints


class Met(NamedTuple):
    """Owners that rays to each craft could meet: `owner[first[c] : first[c + 1]]` for craft c.

    first: (C + 1,). owner: one craft after the other.
    """

    first: Ints
    owner: Ints


@kernel
def place_into(
    position: Floats,
    quaternion: Floats,
    station_rotation: Floats,
    station_position: Floats,
    extent: Floats,
    range_max: float,
    shape: Ints,
    shape_centre: Floats,
    out: Placed,
    near: Bools,
) -> None:
    """Write the poses of the C craft before a station; the scene, owner C, stays where it is.

    A craft that lies beyond the light's range as a whole is lit nowhere and shades nothing: it is not placed, and its
    centre is behind the station.

    Args:
        position: positions of the craft, (C, 3) [m], in the world.
        quaternion: attitudes of the craft, (C, 4) wxyz.
        station_rotation: attitude of the station, (3, 3).
        station_position: position of the station, (3,) [m].
        extent: largest distance of a photodiode or a surface from each craft's origin, (C,) [m].
        range_max: longest range of the light [m].
        shape: shape of each owner, (C + 1,), -1 for none.
        shape_centre: centres of the shapes' spheres, (S, 3) [m], body frame.
        out: output, the placed owners.
        near: output, craft that the light may reach, (C,).
    """
    s = station_rotation
    for c in range(len(shape)):
        r, p = out.rotation[c], out.position[c]
        if c < len(position):
            x, y, z = (
                position[c, 0] - station_position[0],
                position[c, 1] - station_position[1],
                position[c, 2] - station_position[2],
            )
            limit = range_max + extent[c]
            near[c] = x * x + y * y + z * z <= limit * limit
            if not near[c]:
                out.centre[c, 0], out.centre[c, 1], out.centre[c, 2] = 0.0, 0.0, -np.inf
                continue
            matrix_from_quaternion_into(quaternion[c], r)
            for i in range(3):
                p[i] = s[0, i] * x + s[1, i] * y + s[2, i] * z
                u, v, w = r[0, i], r[1, i], r[2, i]
                for j in range(3):
                    r[j, i] = s[0, j] * u + s[1, j] * v + s[2, j] * w
        for i in range(3):
            out.origin[c, i] = -(r[0, i] * p[0] + r[1, i] * p[1] + r[2, i] * p[2])
            out.centre[c, i] = p[i]
            if shape[c] >= 0:
                m = shape_centre[shape[c]]
                out.centre[c, i] = p[i] + r[i, 0] * m[0] + r[i, 1] * m[1] + r[i, 2] * m[2]


@kernel
def _span(across: float, ahead: float, radius: float, half_width: float) -> tuple[float, float]:
    """Return the interval of u that a circle covers; (-w, w) where it reaches behind its own radius."""
    if not ahead > radius:
        return -half_width, half_width
    s = np.sqrt(across * across + ahead * ahead - radius * radius)
    below = (ahead - radius) * (ahead + radius)
    return (across * ahead - radius * s) / below, (across * ahead + radius * s) / below


@kernel
def cell_of(u: float, side: int, half_width: float) -> int:
    """Return the cell along one axis that holds a coordinate, or the nearest one.

    Args:
        u: coordinate u or v of the direction.
        side: number of cells along the axis.
        half_width: half width of the field on the plane z = 1.
    """
    return int(min(max((u + half_width) * (side / (2 * half_width)), 0.0), side - 1.0))


@kernel
def _cells_into(placed: Placed, shape: Ints, radius: Floats, side: int, half_width: float, out: Ints) -> int:
    """Write each owner's range of cells (N, 4), empty where it is out of sight; return the number of cells of all that
    have a shape.
    """
    total = 0
    for c in range(len(shape)):
        out[c, 0], out[c, 1], out[c, 2], out[c, 3] = 0, -1, 0, -1
        x, y, z = placed.centre[c, 0], placed.centre[c, 1], placed.centre[c, 2]
        r = radius[c]
        if z + r <= 0:
            continue
        u0, u1 = _span(x, z, r, half_width)
        v0, v1 = _span(y, z, r, half_width)
        if u1 < -half_width or u0 > half_width or v1 < -half_width or v0 > half_width:
            continue
        out[c, 0], out[c, 1] = cell_of(u0, side, half_width), cell_of(u1, side, half_width)
        out[c, 2], out[c, 3] = cell_of(v0, side, half_width), cell_of(v1, side, half_width)
        if shape[c] >= 0:
            total += (out[c, 1] - out[c, 0] + 1) * (out[c, 3] - out[c, 2] + 1)
    return total


@kernel
def sort_into_cells(placed: Placed, shape: Ints, radius: Floats, side: int, half_width: float) -> Grid:
    """Return the grid of `side` x `side` cells with every owner that a ray could meet.

    Args:
        placed: owners at one instant.
        shape: shape of each owner, (C + 1,), -1 for none.
        radius: radii of spheres around the owners' centres in which their shapes and photodiodes are, (C + 1,) [m].
        side: number of cells along u and along v.
        half_width: half width of the field on the plane z = 1.
    """
    cells = np.empty((len(shape), 4), np.int64)
    total = _cells_into(placed, shape, radius, side, half_width, cells)
    # At first start[n + 2] counts the owners in cell n; sums make start[n + 1] its first entry, then its next free one.
    start = np.empty(side * side + 2, np.int64)
    for n in range(len(start)):
        start[n] = 0
    owner = np.empty(total, np.int64)
    for c in range(len(shape)):
        for i in range(cells[c, 0], cells[c, 1] + 1 if shape[c] >= 0 else 0):
            for j in range(cells[c, 2], cells[c, 3] + 1):
                start[i * side + j + 2] += 1
    for n in range(1, side * side):
        start[n + 1] += start[n]
    for c in range(len(shape)):
        for i in range(cells[c, 0], cells[c, 1] + 1 if shape[c] >= 0 else 0):
            for j in range(cells[c, 2], cells[c, 3] + 1):
                n = i * side + j + 1
                owner[start[n]] = c
                start[n] += 1
    return Grid(side, half_width, start[: side * side + 1], owner, cells)


@kernel
def met_into(c: int, placed: Placed, grid: Grid, radius: Floats, out: Ints) -> int:
    """Write the other owners that a ray to a craft could meet, and return their number.

    Args:
        c: the craft.
        placed: owners at one instant.
        grid: owners by direction.
        radius: radii of spheres around the owners' centres in which their shapes and photodiodes are, (C + 1,) [m].
        out: output, (C + 1,).
    """
    x, y, z, r = placed.centre[c, 0], placed.centre[c, 1], placed.centre[c, 2], radius[c]
    square = x * x + y * y + z * z
    ahead, end, count = square - r * r, np.sqrt(square) + r, 0
    first, top = grid.cells[c, 0], grid.cells[c, 2]
    for i in range(first, grid.cells[c, 1] + 1):
        for j in range(top, grid.cells[c, 3] + 1):
            for n in range(grid.start[i * grid.side + j], grid.start[i * grid.side + j + 1]):
                owner = grid.owner[n]
                # An owner is looked at in the first cell that it shares with the craft.
                if owner == c or i != max(first, grid.cells[owner, 0]) or j != max(top, grid.cells[owner, 2]):
                    continue
                a, b, d, s = placed.centre[owner, 0], placed.centre[owner, 1], placed.centre[owner, 2], radius[owner]
                distance = a * a + b * b + d * d
                beyond = distance > (end + s) * (end + s)
                # A billionth less: rounding must not hide an owner.
                if not beyond and (
                    ahead <= 0
                    or distance <= s * s
                    or a * x + b * y + d * z + r * s >= (1 - 1e-9) * np.sqrt(ahead * (distance - s * s))
                ):
                    out[count] = owner
                    count += 1
    return count


@kernel
def all_met(placed: Placed, shape: Ints, radius: Floats, side: int, half_width: float) -> Met:
    """Return the owners that rays to each craft could meet.

    Args:
        placed: owners at one instant.
        shape: shape of each owner, (C + 1,), -1 for none.
        radius: radii of spheres around the owners' centres in which their shapes and photodiodes are, (C + 1,) [m].
        side: number of cells along u and along v.
        half_width: half width of the field on the plane z = 1.
    """
    craft, grid = len(shape) - 1, sort_into_cells(placed, shape, radius, side, half_width)
    first, owner, others = np.empty(craft + 1, np.int64), np.empty(4 * craft, np.int64), np.empty(craft + 1, np.int64)
    first[0] = 0
    for c in range(craft):
        begin, count = first[c], met_into(c, placed, grid, radius, others)
        if begin + count > len(owner):
            longer = np.empty(2 * (begin + count), np.int64)
            for n in range(begin):
                longer[n] = owner[n]
            owner = longer
        for n in range(count):
            owner[begin + n] = others[n]
        first[c + 1] = begin + count
    return Met(first, owner)


@kernel
def stayed(centre: Floats, before: Floats, radius: Floats) -> bool:
    """Return whether every owner is within SLACK of its radius of where it was.

    Args:
        centre: centres of the spheres around the owners, (N, 3) [m].
        before: centres before, (N, 3) [m].
        radius: radii, (N,) [m].
    """
    for c in range(len(centre)):
        x, y, z = centre[c, 0] - before[c, 0], centre[c, 1] - before[c, 1], centre[c, 2] - before[c, 2]
        limit = SLACK * radius[c]
        # What is out of reach, at -inf, has not moved where it was out of reach before.
        if not (x * x + y * y + z * z <= limit * limit or centre[c, 2] == before[c, 2] == -np.inf):
            return False
    return True
