"""Geometry and colours of the recording, as plain arrays: solids, outlines, ellipsoids, the field and the fans."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from estimators.arrays import Floats, Ints
from estimators.rotation import quaternion_from_matrix
from swarm.results.scene import Visual
from swarm.world.shapes import Mesh

Colours = NDArray[np.uint8]
SHARP_RAD = np.radians(25)
MOST_EDGES = 400
"""An outline of more edges than this keeps the longest: a drawing, not a mesh."""

MOST_FACES = 300
"""A thing of more triangles is drawn plainer in a crowd."""

_BRIGHT = ("4fc3f7", "ffb74d", "81c784", "f06292", "ba68c8", "fff176", "4db6ac", "ff8a65", "90a4ae", "a1887f")


class Solid(NamedTuple):
    """Triangles (3 n vertices, no sharing) with flat normals and a colour per vertex."""

    vertex: NDArray[np.float32]
    normal: NDArray[np.float32]
    colour: Colours


def solid(visuals: Sequence[Visual]) -> Solid | None:
    """Return all parts of a thing as one mesh; None where it has no visible part."""
    vertex: list[Floats] = []
    colour: list[Colours] = []
    for mesh, rgba in visuals:
        if len(mesh.face) and rgba[3] > 0:
            corners = mesh.vertex[mesh.face].reshape(-1, 3)
            vertex.append(corners)
            colour.append(np.tile(np.rint(np.clip(rgba, 0, 1) * 255).astype(np.uint8), (len(corners), 1)))
    if not vertex:
        return None
    corner = np.concatenate(vertex)
    triangle = corner.reshape(-1, 3, 3)
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return Solid(corner.astype(np.float32), np.repeat(normal, 3, axis=0).astype(np.float32), np.concatenate(colour))


def plainer(visuals: Sequence[Visual]) -> list[Visual]:
    """Return a thing of many triangles as the convex hulls of its parts: as large as it is, with fewer of them."""
    if sum(len(mesh.face) for mesh, _ in visuals) <= MOST_FACES:
        return list(visuals)
    return [(_hull(mesh), rgba) for mesh, rgba in visuals]


def _hull(mesh: Mesh) -> Mesh:
    """Return the convex hull of a mesh, its faces turned outwards; a flat mesh stays as it is."""
    try:
        hull = ConvexHull(mesh.vertex)
    except QhullError:
        return mesh
    face = hull.simplices.copy()
    corner = mesh.vertex[face]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = np.sum(normal * hull.equations[:, :3], axis=1) < 0
    face[inward] = face[inward][:, ::-1]
    return Mesh(mesh.vertex, face)


def tinted(body: Solid, colour: int, share: float) -> Solid:
    """Return a solid in another colour.

    Args:
        body: The solid.
        colour: The colour, rgb.
        share: Part of it in the mixture with the solid's own colour, 0..1.
    """
    mixed = body.colour.astype(np.float64)
    mixed[:, :3] += share * (np.array([*colour.to_bytes(3, "big")]) - mixed[:, :3])
    return body._replace(colour=np.rint(mixed).astype(np.uint8))


def outline(visuals: Sequence[Visual]) -> Floats:
    """Return edges (E, 2, 3) [m] where the surface is open or bends by more than 25 degrees."""
    edges: list[Floats] = []
    for mesh, _ in visuals:
        point, index = np.unique(np.round(mesh.vertex, 6), axis=0, return_inverse=True)
        face = index.reshape(-1)[mesh.face]
        triangle = point[face]
        normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
        area = np.linalg.norm(normal, axis=1)
        face, normal = face[area > 1e-12], normal[area > 1e-12] / area[area > 1e-12, None]
        pair = np.sort(np.concatenate([face[:, [0, 1]], face[:, [1, 2]], face[:, [2, 0]]]), axis=1)
        owner = np.tile(np.arange(len(face)), 3)
        unique, which, count = np.unique(pair, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(which.reshape(-1), kind="stable")
        first = np.cumsum(count) - count
        a, b = owner[order[first]], owner[order[first + np.minimum(count, 2) - 1]]
        bend = np.arccos(np.clip(np.sum(normal[a] * normal[b], axis=1), -1, 1))
        edges.append(point[unique[(count != 2) | (bend > SHARP_RAD)]])
    if not edges:
        return np.zeros((0, 2, 3))
    every = np.concatenate(edges)
    longest = np.argsort(-np.linalg.norm(every[:, 1] - every[:, 0], axis=1), kind="stable")[:MOST_EDGES]
    return every[np.sort(longest)]


def ellipsoids(covariance: Floats, sigmas: float) -> tuple[Floats, Floats]:
    """Return half axes (..., 3) [m] and quaternions (..., 4) of the `sigmas` ellipsoids of covariances (..., 3, 3)."""
    variance, axes = np.linalg.eigh(covariance)
    # A reflection describes the same ellipsoid, but is not a rotation.
    axes[..., 2] *= np.linalg.det(axes)[..., None]
    return sigmas * np.sqrt(np.maximum(variance, 0.0)), quaternion_from_matrix(axes)


def palette(count: int) -> Colours:
    """Return colours (count, 4) that tell craft apart on a dark ground."""
    named = np.array([[*bytes.fromhex(code), 255] for code in _BRIGHT], dtype=np.uint8)
    return named[np.arange(count) % len(named)]


def fan(field_rad: float, reach_m: float) -> tuple[Floats, Ints]:
    """Return a fan's sector in the plane x = 0, vertices (V, 3) [m] and faces (F, 3)."""
    angle = np.linspace(-field_rad / 2, field_rad / 2, 25)
    arc = reach_m * np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    k = np.arange(1, len(angle))
    return np.concatenate([np.zeros((1, 3)), arc]), np.stack([np.zeros_like(k), k, k + 1], axis=1)


def field(field_rad: float, depth_m: float) -> list[Floats]:
    """Return the field's pyramid down to the plane z = depth: its four edges and its far rim, as strips [m]."""
    half = depth_m * np.tan(field_rad / 2)
    rim = np.array([[x, y, depth_m] for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))])
    return [np.stack([np.zeros(3), corner]) for corner in rim] + [rim[[0, 1, 2, 3, 0]]]
