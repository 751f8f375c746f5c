"""Straight edges of a craft that nobody knows, from scans: points where lines end, and the way the edge runs there.

Of one scan, an end belongs to an edge that runs from its neighbour on the line above to that on the line below, if the
three lie on one straight line. Two ends on the same edge, of two scans, agree across it: with the tangent T of one of
them, in axes of the scanner,

    N = x x T / |...|,   e = N . (x - m),   s^2 = (step N.a)^2 / 12 of both + (b bend)^2

a the scan line's direction, b the distance along the edge.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimators.arrays import Bools, Floats
from estimators.lidar.scan import Edges

NEIGHBOURS = 8
ACROSS = 0.85
"""Cosine to the scan's line beyond which a neighbour lies on the same line."""
STRAIGHT = 1.5
"""Steps by which the middle of three ends may lie beside the line through the others."""
REACH, LIKE, SIDE = 2.0, 0.9, 0.5
"""Reach of a neighbour against the line spacing; least cosine between tangents, and between sides, of one edge."""
BEND = 0.05
"""Sine by which a tangent may be off."""
CLEAR = 0.4


class EdgeLines(NamedTuple):
    """Ends of a scan's lines on straight edges. point: (k, 3) [m], tangent: (k, 3), along: (k, 3), the scan line's
    direction, sigma_m: (k,), along it.
    """

    point: Floats
    tangent: Floats
    along: Floats
    sigma_m: Floats

    def moved(self, rotation: Floats, position: Floats) -> "EdgeLines":
        """Return them in the frame of the target, which the pose maps to theirs."""
        return EdgeLines(
            (self.point - position) @ rotation, self.tangent @ rotation, self.along @ rotation, self.sigma_m
        )

    def with_those(self, other: "EdgeLines") -> "EdgeLines":
        """Return both."""
        return EdgeLines(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def no_edges() -> EdgeLines:
    """Return no edge at all."""
    return EdgeLines(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


def edge_lines(edges: Edges, spacing_m: float) -> EdgeLines:
    """Return the straight edges of a scan.

    Args:
        edges: the ends of its lines.
        spacing_m: between its lines, at the target.
    """
    count = min(NEIGHBOURS, len(edges.point) - 1)
    if count < 2:
        return no_edges()
    distance, index = cKDTree(edges.point).query(edges.point, k=count + 1)
    tangent, kept = np.zeros_like(edges.point), np.zeros(len(edges.point), dtype=np.bool_)
    for i, (gaps, near) in enumerate(zip(distance[:, 1:], index[:, 1:], strict=True)):
        side = edges.along[near] @ edges.along[i] > SIDE
        way = (edges.point[near] - edges.point[i]) / np.maximum(gaps, 1e-12)[:, None]
        side &= (np.abs(way @ edges.along[i]) < ACROSS) & (gaps < REACH * spacing_m)
        ways, far = way[side], gaps[side]
        # Through the end itself: the straightest pair, one of each direction.
        if len(ways) < 2:
            continue
        cosine = ways @ ways.T
        a, b = np.unravel_index(int(np.argmin(cosine)), cosine.shape)
        bent = np.sqrt(max(0.0, 1 - cosine[a, b] ** 2)) * min(far[a], far[b])
        if cosine[a, b] < -LIKE and bent < STRAIGHT * edges.width_m[i]:
            through = ways[b] * far[b] - ways[a] * far[a]
            tangent[i], kept[i] = through / np.linalg.norm(through), True
    sigma = np.hypot(edges.width_m / np.sqrt(12), edges.blur_m)
    return EdgeLines(edges.point[kept], tangent[kept], edges.along[kept], sigma[kept])


def across_edges(
    own: EdgeLines, known: EdgeLines, tree: cKDTree, rotation: Floats, position: Floats, width: float, reach_m: float
) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and the right side (6,) of a scan's edges on those of the map.

    Args:
        own: of the scan, in s.
        known: of the map, in t.
        tree: of the map's.
        rotation: (3, 3), map to scanner.
        position: (3,) [m], likewise.
        width: Tukey's [m].
        reach_m: how far along an edge two ends may lie apart [m].
    """
    there = own.moved(rotation, position)
    distance, index = tree.query(there.point, distance_upper_bound=reach_m)
    found: Bools = np.isfinite(distance)
    one, other = EdgeLines(*(part[found] for part in there)), EdgeLines(*(part[index[found]] for part in known))
    viewpoint = -rotation.T @ position
    x = one.point - viewpoint
    across = np.cross(x, other.tangent)
    size = np.linalg.norm(across, axis=1)
    across /= np.maximum(size, 1e-12)[:, None]
    gap = one.point - other.point
    error = np.sum(across * gap, axis=1)
    same = np.abs(np.sum(one.tangent * other.tangent, axis=1)) > LIKE
    same &= np.sum(one.along * other.along, axis=1) > SIDE
    same &= (size > CLEAR * np.linalg.norm(x, axis=1)) & (np.abs(error) < width)
    run = np.sum(gap * other.tangent, axis=1)
    variance = (one.sigma_m * np.sum(across * one.along, axis=1)) ** 2
    variance += (other.sigma_m * np.sum(across * other.along, axis=1)) ** 2 + (BEND * run) ** 2 + one.sigma_m**2 / 4
    weight = np.where(same, (1 - (error / width) ** 2) ** 2, 0.0) / variance
    turned, normal = other.point @ rotation.T, across @ rotation.T
    jacobian = np.concatenate([np.cross(turned, normal), normal], axis=1)
    return jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * error)
