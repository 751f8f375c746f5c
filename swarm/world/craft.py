"""A craft's model file: MJCF read, checked, and reduced to one rigid body, with the hardware that the file defines.

The body frame `b` is the frame of the file's one root body. Bodies below it that no joint moves are fused into it
(geoms, photodiodes and inertia included); its pose in the file and its free joint are dropped, since the world places
it. The photodiodes are the sites whose name starts with `photodiode`; a site's z axis is the photodiode's outward
normal. Cameras and lights of the CCD sensor: `swarm.world.optics`; thrusters and reaction wheels:
`swarm.world.propulsion`; docking ports: `swarm.world.docking`. The site `lidar`, if there is one, is the frame of a
LiDAR: its z axis is the spin axis. A mesh file (OBJ, STL) is a craft of one part.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats, Ints
from estimators.rotation import matrix_from_quaternion
from swarm.errors import SwarmError
from swarm.hardware import Cameras, Lights, Port, Thrusters, Wheels
from swarm.world import shapes
from swarm.world.docking import port_of
from swarm.world.mesh_file import check_faces, read_named_meshes
from swarm.world.model_file import check_one_body, open_model
from swarm.world.optics import cameras_of, lights_of
from swarm.world.propulsion import thrusters_of, wheels_of
from swarm.world.rays import opaque

LEAST_PHOTODIODES = 4
"""Smallest number of photodiodes for PnP (section 2 of source 1)."""
SAME_PLACE_M = 1e-5
"""Photodiodes nearer to each other, or to a common line, than this are at one place, or on the line [m]."""
FARTHEST_M = 1e4
"""Largest coordinate of a part of a craft [m]."""
FAR_SIZES, FAR_M = 10.0, 1.0
"""Hardware farther from its craft than so many of the craft's sizes, and than so much [m], is a slip of the unit."""
MOUNTED = ("photodiode", "thruster", "port", "lidar", "light", "wheel")
"""Beginnings of the names of sites that are hardware."""
FREE_JOINT = "free"
"""Name, without the craft's prefix, of the joint that the loader gives every craft."""
LIDAR_SITE = "lidar"
REFERRING = ("keys", "sensors", "actuators", "tendons", "equalities", "pairs", "excludes", "tuples", "flexes", "skins")
"""Elements outside the tree of bodies that refer to it."""
DRAWN_GROUPS = 3
"""Number of geom groups that MuJoCo's viewer shows (0, 1, 2); by convention, later groups are only for collisions."""


FilePose = tuple[Floats, Floats]
"""Position (3,) [m] and quaternion (4,) wxyz of the root body in its own file."""


class Visual(NamedTuple):
    """One coloured part of a craft.

    mesh: triangles in the body frame [m], facing outward.
    rgba: colour, (4,) in 0..1.
    """

    mesh: shapes.Mesh
    rgba: Floats


class CraftModel(NamedTuple):
    """Contents of a craft's model file, in the body frame.

    path: the file.
    spec: one rigid root body with a free joint, without sites; attaching copies it and never moves it.
    file_pose: pose of the root body in the file.
    mass: mass [kg].
    com_m: centre of mass, (3,) [m].
    inertia: inertia about the centre of mass, (3, 3) [kg m^2].
    point_m, normal: photodiodes in the order of the sites' numbers, (K, 3) [m] and (K, 3).
    visuals: drawn parts.
    surfaces: all that rays meet, drawn or not; triangles in the body frame [m], facing outward.
    cameras, lights, thrusters, wheels: other hardware, empty where the file has none.
    port: docking port; None without one.
    """

    path: Path
    spec: mujoco.MjSpec
    file_pose: FilePose
    mass: float
    com_m: Floats
    inertia: Floats
    point_m: Floats
    normal: Floats
    visuals: tuple[Visual, ...]
    surfaces: tuple[shapes.Mesh, ...]
    lidar: tuple[Floats, Floats] | None
    """Frame of the scanner: rotation R_b_s (3, 3) and position (3,) [m]; None without one."""
    cameras: Cameras
    lights: Lights
    thrusters: Thrusters
    wheels: Wheels
    port: Port | None


@lru_cache(maxsize=64)
def _load_version(path: Path, modified_ns: int) -> CraftModel:
    spec, model = rigid(path)
    sites = photodiode_sites(model)
    turn = matrix_from_quaternion(model.body_iquat[1])
    # Sites and numbers are not needed once they are read: MuJoCo would compute every site's pose at every step.
    for element in [*spec.sites, *spec.numerics]:
        spec.delete(element)
    return CraftModel(
        path,
        spec,
        _file_pose(model),
        float(model.body_mass[1]),
        model.body_ipos[1].copy(),
        turn @ np.diag(model.body_inertia[1]) @ turn.T,
        model.site_pos[sites].copy(),
        matrix_from_quaternion(model.site_quat[sites])[:, :, 2],
        visuals_of(model),
        tuple(part.mesh for part in surfaces_of(model)),
        _lidar_site(model),
        cameras_of(model, path),
        lights_of(model),
        thrusters_of(model, path),
        wheels_of(model, path),
        port_of(model, path),
    )


def load_craft(path: Path, passive: bool = False) -> CraftModel:
    """Read a craft's model file, once per process as long as the file does not change.

    Args:
        path: the file.
        passive: the craft does not navigate, and needs no photodiodes.

    Raises:
        SwarmError: The file does not exist, MuJoCo does not compile it (with its message), it has not exactly one root
            body, a joint moves a part of the craft, or its photodiodes are fewer than four, at fewer than four
            places, on one line, or nowhere.
    """
    craft = _load_version(path.resolve(), _modified_ns(path))
    if not passive:
        _check_layout(craft.point_m, path)
    return craft


def _check_layout(point_m: Floats, path: Path) -> None:
    """Raise SwarmError where photodiodes at `point_m` (K, 3) [m] never determine a pose, whatever is lit."""
    advice = "a craft that does not cooperate is passive = true"
    if len(point_m) < LEAST_PHOTODIODES:
        raise SwarmError(
            f"{path}: {len(point_m)} photodiodes (sites whose name starts with 'photodiode'), at least "
            f"{LEAST_PHOTODIODES} are needed for a pose; {advice}"
        )
    apart = np.linalg.norm(point_m[:, None] - point_m, axis=2) > SAME_PLACE_M
    # Each photodiode that is not where an earlier one is.
    places = np.count_nonzero([row[:i].all() for i, row in enumerate(apart)])
    across = np.linalg.svd(point_m - point_m.mean(axis=0), compute_uv=False)[1]
    where = "at one point" if places == 1 else "on one line" if across < SAME_PLACE_M else ""
    if where:
        raise SwarmError(
            f"{path}: all {len(point_m)} photodiodes are {where} (within {1e3 * SAME_PLACE_M:g} mm): such a layout "
            f"never determines a pose; {advice}"
        )
    if places < LEAST_PHOTODIODES:
        raise SwarmError(
            f"{path}: {len(point_m)} photodiodes, but at {places} places only: at least {LEAST_PHOTODIODES} different "
            f"places are needed for a pose; {advice}"
        )


def load_static(path: Path) -> tuple[mujoco.MjSpec, FilePose]:
    """Return the MJCF of a motionless object, such as the lighthouse: one root body without a joint, and its pose.

    Raises SwarmError as `load_craft` does.
    """
    _modified_ns(path)
    spec, model = rigid(path, free=False)
    return spec, _file_pose(model)


def visuals(path: Path) -> tuple[Visual, ...]:
    """Return the drawn parts of any model file with one root body, in the root body's frame. Raises SwarmError."""
    _modified_ns(path)
    return visuals_of(rigid(path, free=False)[1])


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from printing warnings and writing MUJOCO_LOG.TXT; the caller reads the warnings that matter.

    Raises SwarmError where MuJoCo gives up, for instance without memory for all contacts of a crowd.
    """
    before = mujoco.MjLogConfig.get()
    mujoco.MjLogConfig().set()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            yield
    except mujoco.FatalError as error:
        raise SwarmError(f"MuJoCo gives up: {' '.join(str(error).split())}") from None
    finally:
        before.set()


def _file_pose(model: mujoco.MjModel) -> FilePose:
    return model.body_pos[1].copy(), model.body_quat[1].copy()


def _modified_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise SwarmError(f"model file {path} cannot be read: {error.strerror}") from None


def rigid(path: Path, free: bool = True) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Return the file's one root body with everything fused into it, and its compiled model.

    Raises SwarmError as `load_craft` does, except for missing photodiodes.
    """
    try:
        with quiet():
            spec = open_model(path)
            check_one_body(spec, path)
            # By default MuJoCo keeps geoms that do not collide; a file may ask otherwise, but light meets them.
            spec.compiler.discardvisual = False
            read_named_meshes(spec)
            spec.compile()
            model = _fuse(spec, path, free)
            check_faces(spec, model)
            _check_numbers(model, path)
            _check_mounted(model, path)
            return spec, model
    except ValueError as error:
        raise SwarmError(f"{path} does not compile: {' '.join(str(error).split())}") from None


def _fuse(spec: mujoco.MjSpec, path: Path, free: bool) -> mujoco.MjModel:
    root = spec.worldbody.bodies[0]
    for joint in list(spec.joints):
        if joint.parent.name != root.name or joint.type != mujoco.mjtJoint.mjJNT_FREE:
            raise SwarmError(f"{path}: joint {joint.name!r} moves a part; a craft must be one rigid body")
        spec.delete(joint)
    # Elements that refer to a body would keep it from being fused, and have no meaning for one rigid body.
    for kind in REFERRING:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    root = spec.worldbody.bodies[0]
    root.add_freejoint(name=FREE_JOINT, align=mujoco.mjtAlignFree.mjALIGNFREE_FALSE)
    spec.fuse_static()
    if not free:
        spec.delete(spec.joint(FREE_JOINT))
    model = spec.compile()
    if model.nbody != 2:
        raise SwarmError(f"{path}: body {model.body(2).name!r} cannot be fused with the root body")
    return model


def _check_numbers(model: mujoco.MjModel, path: Path) -> None:
    """Raise SwarmError for a site, geom or camera whose place MuJoCo takes although it is no place at all."""
    elements = ((model.site, model.site_pos), (model.geom, model.geom_pos), (model.cam, model.cam_pos))
    for element, position in elements:
        wrong = ~(np.abs(position) <= FARTHEST_M).all(axis=1)
        if wrong.any():
            one = element(int(np.argmax(wrong)))
            kind = type(one).__name__.strip("_").removeprefix("MjModel").removesuffix("Views").lower()
            place = " ".join(f"{value:g}" for value in one.pos)
            raise SwarmError(f"{path}: {kind} {one.name!r}: pos = {place!r}: must be within {FARTHEST_M:g} m")
    if not (np.isfinite(model.body_mass).all() and np.isfinite(model.body_inertia).all()):
        raise SwarmError(f"{path}: mass or inertia is not finite: {model.body_mass[1]:g} kg, {model.body_inertia[1]}")


def _check_mounted(model: mujoco.MjModel, path: Path) -> None:
    """Raise SwarmError for hardware far off its craft, whose place was meant in another unit."""
    sites = [model.site(i) for i in range(model.nsite)]
    mounted = [site for site in sites if site.name.startswith(MOUNTED)]
    if not mounted:
        return
    point = np.array([site.pos for site in mounted])
    if model.ngeom:
        centre, radius = model.geom_pos, np.maximum(model.geom_rbound, 0.0)
    else:
        # Nothing to be mounted on: the hardware itself is the craft, but for what is far off.
        centre = np.median(point, axis=0)[None]
        radius = np.array([np.median(np.linalg.norm(point - centre, axis=1))])
    size = float(np.linalg.norm(np.max(centre + radius[:, None], axis=0) - np.min(centre - radius[:, None], axis=0)))
    off = np.min(np.linalg.norm(point[:, None] - centre, axis=2) - radius, axis=1)
    far = np.flatnonzero(off > max(FAR_M, FAR_SIZES * size))
    if len(far):
        more = f" (and {len(far) - 1} more)" if len(far) > 1 else ""
        raise SwarmError(
            f"{path}: {mounted[far[0]].name} is {off[far[0]]:.3g} m from the craft{more}: lengths in MJCF are metres"
        )


def photodiode_sites(model: mujoco.MjModel) -> list[int]:
    """Return site indices in the order of the numbers in their names: photodiode2 before photodiode10."""
    found = []
    for site in range(model.nsite):
        name = model.site(site).name
        if name.startswith("photodiode"):
            number = re.search(r"\d+", name)
            found.append((int(number.group()) if number else 0, name, site))
    return [site for _, _, site in sorted(found)]


def _lidar_site(model: mujoco.MjModel) -> tuple[Floats, Floats] | None:
    for site in range(model.nsite):
        if model.site(site).name == LIDAR_SITE:
            return matrix_from_quaternion(model.site_quat[site]), model.site_pos[site].copy()
    return None


def visuals_of(model: mujoco.MjModel) -> tuple[Visual, ...]:
    """Return the drawn parts of body 1 of a model, in its frame."""
    geoms = np.flatnonzero(model.geom_bodyid == 1)
    drawn = geoms[model.geom_group[geoms] < DRAWN_GROUPS]
    return _parts(model, drawn if len(drawn) else geoms)


def surfaces_of(model: mujoco.MjModel) -> tuple[Visual, ...]:
    """Return the parts of body 1 of a model that rays meet (`swarm.world.rays`), in its frame."""
    return _parts(model, np.flatnonzero((model.geom_bodyid == 1) & opaque(model)))


def _parts(model: mujoco.MjModel, geoms: Ints) -> tuple[Visual, ...]:
    parts = []
    for geom in geoms:
        mesh = _mesh(model, int(geom))
        if mesh is None:
            continue
        turn = matrix_from_quaternion(model.geom_quat[geom])
        material = model.geom_matid[geom]
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        moved = shapes.Mesh(mesh.vertex @ turn.T + model.geom_pos[geom], mesh.face)
        parts.append(Visual(moved, np.array(rgba, dtype=np.float64)))
    return tuple(parts)


def _mesh(model: mujoco.MjModel, geom: int) -> shapes.Mesh | None:
    """Return the geom's triangles in its own frame; None for geoms without a closed surface (planes, height fields)."""
    shape = mujoco.mjtGeom
    kind, size = shape(int(model.geom_type[geom])), np.array(model.geom_size[geom])
    if kind in (shape.mjGEOM_MESH, shape.mjGEOM_SDF):
        mesh = int(model.geom_dataid[geom])
        first_vertex, first_face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertex = model.mesh_vert[first_vertex : first_vertex + model.mesh_vertnum[mesh]].astype(np.float64)
        face = model.mesh_face[first_face : first_face + model.mesh_facenum[mesh]].copy()
        return shapes.Mesh(vertex, face)
    if kind == shape.mjGEOM_BOX:
        return shapes.box(size)
    if kind == shape.mjGEOM_SPHERE:
        return shapes.ellipsoid(np.full(3, size[0]))
    if kind == shape.mjGEOM_ELLIPSOID:
        return shapes.ellipsoid(size)
    if kind == shape.mjGEOM_CYLINDER:
        return shapes.cylinder(size[0], size[1])
    if kind == shape.mjGEOM_CAPSULE:
        return shapes.capsule(size[0], size[1])
    return None
