"""Nearest of many points, of which some count: a tree of boxes over all, thinned to those that do.

What is seen of a shape changes with the view, the shape does not: one tree is grown, and thinned for every view.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lanes import LANES, lanes_in
from estimators.lidar.ray_cast import STACK, folded, grown, put_nearest_last
from estimators.scratch import scratch


class PointTree(NamedTuple):
    """Points in a tree, as triangles are in `estimators.lidar.ray_cast.Triangles`.

    slab: (M, 6, 4) [m]. child: (M, 4). number: (L, 4), indices of the points, -1 where there are fewer; packed: (L, 3,
    4) [m], the points, infinitely far away there. A point's place in the tree is 4 l + j. size: how many there are.
    """

    slab: Floats
    child: Ints
    number: Ints
    packed: Floats
    size: int


def point_tree(point: Floats) -> PointTree:
    """Return the tree of points (n, 3) [m]."""
    return thinned(PointTree(*folded(grown(point, point), point), len(point)), np.ones(len(point), dtype=np.bool_))


def thinned(tree: PointTree, counts: Bools) -> PointTree:
    """Return the tree of some of the points, those that count by their index (n,)."""
    slab, number, packed = np.empty_like(tree.slab), np.empty_like(tree.number), np.empty_like(tree.packed)
    size = _thin_into(tree, counts, slab, number, packed)
    return PointTree(slab, tree.child, number, packed, size)


@kernel
def _thin_into(tree: PointTree, counts: Bools, slab: Floats, number: Ints, packed: Floats) -> int:
    """Write the parts of the tree that change, and return how many points there are."""
    size = 0
    for i in range(len(number)):
        for j in range(LANES):
            kept = tree.number[i, j] >= 0 and counts[tree.number[i, j]]
            number[i, j] = tree.number[i, j] if kept else -1
            size += 1 if kept else 0
            for k in range(3):
                packed[i, k, j] = tree.packed[i, k, j] if kept else np.inf
    # Boxes come before those within them; an empty one is infinitely far away.
    for b in range(len(slab) - 1, -1, -1):
        for j in range(LANES):
            child, there = tree.child[b, j], np.isfinite(tree.slab[b, 0, j])
            for k in range(3):
                low, high = np.inf, -np.inf
                for m in range(LANES if there else 0):
                    if child >= 0 and np.isfinite(slab[child, k, m]):
                        low, high = min(low, slab[child, k, m]), max(high, slab[child, 3 + k, m])
                    elif child < 0 and number[-1 - child, m] >= 0:
                        low, high = min(low, packed[-1 - child, k, m]), max(high, packed[-1 - child, k, m])
                slab[b, k, j], slab[b, 3 + k, j] = low, high if high > -np.inf else np.inf
    return size


@kernel
def nearest_into(
    tree: PointTree,
    x: float,
    y: float,
    z: float,
    within: float,
    squared: Floats,
    index: Ints,
    stack: Ints,
    gaps: Floats,
) -> int:
    """Write the nearest points, nearest first; return how many there are.

    Args:
        tree: of the points.
        x: of the place [m].
        y: likewise.
        z: likewise.
        within: squared distance, only nearer points [m^2].
        squared: receives squared distances (k,).
        index: receives their places in the tree (k,).
        stack: of boxes, `ray_cast.STACK`.
        gaps: of their squared distances, `ray_cast.STACK`.
    """
    slab, packed, seen = lanes_in(tree.slab), lanes_in(tree.packed), scratch(x, 1, LANES)
    most, found, worst, top = len(squared), 0, within, 1
    stack[0], gaps[0] = 0, 0.0
    while top > 0:
        top -= 1
        b = stack[top]
        if gaps[top] >= worst:
            continue
        if b >= 0:
            dx = max(max(slab[b, 0] - x, x - slab[b, 3]), 0.0)
            dy = max(max(slab[b, 1] - y, y - slab[b, 4]), 0.0)
            dz = max(max(slab[b, 2] - z, z - slab[b, 5]), 0.0)
            lanes_in(seen)[0] = dx * dx + dy * dy + dz * dz
            top = put_nearest_last(seen, worst, tree.child, b, stack, gaps, top)
            continue
        i = -1 - b
        dx, dy, dz = packed[i, 0] - x, packed[i, 1] - y, packed[i, 2] - z
        lanes_in(seen)[0] = dx * dx + dy * dy + dz * dz
        for j in range(LANES):
            d = seen[0, j]
            if d >= worst:
                continue
            place = found if found < most else most - 1
            while place > 0 and squared[place - 1] > d:
                squared[place], index[place] = squared[place - 1], index[place - 1]
                place -= 1
            squared[place], index[place] = d, LANES * i + j
            found = min(found + 1, most)
            if found == most:
                worst = squared[most - 1]
    return found


def nearest(tree: PointTree, point: Floats, rotation: Floats, position: Floats, reach_m: float) -> Ints:
    """Return the indices (k,) of the points nearest to (k, 3) [m] seen at a pose; -1 where none is within reach.

    Args:
        tree: of the points, in t.
        point: (k, 3) [m] in s.
        rotation: (3, 3), t to s.
        position: (3,) [m], likewise.
        reach_m: only nearer points.
    """
    out = np.empty(len(point), dtype=np.int64)
    _nearest_of_each(tree, (point - position) @ rotation, reach_m, out)
    return out


@kernel
def _nearest_of_each(tree: PointTree, point: Floats, reach: float, out: Ints) -> None:
    squared, index = np.empty(1), np.empty(1, dtype=np.int64)
    stack, gaps = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    for i in range(len(point)):
        x, y, z = point[i, 0], point[i, 1], point[i, 2]
        found = nearest_into(tree, x, y, z, reach * reach, squared, index, stack, gaps)
        out[i] = tree.number[index[0] // LANES, index[0] % LANES] if found else -1
