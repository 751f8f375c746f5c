"""Matches of a scan's points with a known shape, and the linear equations that they give for the pose.

A point is matched with the closest surface that is seen, or with where its own ray meets the mesh. Its equation is that
of `estimators.lidar.registration`: e_i = J_i d, with the weight w_i.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import LANES
from estimators.lidar.nearest import PointTree, nearest_into
from estimators.lidar.ray_cast import STACK, Triangles, cast_into
from estimators.lidar.scan import Returns
from estimators.lidar.shape import Shape

FLOOR = 0.3
"""Part of the noise that no incidence takes away, of the known shape itself."""
GRAZING = 0.12
"""Cosine of the incidence (83 degrees) beyond which a return is not used."""
NEIGHBOURS, LISTED = 4, 6
"""Surface points that a return is compared with, and those near it that are known from one step to the next."""


class Matches(NamedTuple):
    """Matches of n points: surface points (n, 3) [m], their normals (n, 3), both in t, and which have one, (n,)."""

    point: Floats
    normal: Floats
    found: Bools


class Equations(NamedTuple):
    """The points' equations at a pose: error (n,) [m], jacobian (n, 6), weight (n,) and its Tukey part (n,).

    normal, right: (6, 6), (6,), of all of them. used: how many have a weight.
    """

    error: Floats
    jacobian: Floats
    weight: Floats
    bisquare: Floats
    normal: Floats
    right: Floats
    used: int


class Nearby(NamedTuple):
    """Surface points near each of n scanned points, as they were looked up last: those nearest to a place.

    place: (n, 3) [m] in t. known: (n, `LISTED`), places in the tree. many: (n,), of these, -1 where none was sought.
    reach: (n,) [m], how far from the place nothing else is.
    """

    place: Floats
    known: Ints
    many: Ints
    reach: Floats


def unknown(count: int) -> Nearby:
    """Return that nothing is known of the surroundings of as many points."""
    known = np.empty((count, LISTED), dtype=np.int64)
    return Nearby(np.empty((count, 3)), known, np.full(count, -1), np.empty(count))


def closest(
    point: Floats, shape: Shape, seen: PointTree, nearby: Nearby, rotation: Floats, position: Floats, width: float
) -> Matches:
    """Match with the closest surface, within `width` and a little.

    Args:
        point: (n, 3) [m] in s.
        shape: of the target.
        seen: the surface points that are seen.
        nearby: what is known of the points' surroundings in this tree; becomes what is known now.
        rotation: (3, 3).
        position: (3,) [m].
        width: of the errors [m].
    """
    out = Matches(np.empty((len(point), 3)), np.empty((len(point), 3)), np.empty(len(point), dtype=np.bool_))
    reach = width + 2 * shape.spacing_m
    _closest_into(point, rotation, position, reach, seen, nearby, shape.normal, shape.spacing_m, *out)
    return out


@kernel
def _closest_into(
    point: Floats,
    rotation: Floats,
    position: Floats,
    reach: float,
    tree: PointTree,
    nearby: Nearby,
    across: Floats,
    spacing: float,
    m: Floats,
    n: Floats,
    found: Bools,
) -> None:
    work = np.empty(LISTED), np.empty(LISTED, dtype=np.int64), np.empty(STACK, dtype=np.int64), np.empty(STACK)
    own, (squared, index, _, _) = np.empty(3), work
    for i in range(len(point)):
        for k in range(3):
            own[k] = 0.0
            for c in range(3):
                own[k] += (point[i, c] - position[c]) * rotation[c, k]
        near = _near_into(tree, nearby, i, own[0], own[1], own[2], reach, work)
        best, which = np.inf, 0
        for j in range(near):
            leaf, lane = index[j] // LANES, index[j] % LANES
            t, along = tree.number[leaf, lane], 0.0
            for k in range(3):
                along += across[t, k] * (own[k] - tree.packed[leaf, k, lane])
            # A surface point stands for a disc around it: beside an edge, the nearest may be of the wrong face.
            lateral = max(np.sqrt(max(squared[j] - along**2, 0.0)) - spacing, 0.0)
            if along**2 + lateral**2 < best:
                best, which = along**2 + lateral**2, index[j]
        found[i] = near > 0
        if found[i]:
            leaf, lane = which // LANES, which % LANES
            for k in range(3):
                m[i, k], n[i, k] = tree.packed[leaf, k, lane], across[tree.number[leaf, lane], k]
        else:
            for k in range(3):
                m[i, k], n[i, k] = 0.0, 0.0


@kernel
def _near_into(
    tree: PointTree,
    nearby: Nearby,
    i: int,
    x: float,
    y: float,
    z: float,
    reach: float,
    work: tuple[Floats, Ints, Ints, Floats],
) -> int:
    """Write the `NEIGHBOURS` surface points nearest to a scanned point, and return how many there are within reach.

    While it moves little, they are among those known, since all others are further away.
    """
    squared, index, stack, gaps = work
    count, known, packed, limit = nearby.many[i], nearby.known, tree.packed, reach * reach
    if count >= 0:
        px, py, pz = x - nearby.place[i, 0], y - nearby.place[i, 1], z - nearby.place[i, 2]
        alone = max(nearby.reach[i] - np.sqrt(px * px + py * py + pz * pz), 0.0)
        found, furthest = 0, 0.0
        for j in range(count):
            s = known[i, j]
            leaf, lane = s // LANES, s % LANES
            dx, dy, dz = packed[leaf, 0, lane] - x, packed[leaf, 1, lane] - y, packed[leaf, 2, lane] - z
            d = dx * dx + dy * dy + dz * dz
            furthest = max(furthest, d)
            if d >= limit or (found == NEIGHBOURS and d >= squared[NEIGHBOURS - 1]):
                continue
            place = min(found, NEIGHBOURS - 1)
            while place > 0 and squared[place - 1] > d:
                squared[place], index[place] = squared[place - 1], index[place - 1]
                place -= 1
            squared[place], index[place] = d, s
            found = min(found + 1, NEIGHBOURS)
        if (squared[NEIGHBOURS - 1] if found == NEIGHBOURS else limit) < alone * alone:
            return found
        if count == LISTED:
            # As many are no further away than these.
            limit = min(limit, furthest * (1 + 1e-9))
    elif i > 0 and nearby.many[i - 1] == LISTED:
        # Nor are they further away than those of its neighbour on the line.
        furthest = 0.0
        for j in range(LISTED):
            leaf, lane = known[i - 1, j] // LANES, known[i - 1, j] % LANES
            dx, dy, dz = packed[leaf, 0, lane] - x, packed[leaf, 1, lane] - y, packed[leaf, 2, lane] - z
            furthest = max(furthest, dx * dx + dy * dy + dz * dz)
        limit = min(limit, furthest * (1 + 1e-9))
    count = nearest_into(tree, x, y, z, limit, squared, index, stack, gaps)
    nearby.place[i, 0], nearby.place[i, 1], nearby.place[i, 2], nearby.many[i] = x, y, z, count
    nearby.reach[i] = np.sqrt(squared[LISTED - 1]) if count == LISTED else np.sqrt(limit)
    for j in range(count):
        known[i, j] = index[j]
    return min(count, NEIGHBOURS)


def along_rays(point: Floats, shape: Shape, rotation: Floats, position: Floats) -> Matches:
    """Match with where the points' own rays meet the exact surface, other than on rims and rods.

    Args:
        point: (n, 3) [m] in s.
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    out = Matches(np.empty((len(point), 3)), np.empty((len(point), 3)), np.empty(len(point), dtype=np.bool_))
    _along_rays_into(point, rotation, position, shape.mesh, shape.broad, *out)
    return out


@kernel
def _along_rays_into(
    point: Floats,
    rotation: Floats,
    position: Floats,
    mesh: Triangles,
    broad: Bools,
    m: Floats,
    n: Floats,
    found: Bools,
) -> None:
    start, direction = np.empty_like(point), np.empty_like(point)
    for i in range(len(point)):
        square = 0.0
        for k in range(3):
            start[i, k], direction[i, k] = 0.0, 0.0
            for c in range(3):
                start[i, k] -= position[c] * rotation[c, k]
                direction[i, k] += point[i, c] * rotation[c, k]
            square += direction[i, k] ** 2
        for k in range(3):
            direction[i, k] /= np.sqrt(square)
    distance, triangle = np.empty(len(point)), np.empty(len(point), dtype=np.int64)
    cast_into(mesh, start, direction, distance, triangle)
    for i in range(len(point)):
        t = triangle[i]
        # On a rim, a ray of half a step's difference meets another face: what such a match says is chance.
        found[i] = t >= 0 and broad[t]
        for k in range(3):
            m[i, k] = start[i, k] + (distance[i] * direction[i, k] if t >= 0 else 0.0)
            n[i, k] = mesh.normal[t, k]


def linearised(returns: Returns, matches: Matches, rotation: Floats, position: Floats, width: float) -> Equations:
    """Return the equations of points matched with the surface, with Tukey's weights of a width [m].

    Args:
        returns: of the scan.
        matches: of its points.
        rotation: (3, 3).
        position: (3,) [m].
        width: beyond which a point is an outlier [m].
    """
    count = len(returns.point)
    error, weight, bisquare, jacobian = np.empty(count), np.empty(count), np.empty(count), np.empty((count, 6))
    normal, right = np.zeros((6, 6)), np.zeros(6)
    out = error, jacobian, weight, bisquare, normal, right
    used = _linearise_into(*returns, *matches, rotation, position, width, *out)
    return Equations(*out, used)


@kernel
def _linearise_into(
    point: Floats,
    noise_m: float,
    jitter_rad: float,
    m: Floats,
    n: Floats,
    found: Bools,
    rotation: Floats,
    position: Floats,
    width: float,
    error: Floats,
    jacobian: Floats,
    weight: Floats,
    bisquare: Floats,
    normal: Floats,
    right: Floats,
) -> int:
    turned, across, used = np.empty(3), np.empty(3), 0
    for i in range(len(point)):
        error[i], along, square = 0.0, 0.0, 0.0
        for k in range(3):
            own = 0.0
            turned[k], across[k] = 0.0, 0.0
            for c in range(3):
                own += (point[i, c] - position[c]) * rotation[c, k]
                turned[k] += rotation[k, c] * m[i, c]
                across[k] += rotation[k, c] * n[i, c]
            error[i] += n[i, k] * (own - m[i, k])
            along += across[k] * point[i, k]
            square += point[i, k] ** 2
        ratio, cosine = error[i] / width, along / np.sqrt(square)
        # A face seen at a grazing angle is told from its neighbour by a hair: what it would say weighs too much.
        counts = found[i] and abs(ratio) < 1 and abs(cosine) >= GRAZING
        bisquare[i] = (1 - ratio**2) ** 2 if counts else 0.0
        sideways = square * jitter_rad**2 * max(0.0, 1 - cosine**2)
        weight[i] = bisquare[i] / (noise_m**2 * (cosine**2 + FLOOR**2) + sideways)
        jacobian[i, 0] = turned[1] * across[2] - turned[2] * across[1]
        jacobian[i, 1] = turned[2] * across[0] - turned[0] * across[2]
        jacobian[i, 2] = turned[0] * across[1] - turned[1] * across[0]
        jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = across[0], across[1], across[2]
        if weight[i] > 0:
            used += 1
            for r in range(6):
                w = weight[i] * jacobian[i, r]
                right[r] += w * error[i]
                for c in range(r + 1):
                    normal[r, c] += w * jacobian[i, c]
    for r in range(6):
        for c in range(r):
            normal[c, r] = normal[r, c]
    return used
