"""Nearest of many points, of which some count: a tree of boxes over all, thinned to those that do.

What is seen of a shape changes with the view, the shape does not: one tree is grown, and thinned for every view.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lidar.ray_cast import DEPTH, grown


class PointTree(NamedTuple):
    """Points in a tree, as triangles are in `estimators.lidar.ray_cast.Triangles`.

    box: (N, 6) [m]. first, last, right: (N,). number: (n,), indices of the points in the order of the leaves, their
    places in the tree; packed: (n, 3) [m], the points in this order.
    """

    box: Floats
    first: Ints
    last: Ints
    right: Ints
    number: Ints
    packed: Floats


def point_tree(point: Floats) -> PointTree:
    """Return the tree of points (n, 3) [m]."""
    tree = grown(point, point)
    return PointTree(*tree, np.ascontiguousarray(point[tree[-1]]))


def thinned(tree: PointTree, counts: Bools) -> PointTree:
    """Return the tree of some of the points, those that count by their index (n,)."""
    box, number, packed = np.empty_like(tree.box), np.empty_like(tree.number), np.empty_like(tree.packed)
    first, last = tree.first.copy(), tree.last.copy()
    kept = _thin_into(tree, counts, box, first, last, number, packed)
    return PointTree(box, first, last, tree.right, number[:kept], packed[:kept])


@kernel
def _thin_into(
    tree: PointTree, counts: Bools, box: Floats, first: Ints, last: Ints, number: Ints, packed: Floats
) -> int:
    """Write the parts of the tree that change, and return how many points there are."""
    kept = 0
    for b in range(len(box)):
        if tree.right[b] >= 0:
            continue
        first[b] = kept
        for i in range(tree.first[b], tree.last[b]):
            if counts[tree.number[i]]:
                number[kept] = tree.number[i]
                for k in range(3):
                    packed[kept, k] = tree.packed[i, k]
                kept += 1
        last[b] = kept
    # A box comes before those within it; an empty one is infinitely far away.
    for b in range(len(box) - 1, -1, -1):
        one, two = b + 1, tree.right[b]
        for k in range(3):
            low, high = np.inf, -np.inf
            if two >= 0:
                low, high = min(box[one, k], box[two, k]), max(box[one, 3 + k], box[two, 3 + k])
            else:
                for i in range(first[b], last[b]):
                    low, high = min(low, packed[i, k]), max(high, packed[i, k])
            box[b, k], box[b, 3 + k] = low, high
    return kept


@kernel
def _squared_gap(box: Floats, b: int, x: float, y: float, z: float) -> float:
    """Return the squared distance of a point from box `b`."""
    dx = max(max(box[b, 0] - x, x - box[b, 3]), 0.0)
    dy = max(max(box[b, 1] - y, y - box[b, 4]), 0.0)
    dz = max(max(box[b, 2] - z, z - box[b, 5]), 0.0)
    return float(dx * dx + dy * dy + dz * dz)


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
        stack: of boxes, `ray_cast.DEPTH`.
        gaps: of their squared distances, `ray_cast.DEPTH`.
    """
    box, right, packed = tree.box, tree.right, tree.packed
    most, found, worst, top = len(squared), 0, within, 1
    stack[0], gaps[0] = 0, _squared_gap(box, 0, x, y, z)
    while top > 0:
        top -= 1
        b = stack[top]
        if gaps[top] >= worst:
            continue
        while b >= 0 and right[b] >= 0:
            one, two = b + 1, right[b]
            near, far = _squared_gap(box, one, x, y, z), _squared_gap(box, two, x, y, z)
            if far < near:
                one, two, near, far = two, one, far, near
            if far < worst:
                stack[top], gaps[top] = two, far
                top += 1
            b = one if near < worst else -1
        if b < 0:
            continue
        for i in range(tree.first[b], tree.last[b]):
            dx, dy, dz = packed[i, 0] - x, packed[i, 1] - y, packed[i, 2] - z
            d = dx * dx + dy * dy + dz * dz
            if d >= worst:
                continue
            place = found if found < most else most - 1
            while place > 0 and squared[place - 1] > d:
                squared[place], index[place] = squared[place - 1], index[place - 1]
                place -= 1
            squared[place], index[place] = d, i
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
    stack, gaps = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    for i in range(len(point)):
        x, y, z = point[i, 0], point[i, 1], point[i, 2]
        found = nearest_into(tree, x, y, z, reach * reach, squared, index, stack, gaps)
        out[i] = tree.number[index[0]] if found else -1
