"""First hits of rays on a triangle mesh, for whoever knows a shape and wants to know what a sensor would see of it.

A ray o + s d meets the triangle (a, b, c) where, with e1 = b - a, e2 = c - a, h = d x e2, f = (o - a) x e1
(Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997)

    s = e2 . f / (e1 . h),   u = (o - a) . h / (e1 . h),   v = d . f / (e1 . h),   u, v >= 0,  u + v <= 1,  s > 0

from either side. Triangles hang in a binary tree of boxes. A box is split between two of `BINS` slabs along one of its
axes, where the areas of both halves, times the triangles in them, are least (MacDonald and Booth, "Heuristics for ray
tracing using space subdivision", 1990): a ray meets few boxes, however uneven the mesh. Then every other generation is
left out, the largest boxes first: a ray is compared with four boxes at once, or four triangles
(`estimators.lanes`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, alike, any_of, lanes_in, select
from estimators.scratch import scratch

LEAF = LANES
"""Triangles in a box that is not split further."""
BINS = 16
DEPTH, HALVED = 64, 36
"""Boxes within boxes at most, and from which depth on a box is split in halves of equal number."""
STACK = (LANES - 1) * DEPTH + 1
"""Boxes at most that a ray has yet to enter."""


class Triangles(NamedTuple):
    """A mesh ready for rays, all in one frame.

    corner: (F, 3) [m] of the first corners, edge1, edge2: (F, 3) to the other two, normal: (F, 3) unit.

    Four boxes hang together. slab: (M, 6, 4) [m], their low and high corners, infinitely far away where there are
    fewer. child: (M, 4), what is in each: four boxes, or -1 less the number of four triangles. number: (L, 4), indices
    of these, -1 where there are fewer, and packed: (L, 9, 4), their corners and edges.
    """

    corner: Floats
    edge1: Floats
    edge2: Floats
    normal: Floats
    slab: Floats
    child: Ints
    number: Ints
    packed: Floats


class Hits(NamedTuple):
    """First hits of N rays. distance: (N,) [m] along unit directions, inf where nothing is hit. triangle: (N,) its
    index, -1.
    """

    distance: Floats
    triangle: Ints


def triangles(vertex: Floats, face: NDArray[np.integer]) -> Triangles:
    """Prepare a mesh with vertices (V, 3) [m] and faces (F, 3). Triangles without area are left out.

    Raises ValueError where no triangle is left or a coordinate is not finite.
    """
    corners = np.asarray(vertex, dtype=np.float64)[np.asarray(face)]
    if not np.isfinite(corners).all():
        raise ValueError("vertex: a coordinate is not finite")
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    real = area > 1e-12 * (area.max() if len(area) else 1.0)
    if not real.any():
        raise ValueError("face: no triangle has an area")
    corners, normal = corners[real], normal[real] / area[real, None]
    order = _spread((corners.min(axis=1) + corners.max(axis=1)) / 2)
    a, b, c = (np.ascontiguousarray(corners[order, i]) for i in range(3))
    tree = grown(np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c))
    corners = np.concatenate([a, b - a, c - a], axis=1)
    return Triangles(a, b - a, c - a, np.ascontiguousarray(normal[order]), *folded(tree, corners))


def grown(low: Floats, high: Floats) -> tuple[Floats, Ints, Ints, Ints, Ints]:
    """Return the tree of things between corners (F, 3) and (F, 3); of no things, one box infinitely far away.

    box: (N, 6) [m], low and high corners. first, last: (N,), a leaf's things. right: (N,), the second child of a box
    (the first follows it), or -1 for a leaf. number: (F,), indices of the things in the order of the leaves.
    """
    number = np.arange(len(low))
    most = 2 * len(low) + 1
    box, (first, last, right) = np.empty((most, 6)), np.zeros((3, most), dtype=np.int64)
    boxes = _grow_into(low, high, (low + high) / 2, number, box, first, last, right)
    return box[:boxes].copy(), first[:boxes].copy(), last[:boxes].copy(), right[:boxes].copy(), number


def folded(tree: tuple[Floats, Ints, Ints, Ints, Ints], row: Floats) -> tuple[Floats, Ints, Ints, Floats]:
    """Return slab, child, number and packed of `Triangles`.

    Args:
        tree: of things, by `grown`.
        row: (F, K), the numbers of each that are packed.
    """
    boxes, leaves = len(tree[0]), int(np.count_nonzero(tree[3] < 0))
    slab, child = np.empty((boxes, 6, LANES)), np.zeros((boxes, LANES), dtype=np.int64)
    number, packed = np.full((leaves, LANES), -1), np.zeros((leaves, row.shape[1], LANES))
    count = _fold_into(*tree, row, slab, child, number, packed)
    return slab[:count].copy(), child[:count].copy(), number, packed


@kernel
def _fold_into(
    box: Floats,
    first: Ints,
    last: Ints,
    right: Ints,
    order: Ints,
    row: Floats,
    slab: Floats,
    child: Ints,
    number: Ints,
    packed: Floats,
) -> int:
    """Write the tree of four boxes each, and return how many fours of boxes there are."""
    open_box, open_four = np.empty(STACK, dtype=np.int64), np.empty(STACK, dtype=np.int64)
    open_box[0], open_four[0], top, fours, leaves = 0, 0, 1, 1, 0
    own, side = np.empty(LANES, dtype=np.int64), np.empty(3)
    while top > 0:
        top -= 1
        own[0], count, k = open_box[top], 1, open_four[top]
        while count < LANES:
            largest, most = -1, -1.0
            for j in range(count):
                for c in range(3):
                    side[c] = box[own[j], 3 + c] - box[own[j], c]
                area = side[0] * side[1] + side[1] * side[2] + side[2] * side[0]
                if right[own[j]] >= 0 and area > most:
                    largest, most = j, area
            if largest < 0:
                break
            own[count], own[largest] = right[own[largest]], own[largest] + 1
            count += 1
        for j in range(LANES):
            for c in range(6):
                slab[k, c, j] = box[own[j], c] if j < count else np.inf
            if j >= count:
                continue
            if right[own[j]] >= 0:
                child[k, j], open_box[top], open_four[top] = fours, own[j], fours
                fours, top = fours + 1, top + 1
                continue
            child[k, j] = -1 - leaves
            for i in range(first[own[j]], last[own[j]]):
                at = i - first[own[j]]
                number[leaves, at] = order[i]
                for c in range(row.shape[1]):
                    packed[leaves, c, at] = row[order[i], c]
            leaves += 1
    return fours


def _spread(centre: Floats) -> Ints:
    """Return an order of the triangles with centres (F, 3) in which neighbours lie near each other."""
    order: list[Ints] = []

    def split(members: Ints) -> None:
        if len(members) <= LEAF:
            order.append(members)
            return
        axis = int(np.argmax(np.ptp(centre[members], axis=0)))
        ranked = members[np.argsort(centre[members, axis], kind="stable")]
        split(ranked[: len(ranked) // 2])
        split(ranked[len(ranked) // 2 :])

    split(np.arange(len(centre)))
    return np.concatenate(order)


@kernel
def _grow_into(
    low: Floats,
    high: Floats,
    centre: Floats,
    number: Ints,
    box: Floats,
    first: Ints,
    last: Ints,
    right: Ints,
) -> int:
    """Write the tree, reorder `number` (F,) by its leaves, and return how many boxes it has."""
    spare, slab = np.empty_like(number), np.empty(len(number), dtype=np.int64)
    open_first, open_last = np.zeros(2 * DEPTH, dtype=np.int64), np.zeros(2 * DEPTH, dtype=np.int64)
    open_parent, open_depth = np.zeros(2 * DEPTH, dtype=np.int64), np.zeros(2 * DEPTH, dtype=np.int64)
    part, rest, ends = np.empty((BINS, 6)), np.empty(6), np.empty(6)
    counts, areas = np.empty(BINS, dtype=np.int64), np.empty(BINS)
    open_last[0], open_parent[0], top, boxes = len(number), -1, 1, 0
    while top > 0:
        top -= 1
        a, b, here = open_first[top], open_last[top], boxes
        boxes += 1
        if open_parent[top] >= 0:
            right[open_parent[top]] = here
        first[here], last[here], right[here] = a, b, -1
        depth = open_depth[top]
        for k in range(3):
            box[here, k], box[here, 3 + k], ends[k], ends[3 + k] = np.inf, -np.inf, np.inf, -np.inf
            for i in range(a, b):
                t = number[i]
                box[here, k], box[here, 3 + k] = min(box[here, k], low[t, k]), max(box[here, 3 + k], high[t, k])
                ends[k], ends[3 + k] = min(ends[k], centre[t, k]), max(ends[3 + k], centre[t, k])
        if b - a <= LEAF:
            continue
        least, axis, border = np.inf, -1, 0
        for k in range(3):
            width = ends[3 + k] - ends[k]
            if not width > 0 or depth >= HALVED:
                continue
            counts[:] = 0
            part[:, :3], part[:, 3:] = np.inf, -np.inf
            for i in range(a, b):
                t = number[i]
                s = min(int((centre[t, k] - ends[k]) / width * BINS), BINS - 1)
                counts[s] += 1
                for c in range(3):
                    part[s, c], part[s, 3 + c] = min(part[s, c], low[t, c]), max(part[s, 3 + c], high[t, c])
            for side in range(2):
                count = 0
                rest[:3], rest[3:] = np.inf, -np.inf
                for step in range(BINS - 1):
                    s = BINS - 1 - step if side == 0 else step
                    count += counts[s]
                    for c in range(3):
                        rest[c], rest[3 + c] = min(rest[c], part[s, c]), max(rest[3 + c], part[s, 3 + c])
                    x, y, z = rest[3] - rest[0], rest[4] - rest[1], rest[5] - rest[2]
                    cost = count * (x * y + y * z + z * x) if count > 0 else np.inf
                    if side == 0:
                        areas[s - 1] = cost
                    elif cost + areas[s] < least:
                        least, axis, border = cost + areas[s], k, s
        middle, cut = a, (a + b) // 2
        if axis >= 0:
            width = ends[3 + axis] - ends[axis]
            for i in range(a, b):
                slab[i] = min(int((centre[number[i], axis] - ends[axis]) / width * BINS), BINS - 1)
            for side in range(2):
                for i in range(a, b):
                    if (slab[i] <= border) == (side == 0):
                        spare[middle] = number[i]
                        middle += 1
                if side == 0:
                    cut = middle
            for i in range(a, b):
                number[i] = spare[i]
        open_first[top], open_last[top], open_parent[top], open_depth[top] = cut, b, here, depth + 1
        top += 1
        open_first[top], open_last[top], open_parent[top], open_depth[top] = a, cut, -1, depth + 1
        top += 1
    return boxes


def cast(mesh: Triangles, origin: Floats, direction: Floats) -> Hits:
    """Return the first hits of rays.

    Args:
        mesh: of `triangles`.
        origin: (3,) or (N, 3) [m].
        direction: (N, 3), unit.
    """
    direction = np.ascontiguousarray(direction, dtype=np.float64)
    start = np.ascontiguousarray(np.broadcast_to(origin, direction.shape), dtype=np.float64)
    distance, triangle = np.full(len(direction), np.inf), np.full(len(direction), -1, dtype=np.int64)
    cast_into(mesh, start, direction, distance, triangle)
    return Hits(distance, triangle)


@inlined
def put_nearest_last(
    found: Floats, within: float, child: Ints, b: int, stack: Ints, distances: Floats, top: int
) -> int:
    """Put the boxes in a box that are near enough on a stack, the nearest on top; return its new height.

    The nearest is entered first: what it holds leaves out much of the others.

    Args:
        found: (1, LANES), distances of the boxes.
        within: only nearer boxes count.
        child: (B, LANES), boxes in each box.
        b: the box.
        stack: boxes to be entered, changed in place.
        distances: of these, likewise.
        top: height of the stack.
    """
    low = top
    for j in range(LANES):
        distance = found[0, j]
        if distance < within:
            place = top
            while place > low and distances[place - 1] < distance:
                stack[place], distances[place] = stack[place - 1], distances[place - 1]
                place -= 1
            stack[place], distances[place] = child[b, j], distance
            top += 1
    return top


@kernel
def first_hit(
    mesh: Triangles,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    enough: float,
    stack: Ints,
    entries: Floats,
) -> tuple[float, int]:
    """Return the distance [m] of a ray's first hit and its triangle; inf and -1 where it meets none.

    Numbers, not rows of arrays, since each row counts references.

    Args:
        mesh: of `triangles`.
        ox: of the origin [m].
        oy: likewise.
        oz: likewise.
        dx: of the direction, unit.
        dy: likewise.
        dz: likewise.
        enough: a hit as near as this, and not the first of all, will do [m].
        stack: of boxes, `STACK`.
        entries: of the distances at which the ray enters them, `STACK`.
    """
    slab, packed, found = lanes_in(mesh.slab), lanes_in(mesh.packed), scratch(ox, 1, LANES)
    ix = 1.0 / dx if dx != 0 else 1e300
    iy = 1.0 / dy if dy != 0 else 1e300
    iz = 1.0 / dz if dz != 0 else 1e300
    best, which, top = np.inf, -1, 1
    stack[0], entries[0] = 0, 0.0
    while top > 0:
        top -= 1
        b = stack[top]
        if entries[top] >= best:
            continue
        if b >= 0:
            one, two = (slab[b, 0] - ox) * ix, (slab[b, 3] - ox) * ix
            near, far = max(min(one, two), 0.0), max(one, two)
            one, two = (slab[b, 1] - oy) * iy, (slab[b, 4] - oy) * iy
            near, far = max(near, min(one, two)), min(far, max(one, two))
            one, two = (slab[b, 2] - oz) * iz, (slab[b, 5] - oz) * iz
            near, far = max(near, min(one, two)), min(far, max(one, two))
            lanes_in(found)[0] = select(near <= far, near, alike(near, np.inf))
            top = put_nearest_last(found, best, mesh.child, b, stack, entries, top)
            continue
        i = -1 - b
        ax, ay, az = packed[i, 3], packed[i, 4], packed[i, 5]
        bx, by, bz = packed[i, 6], packed[i, 7], packed[i, 8]
        hx, hy, hz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
        volume = ax * hx + ay * hy + az * hz
        sx, sy, sz = ox - packed[i, 0], oy - packed[i, 1], oz - packed[i, 2]
        u = (sx * hx + sy * hy + sz * hz) / volume
        fx, fy, fz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        v = (dx * fx + dy * fy + dz * fz) / volume
        s = (bx * fx + by * fy + bz * fz) / volume
        # Of no area, or along the ray, u is no number.
        inside = (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (u + v <= 1.0) & (s > 0.0) & (s < best)
        if any_of(inside):
            lanes_in(found)[0] = select(inside, s, alike(s, np.inf))
            for j in range(LANES):
                if found[0, j] < best:
                    best, which = found[0, j], mesh.number[i, j]
            if best <= enough:
                break
    return best, which


@kernel
def cast_into(mesh: Triangles, start: Floats, direction: Floats, distance: Floats, triangle: Ints) -> None:
    """Write the first hits of rays.

    Args:
        mesh: of `triangles`.
        start: (N, 3) [m].
        direction: (N, 3), unit.
        distance: receives distances (N,) [m], inf where nothing is hit.
        triangle: receives indices (N,), -1 there.
    """
    stack, entries = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    for i in range(len(direction)):
        ox, oy, oz = start[i, 0], start[i, 1], start[i, 2]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        distance[i], triangle[i] = first_hit(mesh, ox, oy, oz, dx, dy, dz, 0.0, stack, entries)
