"""First hits of rays on a triangle mesh, for whoever knows a shape and wants to know what a sensor would see of it.

A ray o + s d meets the triangle (a, b, c) where, with e1 = b - a, e2 = c - a, h = d x e2, f = (o - a) x e1
(Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997)

    s = e2 . f / (e1 . h),   u = (o - a) . h / (e1 . h),   v = d . f / (e1 . h),   u, v >= 0,  u + v <= 1,  s > 0

from either side. Triangles hang in a binary tree of boxes, split at the median along the longest axis.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel

LEAF = 4
"""Triangles in a box that is not split further."""
DEPTH = 64


class Triangles(NamedTuple):
    """A mesh ready for rays, all in one frame.

    corner: (F, 3) [m] of the first corners, edge1, edge2: (F, 3) to the other two, normal: (F, 3) unit; in the order of
    the tree's leaves. low, high: (N, 3) boxes. first, last: (N,), a leaf's triangles. right: (N,), the second child of
    a box (the first follows it), or -1 for a leaf.
    """

    corner: Floats
    edge1: Floats
    edge2: Floats
    normal: Floats
    low: Floats
    high: Floats
    first: Ints
    last: Ints
    right: Ints


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
    low, high = corners.min(axis=1), corners.max(axis=1)
    centre = (low + high) / 2
    order: list[int] = []
    boxes: list[tuple[Floats, Floats, int, int]] = []
    right: list[int] = []

    def split(members: Ints) -> None:
        here = len(boxes)
        box = low[members].min(axis=0), high[members].max(axis=0)
        boxes.append((*box, len(order), len(order) + len(members)))
        right.append(-1)
        if len(members) <= LEAF:
            order.extend(members.tolist())
            return
        axis = int(np.argmax(np.ptp(centre[members], axis=0)))
        ranked = members[np.argsort(centre[members, axis], kind="stable")]
        split(ranked[: len(ranked) // 2])
        right[here] = len(boxes)
        split(ranked[len(ranked) // 2 :])

    split(np.arange(len(corners)))
    a, b, c = (np.ascontiguousarray(corners[order, i]) for i in range(3))
    return Triangles(
        a,
        b - a,
        c - a,
        np.ascontiguousarray(normal[order]),
        np.array([box[0] for box in boxes]),
        np.array([box[1] for box in boxes]),
        np.array([box[2] for box in boxes], dtype=np.int64),
        np.array([box[3] for box in boxes], dtype=np.int64),
        np.array(right, dtype=np.int64),
    )


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
    _cast_into(mesh, start, direction, distance, triangle)
    return Hits(distance, triangle)


@kernel
def _entry(mesh: Triangles, box: int, o: Floats, inverse: Floats) -> float:
    """Return how far along the ray it enters the box [m]; inf where it passes by."""
    near, far = 0.0, np.inf
    for k in range(3):
        one, two = (mesh.low[box, k] - o[k]) * inverse[k], (mesh.high[box, k] - o[k]) * inverse[k]
        near, far = max(near, min(one, two)), min(far, max(one, two))
    return near if near <= far else np.inf


@kernel
def _cast_into(mesh: Triangles, start: Floats, direction: Floats, distance: Floats, triangle: Ints) -> None:
    stack, entries = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    inverse = np.empty(3)
    for ray in range(len(direction)):
        o, d = start[ray], direction[ray]
        for k in range(3):
            inverse[k] = 1.0 / d[k] if d[k] != 0 else 1e300
        best, which, top = np.inf, -1, 1
        stack[0], entries[0] = 0, _entry(mesh, 0, o, inverse)
        while top > 0:
            top -= 1
            box = stack[top]
            if entries[top] >= best:
                continue
            if mesh.right[box] >= 0:
                # The nearer child first: what it holds hides much of the other.
                one, two = box + 1, mesh.right[box]
                first, second = _entry(mesh, one, o, inverse), _entry(mesh, two, o, inverse)
                if second < first:
                    one, two, first, second = two, one, second, first
                if second < best:
                    stack[top], entries[top] = two, second
                    top += 1
                if first < best:
                    stack[top], entries[top] = one, first
                    top += 1
                continue
            for i in range(mesh.first[box], mesh.last[box]):
                e1, e2, a = mesh.edge1[i], mesh.edge2[i], mesh.corner[i]
                hx, hy, hz = d[1] * e2[2] - d[2] * e2[1], d[2] * e2[0] - d[0] * e2[2], d[0] * e2[1] - d[1] * e2[0]
                volume = e1[0] * hx + e1[1] * hy + e1[2] * hz
                if volume == 0:
                    continue
                sx, sy, sz = o[0] - a[0], o[1] - a[1], o[2] - a[2]
                u = (sx * hx + sy * hy + sz * hz) / volume
                if u < 0 or u > 1:
                    continue
                fx, fy, fz = sy * e1[2] - sz * e1[1], sz * e1[0] - sx * e1[2], sx * e1[1] - sy * e1[0]
                v = (d[0] * fx + d[1] * fy + d[2] * fz) / volume
                if v < 0 or u + v > 1:
                    continue
                s = (e2[0] * fx + e2[1] * fy + e2[2] * fz) / volume
                if 0 < s < best:
                    best, which = s, i
        distance[ray], triangle[ray] = best, which
