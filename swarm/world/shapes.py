"""Triangle meshes of MuJoCo's primitive shapes, for drawing: vertices (V, 3) [m] and faces (F, 3), facing outward."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats

AROUND = 24
"""Number of facets around a round shape."""
ALONG = 12
"""Number of facets from pole to pole of a sphere; even, so that a capsule can be cut at its equator."""


class Mesh(NamedTuple):
    """A triangle mesh: vertex (V, 3) [m], face (F, 3) indices, counterclockwise seen from outside."""

    vertex: Floats
    face: NDArray[np.int32]


def box(half: Floats) -> Mesh:
    """Return a box with half sizes (3,) [m]."""
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    face = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Mesh(corner * half, np.array(face, dtype=np.int32))


def ellipsoid(radius: Floats) -> Mesh:
    """Return an ellipsoid with radii (3,) [m]; a sphere where they are equal."""
    polar = np.linspace(0, np.pi, ALONG + 1)[1:-1]
    unit = _revolve(np.sin(polar), np.cos(polar), 1.0, -1.0)
    return Mesh(unit.vertex * radius, unit.face)


def cylinder(radius: float, half_length: float) -> Mesh:
    """Return a cylinder along z [m]."""
    return _revolve(np.full(2, radius), np.array([half_length, -half_length]), half_length, -half_length)


def capsule(radius: float, half_length: float) -> Mesh:
    """Return a capsule along z [m]; the half length is that of its straight part."""
    polar = np.linspace(0, np.pi / 2, ALONG // 2 + 1)[1:]
    across, height = radius * np.sin(polar), radius * np.cos(polar) + half_length
    top = radius + half_length
    return _revolve(np.concatenate([across, across[::-1]]), np.concatenate([height, -height[::-1]]), top, -top)


def _revolve(across: Floats, height: Floats, top: float, bottom: float) -> Mesh:
    """Revolve a profile, from the top pole down to the bottom one, about z."""
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    rings = np.stack(
        [np.outer(across, np.cos(turn)), np.outer(across, np.sin(turn)), np.outer(height, np.ones(AROUND))], axis=-1
    ).reshape(-1, 3)
    north, south = len(rings), len(rings) + 1
    here = np.arange(AROUND)
    there = np.roll(here, -1)
    last = (len(height) - 1) * AROUND
    face = [np.stack([np.full(AROUND, north), here, there], axis=1)]
    for ring in range(0, last, AROUND):
        a, b, c, d = ring + here, ring + AROUND + here, ring + AROUND + there, ring + there
        face += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    face.append(np.stack([np.full(AROUND, south), last + there, last + here], axis=1))
    vertex = np.concatenate([rings, [[0.0, 0.0, top], [0.0, 0.0, bottom]]])
    return Mesh(vertex, np.concatenate(face).astype(np.int32))
