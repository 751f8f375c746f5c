"""A bare mesh (OBJ, STL) as a craft: one rigid body in the file's own frame, in metres.

It serves for targets of which only the shape is known. The mass is that of the convex hull with `DENSITY`, typical of a
spacecraft.
"""

from pathlib import Path

import mujoco

from swarm.errors import SwarmError

SUFFIXES = (".obj", ".stl")
DENSITY = 100.0
"""Density of the convex hull [kg/m^3]."""


def mesh_spec(path: Path) -> mujoco.MjSpec:
    """Return the file as an MjSpec with one root body. Raises SwarmError where the file does not exist."""
    spec = mujoco.MjSpec()
    spec.modelname = path.stem
    spec.meshdir = str(path.parent)
    mesh = spec.add_mesh(name=path.stem, file=path.name)
    # Meshes of spacecraft are seldom watertight; their convex hulls always are.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body = spec.worldbody.add_body(name=path.stem)
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=path.stem, density=DENSITY, rgba=[0.75, 0.75, 0.72, 1.0])
    if not path.is_file():
        raise SwarmError(f"mesh file {path} does not exist")
    return spec
