"""Tracking without a model: each scan against the map of all scans before it, joined as they were registered.

For a craft of which not even the shape is known. The first scan's pose is the frame t of the map; a further scan is

    seen      as surface: points with normals, of the planes that its lines lie on, else of their neighbours on several
              lines (a line alone has no normal), by random sampling, so that a bend nearby does not tilt them
    matched   with the map's nearest surface that looks the same way, of several scans, each weighed by what is known of
              its normal at that distance; point to plane, Tukey's weights; straight edges with edges
              (`estimators.lidar.edge_lines`), which tell what few directions of planes leave free
    joined    to the map

so that errors do not add up as long as some of what the map knows is seen. A side that comes into view again is found
where it was, if less than the reach of a match was lost on the way. Frames and error convention are those of
`estimators.lidar.registration`. Where attitudes jump, a number of starts about the prediction are compared by what
their registration leaves.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.lidar.edge_lines import EdgeLines, across_edges, edge_lines, no_edges
from estimators.lidar.scan import Scan

SEEDS = 500
"""Points of a scan whose normals are found of their own neighbours."""
REACH = 1.7
"""Neighbours of a point lie within this many line spacings."""
DRAWS = 24
"""Planes tried through a point and two neighbours."""
SLAB = 2.5
"""Sigmas within which points lie on a plane."""
FEWEST = 8
"""Neighbours on a plane without which a point has no normal."""
PLANE_POINTS, PLANE_SHARE, PLANE_COSINE = 20, 0.8, np.cos(np.radians(25))
"""A plane of the scan: points, share of the surface within its reach that looks the same way and lies on it, and what
the same way means.
"""
PLANE_REACH = 5.0
"""Reach of a plane from its seed, against the line spacing."""
KNOWN_RAD = np.radians(12)
"""Normals less known than this are not used."""
LEAST_RAD = 1e-3
JUMP = 1.0
"""A range that jumps by this, against the line spacing, is an edge."""
NEAREST, ALIKE = 4, 0.75
"""Points of the map that a point is compared with, and the least cosine between their normals."""
ROUGH_POINTS, ROUGH_STEPS, STEPS, KEPT = 150, 8, 25, 3
"""Points and steps of the comparison of starts, steps of a registration, and starts that are registered in full."""
WIDTH_M, REACH_M, ROUGH_WIDTH_M, ROUGH_REACH_M = 0.15, 0.25, 0.15, 0.35
FREE = (0.2, 0.1)
"""How far a step may go in what the surface leaves free: attitude [rad], position [m]."""
SMALL = 1e-5
LEAST_MATCHED = 0.5


class Surface(NamedTuple):
    """Surface that a scan shows, in s. point: (n, 3) [m], as measured. foot: (n, 3) [m], on its plane. normal: (n, 3),
    towards the scanner. sigma_rad: (n,), of the normal. edge: its straight edges.
    """

    point: Floats
    foot: Floats
    normal: Floats
    sigma_rad: Floats
    edge: EdgeLines

    def rows(self, which: Bools | Ints) -> "Surface":
        """Return some of the points, and no edges."""
        return Surface(self.point[which], self.foot[which], self.normal[which], self.sigma_rad[which], no_edges())


class MapFit(NamedTuple):
    """Pose of the map in the scanner's frame: rotation (3, 3), position (3,) [m]. covariance: (6, 6), ordered
    (attitude, position). cost: mean over the points, 1 where nothing is matched. matched: share of the points.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    cost: float
    matched: float

    @property
    def tracked(self) -> bool:
        """True where enough of the scan lies on the map."""
        return self.matched >= LEAST_MATCHED


def surface(scan: Scan, seed: int = 0) -> Surface:
    """Return the surface of a scan.

    Args:
        scan: of the target alone.
        seed: of the random sampling.
    """
    point, line = scan.point, scan.line[scan.returned]
    spacing_m = scan.spacing_rad * float(np.median(np.linalg.norm(point, axis=1))) if len(point) else 1.0
    stride = max(1, len(point) // SEEDS)
    chosen = np.arange(0, len(point), stride)
    tree, rng = cKDTree(point), np.random.default_rng(seed)
    normal, sigma, foot = np.zeros_like(point), np.full(len(point), np.inf), point.copy()
    for i, members in zip(chosen, tree.query_ball_point(point[chosen], REACH * spacing_m), strict=True):
        found = _plane_through(point, line, int(i), np.array(members), scan.noise_m, rng)
        if found is not None:
            normal[i], foot[i], sigma[i] = found
    # The others take the direction of the nearest, to be taken in by planes.
    known = np.flatnonzero(np.isfinite(sigma))
    if not len(known):
        return Surface(point[:0], point[:0], point[:0], sigma[:0], no_edges())
    others = np.isinf(sigma)
    nearest = known[cKDTree(point[known]).query(point[others])[1]]
    normal[others] = normal[nearest]
    own = Surface(point, foot, normal, sigma, no_edges())
    own = _of_planes(own, scan.noise_m, PLANE_REACH * spacing_m)
    edge = edge_lines(scan.edges(JUMP * spacing_m), spacing_m)
    return own.rows(own.sigma_rad < KNOWN_RAD)._replace(edge=edge)


def _plane_through(
    point: Floats, line: Ints, i: int, members: Ints, noise_m: float, rng: np.random.Generator
) -> tuple[Floats, Floats, float] | None:
    """Return normal, foot and the normal's sigma of the plane that most neighbours of a point share with it."""
    same = members[(line[members] == line[i]) & (members != i)]
    other = members[line[members] != line[i]]
    if len(same) < 3 or len(other) < 3:
        return None
    a, b = point[rng.choice(same, DRAWS)] - point[i], point[rng.choice(other, DRAWS)] - point[i]
    tried = np.cross(a, b)
    size = np.linalg.norm(tried, axis=1)
    tried = tried[size > 0] / size[size > 0, None]
    if not len(tried):
        return None
    near = point[members] - point[i]
    inside = np.abs(tried @ near.T) < 2 * noise_m
    on = inside[np.argmax(inside.sum(axis=1))]
    for _ in range(3):
        if np.count_nonzero(on) < FEWEST:
            return None
        centre, normal, spread = _fitted(near[on])
        on = np.abs((near - centre) @ normal) < SLAB * noise_m
    off = float(-centre @ normal)
    enough = np.count_nonzero(on) >= max(FEWEST, len(members) / 2) and len(np.unique(line[members[on]])) > 1
    if not enough or abs(off) > 3 * noise_m:
        return None
    normal = normal if normal @ point[i] < 0 else -normal
    return normal, point[i] + (centre @ normal) * normal, max(noise_m / spread, LEAST_RAD)


def _fitted(point: Floats) -> tuple[Floats, Floats, float]:
    """Return centre and normal of the plane nearest to points (n, 3), and their extent, sigma times root n [m]."""
    centre = point.mean(axis=0)
    value, vector = np.linalg.eigh((point - centre).T @ (point - centre))
    return centre, vector[:, 0], float(np.sqrt(max(value[1], 1e-12)))


def _of_planes(own: Surface, noise_m: float, reach_m: float) -> Surface:
    """Return the surface with the normals of whole planes, where it is plane."""
    point, foot, normal, sigma = own.point, own.foot.copy(), own.normal.copy(), own.sigma_rad.copy()
    free = np.ones(len(point), dtype=np.bool_)
    for seed in np.argsort(sigma):
        if not np.isfinite(own.sigma_rad[seed]):
            break
        if not free[seed]:
            continue
        direction, centre = own.normal[seed], own.foot[seed]
        near = free & (np.linalg.norm(point - point[seed], axis=1) < reach_m)
        on, spread = near, 1.0
        for _ in range(4):
            alike = near & (own.normal @ direction > PLANE_COSINE)
            on = alike & (np.abs((point - centre) @ direction) < SLAB * noise_m)
            if np.count_nonzero(on) < PLANE_POINTS:
                break
            centre, turned, spread = _fitted(point[on])
            direction = turned * np.sign(turned @ direction)
        else:
            # What bends away is no plane.
            if np.count_nonzero(on) >= PLANE_SHARE * np.count_nonzero(alike):
                normal[on], sigma[on] = direction, max(noise_m / spread, LEAST_RAD)
                foot[on] = point[on] - ((point[on] - centre) @ direction)[:, None] * direction
                free[on] = False
                continue
        free[seed] = False
    return Surface(point, foot, normal, sigma, own.edge)


class LocalMap:
    """Scans joined, in the frame of the target as the first of them has it."""

    def __init__(self, noise_m: float) -> None:
        """Take the noise of a range, 1 sigma [m]."""
        self.noise_m = noise_m
        self._foot, self._normal, self._sigma = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
        self._tree = cKDTree(self._foot)
        self._edge = no_edges()
        self._edge_tree = cKDTree(self._edge.point)

    def join(self, own: Surface, rotation: Floats, position: Floats) -> None:
        """Join the surface of a scan at its pose.

        Args:
            own: its surface.
            rotation: (3, 3), map to scanner.
            position: (3,) [m], likewise.
        """
        self._foot = np.concatenate([self._foot, (own.foot - position) @ rotation])
        self._normal = np.concatenate([self._normal, own.normal @ rotation])
        self._sigma = np.concatenate([self._sigma, own.sigma_rad])
        self._tree = cKDTree(self._foot)
        self._edge = self._edge.with_those(own.edge.moved(rotation, position))
        self._edge_tree = cKDTree(self._edge.point)

    def track(self, own: Surface, rotation: Floats, position: Floats, turns: Floats | None = None) -> MapFit:
        """Return the pose of a scan near the predicted one.

        Args:
            own: its surface.
            rotation: (3, 3), predicted.
            position: (3,) [m], predicted.
            turns: (k, 3, 3), of the prediction, that are tried; None: the prediction alone.
        """
        starts = [(rotation, position)]
        if turns is not None and len(own.point):
            few = own.rows(np.arange(0, len(own.point), max(1, len(own.point) // ROUGH_POINTS)))
            rough = [
                self._fit(few, turn @ rotation, position, ROUGH_WIDTH_M, ROUGH_REACH_M, ROUGH_STEPS) for turn in turns
            ]
            starts = [(fit.rotation, fit.position) for fit in sorted(rough, key=lambda fit: fit.cost)[:KEPT]]
        return min((self._fit(own, *start, WIDTH_M, REACH_M, STEPS) for start in starts), key=lambda fit: fit.cost)

    def _fit(
        self, own: Surface, rotation: Floats, position: Floats, width: float, reach_m: float, steps: int
    ) -> MapFit:
        """Return the registration of a surface with the map."""
        s = self.noise_m
        matched, cost, normal = 0.0, 1.0, np.zeros((6, 6))
        # Where nothing says anything, the prediction stays.
        free = np.diag([FREE[0] ** -2] * 3 + [FREE[1] ** -2] * 3)
        for _ in range(steps):
            m, across, error, weight, has = self._matched(own, rotation, position, width, reach_m)
            matched = float(np.mean(has)) if len(has) else 0.0
            cost = float(np.mean(np.where(has, np.minimum((error / (2 * s)) ** 2, 1.0), 1.0))) if len(has) else 1.0
            jacobian = np.concatenate([np.cross(m, across), across], axis=1)
            normal = jacobian.T @ (weight[:, None] * jacobian)
            right = jacobian.T @ (weight * error)
            if len(own.edge.point) and len(self._edge.point):
                edges = across_edges(own.edge, self._edge, self._edge_tree, rotation, position, width, reach_m)
                normal, right = normal + edges[0], right + edges[1]
            step = np.linalg.solve(normal + free, right)
            rotation, position = rot.exp(step[:3]) @ rotation, position + step[3:]
            width = max(0.8 * width, 3.5 * s)
            if np.linalg.norm(step) < SMALL and width <= 3.5 * s:
                break
        covariance = np.asarray(np.linalg.inv(normal + free), dtype=np.float64)
        return MapFit(rotation, position, covariance, cost, matched)

    def _matched(
        self, own: Surface, rotation: Floats, position: Floats, width: float, reach_m: float
    ) -> tuple[Floats, Floats, Floats, Floats, Bools]:
        """Return points and normals in axes of s, (n, 3), errors (n,) [m], weights (n,), and which are matched (n,)."""
        there, s = (own.point - position) @ rotation, self.noise_m
        distance, index = self._tree.query(there, k=NEAREST, distance_upper_bound=reach_m)
        found = np.isfinite(distance)
        index = np.where(found, index, 0)
        normal = self._normal[index]
        off = np.einsum("nkj,nkj->nk", normal, there[:, None] - self._foot[index])
        found &= np.einsum("nkj,nj->nk", normal, own.normal @ rotation) > ALIKE
        found &= np.abs(off) < width
        beside = np.where(found, distance**2 - off**2, 0.0)
        # The map's own normal is the less exact the further from its foot.
        variance = s**2 + np.maximum(beside, 0.0) * self._sigma[index] ** 2
        share = np.where(found, (1 - (off / width) ** 2) ** 2 / variance, 0.0)
        total = share.sum(axis=1)
        has = total > 0
        share /= np.where(has, total, 1.0)[:, None]
        across = np.einsum("nk,nkj->nj", share, normal)
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        error = np.sum(share * np.where(found, off, 0.0), axis=1)
        spread = s**2 + np.sum(share**2 * np.where(found, variance, 0.0), axis=1)
        weight = np.where(has, (1 - (error / width) ** 2) ** 2 / spread, 0.0)
        return there @ rotation.T, across @ rotation.T, error, weight, has
