"""The solids that can block the light, read once from a MuJoCo model: the geoms of every craft in its own body frame.

Every geom is of one of the kinds for which `swarm.sensors.hits` has an exact test: boxes, ellipsoids (and spheres),
cylinders, capsules, and hulls. A hull is a mesh whose triangles form a closed convex surface, stored as the planes of
its faces. Every other geom is `OTHER`: a box bounds it, and MuJoCo's own ray decides. Geoms that are fully transparent
or belong to the lighthouse block no light, as for `mj_ray`.

The owners of the geoms are the C craft and, as number C, the scene: all geoms on bodies that belong to no craft, in the
lighthouse frame. Owners with identical geoms share one shape.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from estimators.arrays import Floats, Ints
from swarm.sensors.hits import BOX, CAPSULE, CYLINDER, ELLIPSOID, HULL, OTHER
from swarm.world.rays import opaque

FLAT = 1e-6
"""Tolerance on a vertex above a face's plane, relative to the mesh's size: vertices are stored in single precision."""
_SHAPE = mujoco.mjtGeom
_KINDS = {
    int(_SHAPE.mjGEOM_BOX): BOX,
    int(_SHAPE.mjGEOM_SPHERE): ELLIPSOID,
    int(_SHAPE.mjGEOM_ELLIPSOID): ELLIPSOID,
    int(_SHAPE.mjGEOM_CYLINDER): CYLINDER,
    int(_SHAPE.mjGEOM_CAPSULE): CAPSULE,
}


class Solids(NamedTuple):
    """The C + 1 owners, their S shapes, and the N solids of these shapes, all in the owner's body frame [m].

    shape: index of each owner's shape, (C + 1,), -1 for none.
    geom: index of the geom of each owner's first solid in the list that `read_solids` returns, (C + 1,).
    shape_centre, shape_radius: sphere around each shape, (S, 3) and (S,).
    first: index of each shape's first solid, (S + 1,).
    kind: kind of each solid, (N,).
    size: MuJoCo's sizes of each solid, half sizes or radii, (N, 3).
    position, rotation: pose of each solid in the body frame, (N, 3) and (N, 3, 3).
    centre, radius: sphere around each solid, (N, 3) and (N,).
    planes: first row and the row after the last of each solid in `plane`, (N, 2).
    plane: planes of the hulls' faces, (P, 4): (n, d) with outward normal n and n . x + d <= 0 inside, body frame.
    """

    shape: Ints
    geom: Ints
    shape_centre: Floats
    shape_radius: Floats
    first: Ints
    kind: Ints
    size: Floats
    position: Floats
    rotation: Floats
    centre: Floats
    radius: Floats
    planes: Ints
    plane: Floats


class _Solid(NamedTuple):
    kind: int
    size: Floats
    position: Floats
    rotation: Floats
    centre: Floats
    radius: float
    plane: Floats


def read_solids(model: mujoco.MjModel, craft_bodies: Sequence[int] | Ints, lighthouse_body: int) -> tuple[Solids, Ints]:
    """Read the solids of all craft and of the scene.

    Geoms of the scene stand where the model's initial pose has them.

    Args:
        model: compiled model.
        craft_bodies: root bodies of the craft, (C,).
        lighthouse_body: body of the lighthouse, which blocks no light.

    Returns:
        The solids, and the model's numbers of their geoms; those of owner i begin at index `geom[i]`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    owner = _owners(model, craft_bodies)
    seen = np.flatnonzero((model.geom_bodyid != lighthouse_body) & opaque(model))
    owner_of = owner[model.geom_bodyid[seen]]
    seen = seen[np.argsort(owner_of, kind="stable")]
    start = np.searchsorted(np.sort(owner_of), np.arange(len(craft_bodies) + 2))
    known: dict[bytes, int] = {}
    shapes: list[list[_Solid]] = []
    shape_of = np.full(len(craft_bodies) + 1, -1, dtype=np.int64)
    hulls: dict[int, Floats | None] = {}
    for i in range(len(shape_of)):
        geoms = seen[start[i] : start[i + 1]]
        if not len(geoms):
            continue
        root = int(craft_bodies[i]) if i < len(craft_bodies) else 0
        position, rotation = _in_body(model, data, geoms, root)
        parts = model.geom_type[geoms], model.geom_size[geoms], model.geom_dataid[geoms], position, rotation
        key = b"".join(part.tobytes() for part in parts)
        if key not in known:
            known[key] = len(shapes)
            shapes.append(
                [_solid(model, int(g), p, r, hulls) for g, p, r in zip(geoms, position, rotation, strict=True)]
            )
        shape_of[i] = known[key]
    return _packed(shapes, shape_of, start[:-1].astype(np.int64)), seen.astype(np.int64)


def _owners(model: mujoco.MjModel, craft_bodies: Sequence[int] | Ints) -> Ints:
    """Return the owner of every body; a body comes after its parent."""
    owner = np.full(model.nbody, len(craft_bodies), dtype=np.int64)
    number = {int(body): i for i, body in enumerate(craft_bodies)}
    for body in range(1, model.nbody):
        owner[body] = number.get(body, owner[model.body_parentid[body]])
    return owner


def _in_body(model: mujoco.MjModel, data: mujoco.MjData, geoms: Ints, root: int) -> tuple[Floats, Floats]:
    """Return positions (n, 3) and rotations (n, 3, 3) of geoms in the frame of the body `root` (0: the world)."""
    if root and np.all(model.geom_bodyid[geoms] == root):
        rotation = np.empty((len(geoms), 9))
        for row, quaternion in zip(rotation, model.geom_quat[geoms], strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        return np.array(model.geom_pos[geoms]), rotation.reshape(-1, 3, 3)
    turn = data.xmat[root].reshape(3, 3)
    position = (data.geom_xpos[geoms] - data.xpos[root]) @ turn
    return position, turn.T @ data.geom_xmat[geoms].reshape(-1, 3, 3)


def _solid(
    model: mujoco.MjModel, geom: int, position: Floats, rotation: Floats, hulls: dict[int, Floats | None]
) -> _Solid:
    kind = _KINDS.get(int(model.geom_type[geom]), OTHER)
    size = np.array(model.geom_size[geom])
    none = np.zeros((0, 4))
    radius = float(model.geom_rbound[geom])
    if model.geom_type[geom] == _SHAPE.mjGEOM_SPHERE:
        size = np.full(3, size[0])
    if kind == OTHER:
        mesh = int(model.geom_dataid[geom])
        if model.geom_type[geom] == _SHAPE.mjGEOM_MESH:
            if mesh not in hulls:
                hulls[mesh] = _convex_planes(*_triangles(model, mesh))
            local = hulls[mesh]
            if local is not None:
                normal = local[:, :3] @ rotation.T
                plane = np.column_stack([normal, local[:, 3] - normal @ position])
                centre, radius = _sphere_around(_triangles(model, mesh)[0])
                return _Solid(HULL, size, position, rotation, position + rotation @ centre, radius, plane)
        # The geom's own bounding box, thickened where it is flat; a plane has none and leaves every ray to MuJoCo.
        box = model.geom_aabb[geom]
        bounded = radius > 0 and model.geom_type[geom] != _SHAPE.mjGEOM_PLANE
        size = box[3:] + FLAT * float(box[3:].max()) + FLAT if bounded else np.full(3, np.inf)
        centre = position + rotation @ box[:3] if bounded else position
        return _Solid(OTHER, size, centre, rotation, centre, float(np.linalg.norm(size)) if bounded else np.inf, none)
    return _Solid(kind, size, position, rotation, position, radius, none)


def _triangles(model: mujoco.MjModel, mesh: int) -> tuple[Floats, Ints]:
    """Return the vertices (V, 3) [m] and triangles (F, 3) of a mesh, in its own frame."""
    vertex, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    return (
        model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].astype(np.float64),
        model.mesh_face[face : face + model.mesh_facenum[mesh]].astype(np.int64),
    )


def _convex_planes(vertex: Floats, face: Ints) -> Floats | None:
    """Return the planes (P, 4), n . x + d <= 0 inside, of a closed convex surface of triangles; None for any other."""
    edge = np.sort(np.concatenate([face[:, [0, 1]], face[:, [1, 2]], face[:, [2, 0]]]), axis=1)
    _, place = np.unique(vertex, axis=0, return_inverse=True)
    _, shared = np.unique(np.sort(place.reshape(-1)[edge], axis=1), axis=0, return_counts=True)
    if len(face) < 4 or np.any(shared != 2):
        return None
    corner = vertex[face]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    size = float(np.ptp(vertex, axis=0).max())
    if np.any(area < FLAT * size**2 * FLAT):
        return None
    normal /= area[:, None]
    offset = -np.max(np.sum(normal[:, None] * corner, axis=2), axis=1)
    if np.max(normal @ vertex.T + offset[:, None]) > FLAT * size:
        return None
    kept: list[Floats] = []
    for plane in np.column_stack([normal, offset]):
        # The triangles of one flat face share one plane, the outermost.
        same = [k for k in kept if k[:3] @ plane[:3] > 1 - FLAT**2 and abs(k[3] - plane[3]) < FLAT * size]
        if same:
            same[0][3] = min(same[0][3], plane[3])
        else:
            kept.append(plane.copy())
    return np.array(kept)


def _sphere_around(point: Floats) -> tuple[Floats, float]:
    """Return centre (3,) and radius of a sphere around points (V, 3), about the middle of their bounding box."""
    centre = (point.min(axis=0) + point.max(axis=0)) / 2
    return centre, float(np.linalg.norm(point - centre, axis=1).max())


def _packed(shapes: list[list[_Solid]], shape_of: Ints, geom: Ints) -> Solids:
    solids = [solid for shape in shapes for solid in shape]
    count = len(solids)
    first = np.cumsum([0, *(len(shape) for shape in shapes)]).astype(np.int64)
    centre, radius = np.zeros((len(shapes), 3)), np.zeros(len(shapes))
    for i, shape in enumerate(shapes):
        low = np.min([s.centre - s.radius for s in shape], axis=0)
        high = np.max([s.centre + s.radius for s in shape], axis=0)
        centre[i] = (low + high) / 2 if np.isfinite(high - low).all() else 0.0
        radius[i] = max(float(np.linalg.norm(s.centre - centre[i])) + s.radius for s in shape)
    ends = np.cumsum([len(s.plane) for s in solids]).astype(np.int64)
    planes = np.stack([ends - [len(s.plane) for s in solids], ends], axis=1) if count else np.zeros((0, 2))

    def stacked(rows: list[Floats], shape: tuple[int, ...]) -> Floats:
        return np.array(rows, dtype=np.float64).reshape(count, *shape)

    return Solids(
        shape_of,
        geom,
        centre,
        # The margin keeps solids that touch the sphere from inside within it despite rounding.
        radius * (1 + 1e-9),
        first,
        np.array([s.kind for s in solids], dtype=np.int64),
        stacked([s.size for s in solids], (3,)),
        stacked([s.position for s in solids], (3,)),
        stacked([s.rotation for s in solids], (3, 3)),
        stacked([s.centre for s in solids], (3,)),
        np.array([s.radius for s in solids], dtype=np.float64) * (1 + 1e-9),
        planes.astype(np.int64),
        np.concatenate([s.plane for s in solids]) if count else np.zeros((0, 4)),
    )
