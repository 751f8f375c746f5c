"""A target's known shape, prepared once for registration: points on its surface, what is seen of it from where.

Everything is in the target's body frame t. From a triangle mesh follow

    points with normals, spread evenly over the outer surface      what a scan is compared with
    a k-d tree over them, and a grid of the nearest one            exact, and fast, closest points
    views from V directions: which points are seen, their centroid  what a scan from one side must look like

A view weighs a point by the cosine of its incidence: a scanner's rays are spread evenly over angle, not over surface.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lidar.nearest import PointTree, point_tree
from estimators.lidar.ray_cast import STACK, Triangles, cast, first_hit, triangles

POINTS = 4000
VIEWS = 240
"""Directions of the views, 13 degrees apart."""
VIEW_POINTS = 96
"""Points of a view that stand for all that is seen of it."""
ALIKE, BROAD = 0.85, 0.4
"""A triangle is in the midst of like surface if so much of its surroundings has its normal, within 32 degrees."""
BEHIND, OPEN = 3, 0.01
"""Directions from which a point must be seen from behind, and the share of such points from which on a surface is open;
fewer are rounding, where a ray slips through an edge.
"""
SHARP_RAD = np.radians(25)
OFF_CENTRE = 1.2
"""Radius about the origin, against that about the middle, from which on the origin is too far away to work with."""
CELLS = 72
"""Cells of the grid along the longest side of the box around the shape."""
MARGIN = 0.25
"""Reach of the grid beyond the box, against its longest side."""


class Grid(NamedTuple):
    """The index of the surface point nearest to the centre of every cell. low: (3,) corner [m]. cell_m: edge."""

    low: Floats
    cell_m: float
    nearest: NDArray[np.int32]


class Views(NamedTuple):
    """Views of the shape from all around. direction: (V, 3), from the shape to the viewer. seen: (V, n) surface points.
    centroid: (V, 3) [m] of what is seen. sample: (V, `VIEW_POINTS`), indices of points that represent it.
    """

    direction: Floats
    seen: Bools
    centroid: Floats
    sample: Ints


class SharpEdges(NamedTuple):
    """Points on sharp edges. point: (e, 3) [m]. tangent: (e, 3), along the edge. outward: (e, 3), between the faces'
    normals, which are one and two, (e, 3); opposite to each other where there is one face only.
    """

    point: Floats
    tangent: Floats
    outward: Floats
    one: Floats
    two: Floats


class Shape:
    """The shape. point: (n, 3) [m], normal: (n, 3) outward, mesh: its triangles, radius_m: about the body's origin.

    centre: (3,) [m], the middle where the origin is far from it, else the origin itself. two_sided: some of the surface
    is open and seen from both sides; it has its points twice, once with each normal.
    broad: (F,), triangles that are no rims, no rods. tree: a `cKDTree` of the points. spacing_m: typical distance
    between neighbouring points. edge: points on the sharp edges, where a silhouette can be.
    """

    def __init__(self, vertex: Floats, face: NDArray[np.integer], points: int = POINTS, seed: int = 0) -> None:
        """Take a mesh with vertices (V, 3) [m] and faces (F, 3); parts may overlap, and may be open surfaces.

        A closed mesh that is inside out is turned. seed: of the random points. Raises ValueError where the mesh has no
        area, is not finite, or is seen from nowhere.
        """
        face = np.asarray(face)
        self._made = vertex, face, points, seed
        self.vertex = np.asarray(vertex, dtype=np.float64)[np.unique(face)]
        self.radius_m = float(np.linalg.norm(self.vertex, axis=1).max())
        self.diameter_m = _diameter(self.vertex)
        middle = (self.vertex.min(axis=0) + self.vertex.max(axis=0)) / 2
        own_m = float(np.linalg.norm(self.vertex - middle, axis=1).max())
        self.centre: Floats = middle if self.radius_m > OFF_CENTRE * own_m else np.zeros(3)
        direction = sphere(VIEWS)
        self.mesh: Triangles = triangles(vertex, face)
        point, normal, front, back = self._sides(points, direction, seed)
        if np.count_nonzero(back) > np.count_nonzero(front):
            # A mesh that is inside out.
            face = face[:, ::-1]
            self.mesh = triangles(vertex, face)
            point, normal, front, back = self._sides(points, direction, seed)
        # What is never seen lies inside: where parts overlap. An open surface is seen from behind, too.
        outer, behind = front.any(axis=0), np.count_nonzero(back, axis=0) >= BEHIND
        behind &= np.count_nonzero(behind) > OPEN * len(point)
        self.two_sided = bool(behind.any())
        self.point = np.concatenate([point[outer], point[behind]])
        self.normal = np.concatenate([normal[outer], -normal[behind]])
        if len(self.point) < VIEW_POINTS:
            raise ValueError("face: nothing of the shape is seen from outside")
        self._seen = np.concatenate([front[:, outer], back[:, behind]], axis=1)
        self._direction = direction
        edge = sharp_edges(vertex, face, 0.012 * self.radius_m)
        shown = _seen(self.mesh, edge.point, edge.outward, direction[::4], self.radius_m).any(axis=0)
        self.edge = SharpEdges(*(part[shown] for part in edge))
        self.tree = cKDTree(self.point)
        # Of both sides of an open surface, one.
        apart = self.point[: np.count_nonzero(outer)] if outer.any() else self.point
        self.spacing_m = float(np.median(cKDTree(apart).query(apart, k=2)[0][:, 1]))
        self.broad = self._broad()
        self._rng = np.random.default_rng(seed)

    def _sides(self, points: int, direction: Floats, seed: int) -> tuple[Floats, Floats, Bools, Bools]:
        """Return points (n, 3) on the mesh, normals (n, 3), and from where each is seen in front and behind, (V, n)."""
        point, normal = _sprinkle(self.mesh, 4 * points, np.random.default_rng(seed))
        kept = _thinned(point, points)
        point, normal = point[kept], normal[kept]
        front, back = (_seen(self.mesh, point, side * normal, direction, self.radius_m) for side in (1.0, -1.0))
        return point, normal, front, back

    def _broad(self) -> Bools:
        """Return the triangles (F,) amid surface that looks the same way: not the rim of a plate, not a thin rod."""
        m = self.mesh
        reach = 2.5 * self.spacing_m
        expected = np.pi * reach**2 * len(self.point) / _area(m)
        near = self.tree.query_ball_point(m.corner + (m.edge1 + m.edge2) / 3, reach)
        of_both = np.abs if self.two_sided else np.asarray
        alike = [np.count_nonzero(of_both(self.normal[i] @ n) > ALIKE) for i, n in zip(near, m.normal, strict=True)]
        out: Bools = np.array(alike) > BROAD * expected
        return out

    @cached_property
    def nearest(self) -> PointTree:
        """A tree of the points, of which some can be left out."""
        return point_tree(self.point)

    @cached_property
    def nearest_edge(self) -> PointTree:
        """A tree of the points on sharp edges, likewise."""
        return point_tree(self.edge.point)

    @cached_property
    def centred(self) -> "Shape":
        """The shape with `centre` as its origin: about another one, a turn would move it, and no radius be its own."""
        if not self.centre.any():
            return self
        vertex, face, points, seed = self._made
        return Shape(np.asarray(vertex, dtype=np.float64) - self.centre, face, points, seed)

    @cached_property
    def views(self) -> Views:
        """The surface seen from all around, from far away."""
        weight = self._seen * np.maximum(self._direction @ self.normal.T, 0.0)
        # Edge on, nothing is seen of a flat sheet.
        some = weight.sum(axis=1) > 0
        weight = weight[some]
        share = weight / weight.sum(axis=1, keepdims=True)
        sample = np.stack([self._rng.choice(len(self.point), VIEW_POINTS, p=row) for row in share])
        return Views(self._direction[some], self._seen[some], share @ self.point, sample.astype(np.int64))

    @cached_property
    def grid(self) -> Grid:
        """The nearest surface point, by cell."""
        low, high = self.point.min(axis=0), self.point.max(axis=0)
        longest = float((high - low).max())
        cell = longest * (1 + 2 * MARGIN) / CELLS
        low, high = low - MARGIN * longest, high + MARGIN * longest
        axes = [np.arange(a + cell / 2, b, cell) for a, b in zip(low, high, strict=True)]
        centre = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return Grid(low, cell, self.tree.query(centre, eps=0.2)[1].astype(np.int32))

    def visible_from(self, viewpoint: Floats) -> Bools:
        """Return the surface points (n,) that a viewer at `viewpoint` (3,) [m] sees: facing it, with nothing in
        between.
        """
        out = np.empty(len(self.point), dtype=np.bool_)
        _visible_into(self.mesh, self.point, self.normal, viewpoint, 1e-4 * self.radius_m, out)
        return out

    def edges_from(self, viewpoint: Floats) -> Bools:
        """Return the points (e,) on sharp edges where a viewer at `viewpoint` (3,) [m] sees the surface end.

        One face looks to the viewer and the other away, and nothing is in between.
        """
        out = np.empty(len(self.edge.point), dtype=np.bool_)
        _ends_into(self.mesh, self.edge, viewpoint, 2e-3 * self.radius_m, out)
        return out


@kernel
def _visible_into(mesh: Triangles, point: Floats, normal: Floats, viewpoint: Floats, lift: float, out: Bools) -> None:
    stack, entries = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    for i in range(len(point)):
        x, y, z, nx, ny, nz = point[i, 0], point[i, 1], point[i, 2], normal[i, 0], normal[i, 1], normal[i, 2]
        dx, dy, dz = viewpoint[0] - x, viewpoint[1] - y, viewpoint[2] - z
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        over = max(distance, 1e-12)
        dx, dy, dz = dx / over, dy / over, dz / over
        out[i] = nx * dx + ny * dy + nz * dz > 0
        if out[i]:
            sx, sy, sz = x + lift * nx, y + lift * ny, z + lift * nz
            out[i] = first_hit(mesh, sx, sy, sz, dx, dy, dz, distance, stack, entries)[0] > distance


@kernel
def _ends_into(mesh: Triangles, edge: SharpEdges, viewpoint: Floats, lift: float, out: Bools) -> None:
    stack, entries = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    known, outward, one, two = edge.point, edge.outward, edge.one, edge.two
    for i in range(len(known)):
        first, second = 0.0, 0.0
        for k in range(3):
            first += (viewpoint[k] - known[i, k]) * one[i, k]
            second += (viewpoint[k] - known[i, k]) * two[i, k]
        out[i] = first * second <= 0
        if out[i]:
            x, y = known[i, 0] + lift * outward[i, 0], known[i, 1] + lift * outward[i, 1]
            z = known[i, 2] + lift * outward[i, 2]
            dx, dy, dz = viewpoint[0] - x, viewpoint[1] - y, viewpoint[2] - z
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx / distance, dy / distance, dz / distance
            out[i] = first_hit(mesh, x, y, z, dx, dy, dz, distance, stack, entries)[0] > distance


def sphere(count: int) -> Floats:
    """Return `count` directions (count, 3) spread evenly over the sphere (Fibonacci's spiral)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def sharp_edges(vertex: Floats, face: NDArray[np.integer], spacing_m: float) -> SharpEdges:
    """Return points along the edges of a mesh that are open or bend beyond `SHARP_RAD`.

    Args:
        vertex: (V, 3) [m].
        face: (F, 3), indices of vertices.
        spacing_m: of the points.
    """
    corner, index = np.unique(np.round(vertex, 6), axis=0, return_inverse=True)
    triangle = index.reshape(-1)[face]
    across = np.cross(corner[triangle[:, 1]] - corner[triangle[:, 0]], corner[triangle[:, 2]] - corner[triangle[:, 0]])
    size = np.linalg.norm(across, axis=1)
    triangle, normal = triangle[size > 1e-12], across[size > 1e-12] / size[size > 1e-12, None]
    pair = np.sort(triangle[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangle)), 3)
    unique, which, count = np.unique(pair, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which.reshape(-1), kind="stable")
    first = np.cumsum(count) - count
    a, b = normal[owner[order[first]]], normal[owner[order[first + np.minimum(count, 2) - 1]]]
    b = np.where((count == 1)[:, None], -a, b)
    sharp = (count != 2) | (np.sum(a * b, axis=1) < np.cos(SHARP_RAD))
    start, end, a, b = corner[unique[sharp, 0]], corner[unique[sharp, 1]], a[sharp], b[sharp]
    length = np.linalg.norm(end - start, axis=1)
    tangent = (end - start) / length[:, None]
    # Where the faces fold back on each other, either normal serves.
    between = np.where(np.linalg.norm(a + b, axis=1, keepdims=True) < 1e-6, a, a + b)
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    pieces = np.maximum(1, np.ceil(length / spacing_m)).astype(np.int64)
    of = np.repeat(np.arange(len(length)), pieces)
    number = np.arange(len(of)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    along = (number + 0.5) / pieces[of] * length[of]
    return SharpEdges(start[of] + along[:, None] * tangent[of], tangent[of], between[of], a[of], b[of])


def _area(mesh: Triangles) -> float:
    return float(np.linalg.norm(np.cross(mesh.edge1, mesh.edge2), axis=1).sum() / 2)


def _diameter(vertex: Floats) -> float:
    """Return the longest extent over many directions: at most 1 % short of the largest distance of two vertices."""
    return float(np.ptp(vertex @ sphere(400).T, axis=0).max())


def _sprinkle(mesh: Triangles, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return random points (count, 3), uniform over the surface, and the normals there."""
    area = np.linalg.norm(np.cross(mesh.edge1, mesh.edge2), axis=1)
    which = np.sort(rng.choice(len(area), count, p=area / area.sum()))
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return mesh.corner[which] + u * mesh.edge1[which] + v * mesh.edge2[which], mesh.normal[which]


def _seen(mesh: Triangles, point: Floats, normal: Floats, direction: Floats, radius_m: float) -> Bools:
    """Return which points (V, n) are seen from far away in each of the directions (V, 3)."""
    out: Bools = direction @ normal.T > 0
    for row, toward in zip(out, direction, strict=True):
        start = point[row] + 1e-4 * radius_m * normal[row]
        row[row] = ~np.isfinite(cast(mesh, start, np.broadcast_to(toward, start.shape)).distance)
    return out


def _thinned(point: Floats, count: int) -> Ints:
    """Return indices of about `count` points, spread evenly: one per cell of a grid whose cell is searched for."""
    if len(point) <= count:
        return np.arange(len(point))
    low, high = 0.0, float(np.ptp(point, axis=0).max())
    kept = np.arange(len(point))
    # Of 20 halvings, the smallest cell is a millionth: its numbers have 20 bits along each axis.
    for _ in range(20):
        cell = (low + high) / 2
        number = np.floor(point / cell).astype(np.int64)
        x, y, z = (number - number.min(axis=0)).T
        _, kept = np.unique((x << 42) + (y << 21) + z, return_index=True)
        low, high = (cell, high) if len(kept) > count else (low, cell)
    return np.sort(kept)
