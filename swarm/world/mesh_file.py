"""A bare mesh (OBJ, STL) as a craft: one rigid body in the file's own frame, which must be metres.

For targets of which nothing but the shape is known. Its mass is that of its convex hull at `DENSITY`, a spacecraft's.
"""

from pathlib import Path

import mujoco

from swarm.errors import SwarmError

SUFFIXES = (".obj", ".stl")
DENSITY = 100.0
"""kg/m^3."""


def mesh_spec(path: Path) -> mujoco.MjSpec:
    """The file as an MjSpec with one root body. Raises SwarmError where it cannot be read."""
    spec = mujoco.MjSpec()
    spec.modelname = path.stem
    spec.meshdir = str(path.parent)
    mesh = spec.add_mesh(name=path.stem, file=path.name)
    # Drawn spacecraft are seldom watertight: their convex hull always is.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body = spec.worldbody.add_body(name=path.stem)
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=path.stem, density=DENSITY, rgba=[0.75, 0.75, 0.72, 1.0])
    if not path.is_file():
        raise SwarmError(f"mesh file {path} does not exist")
    return spec
