"""The shape of a craft as an inspecting craft knows it: all that a LiDAR's rays meet, as one mesh, for registration."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.lidar.shape import Shape
from swarm.errors import SwarmError
from swarm.world.craft import load_craft


def surface(path: Path) -> tuple[Floats, NDArray[np.int32]]:
    """Return vertices (V, 3) [m] and faces (F, 3) of a model file, in the craft's body frame.

    Raises SwarmError where the file is no craft, or rays meet nothing of it.
    """
    meshes = load_craft(path, passive=True).surfaces
    if not meshes:
        raise SwarmError(f"{path}: no geom, or all are fully transparent: a LiDAR has nothing to see")
    first = np.cumsum([0] + [len(mesh.vertex) for mesh in meshes])
    return (
        np.concatenate([mesh.vertex for mesh in meshes]),
        np.concatenate([mesh.face + start for mesh, start in zip(meshes, first, strict=False)]),
    )


@lru_cache(maxsize=8)
def known_shape(path: Path) -> Shape:
    """Return the shape of a model file; takes about two seconds, once per process. Raises SwarmError."""
    try:
        return Shape(*surface(path))
    except ValueError as error:
        raise SwarmError(f"{path}: no shape that a LiDAR could recognise: {error}") from None
