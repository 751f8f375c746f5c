"""Mesh files, OBJ and STL: every face of the file, or a refusal that says why.

MuJoCo's own reader takes only the first group of an OBJ and no ASCII STL. This one takes

    OBJ          all objects and groups, any number of corners per face, negative indices, lines continued by a
                 backslash; faces of four and more corners become triangles, also where they are not convex
    binary STL   as many triangles as its header says, or else the file is damaged
    ASCII STL    all solids

and gives them to MuJoCo as arrays: a bare mesh as a craft, and the meshes that an MJCF file names. Lines, points and
looks (normals, textures, materials) are no surface. Free-form curves and surfaces of OBJ are refused.
"""

import re
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np

from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError
from swarm.world.shapes import Mesh

SUFFIXES = (".obj", ".stl")
DENSITY = 100.0
"""Density of a bare mesh's convex hull [kg/m^3], typical of a spacecraft."""
HEADER, RECORD = 84, 50
"""Bytes of a binary STL before its triangles, and of each triangle."""
NO_SURFACE = re.compile(r"v[tnp]|[goslp]|usemtl|mtllib|usemap|maplib|lod|bevel|[cd]_interp|shadow_obj|trace_obj|mg")
"""Keywords of OBJ that add no surface."""
FREE_FORM = re.compile(r"cstype|deg|bmat|step|curv2?|surf|parm|trim|hole|scrv|sp|end|con|[cs]tech")
"""Keywords of OBJ's curves and surfaces."""


def mesh_spec(path: Path) -> mujoco.MjSpec:
    """Return a bare mesh as an MjSpec with one root body in the file's own frame, in metres.

    It serves for targets of which only the shape is known. The mass is that of the convex hull with `DENSITY`.

    Raises:
        SwarmError: `read_mesh` refuses the file.
    """
    spec = mujoco.MjSpec()
    spec.modelname = path.stem
    mesh = spec.add_mesh(name=path.stem)
    _fill(mesh, read_mesh(path))
    # Meshes of spacecraft are seldom watertight; their convex hulls always are.
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body = spec.worldbody.add_body(name=path.stem)
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=path.stem, density=DENSITY, rgba=[0.75, 0.75, 0.72, 1.0])
    return spec


def read_named_meshes(spec: mujoco.MjSpec) -> None:
    """Give a spec the faces of all OBJ and STL files that it names, in place of the files.

    Raises:
        SwarmError: `read_mesh` refuses a file.
        ValueError: MuJoCo finds a file that its own folders name, but refuses something else.
    """
    _read_where(spec, lambda mesh: _in_folders(spec, Path(mesh.file)))
    if any(_is_ours(mesh) for mesh in spec.meshes):
        # A mesh of an attached model has folders of its own, which only MuJoCo knows.
        model = spec.copy().compile()
        found = {model.mesh(i).name: _path_of(model, i) for i in range(model.nmesh)}
        _read_where(spec, lambda mesh: found.get(mesh.name))
        missing = [mesh.file for mesh in spec.meshes if _is_ours(mesh)]
        if missing:
            raise SwarmError(f"mesh file {missing[0]}: its folder cannot be told; write its path from the model's file")


def check_faces(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Check that the compiled model has every face that was read. Raises SwarmError where it does not."""
    for mesh in spec.meshes:
        wanted = len(mesh.userface) // 3
        got = int(model.mesh_facenum[model.mesh(mesh.name).id])
        if wanted and got != wanted:
            raise SwarmError(f"mesh {mesh.name!r}: {wanted} triangles were read, MuJoCo keeps {got} of them")


def read_mesh(path: Path) -> Mesh:
    """Return all triangles of an OBJ or STL file; what it calls outward is kept.

    Raises:
        SwarmError: the file cannot be read, is damaged, has no face or one that makes no sense; with line and value.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise SwarmError(f"mesh file {path} does not exist") from None
    except OSError as error:
        raise SwarmError(f"mesh file {path} cannot be read: {error.strerror}") from None
    try:
        vertex, face = _obj(data) if path.suffix.lower() == ".obj" else _stl(data)
        if not len(face):
            raise ValueError("it has no face")
        if not np.isfinite(vertex[face]).all():
            raise ValueError("a coordinate is not finite")
    except ValueError as error:
        raise SwarmError(f"mesh file {path}: {error}") from None
    used, index = np.unique(face, return_inverse=True)
    return Mesh(vertex[used], index.reshape(-1, 3).astype(np.int32))


def _is_ours(mesh: mujoco.MjsMesh) -> bool:
    return Path(mesh.file).suffix.lower() in SUFFIXES or mesh.content_type in ("model/obj", "model/stl")


def _read_where(spec: mujoco.MjSpec, place: Callable[[mujoco.MjsMesh], Path | None]) -> None:
    for mesh in spec.meshes:
        path = place(mesh) if _is_ours(mesh) else None
        if path is not None:
            # MuJoCo names a mesh after its file.
            mesh.name = mesh.name or Path(mesh.file).stem
            _fill(mesh, read_mesh(path))


def _fill(mesh: mujoco.MjsMesh, read: Mesh) -> None:
    mesh.file = mesh.content_type = ""
    mesh.uservert, mesh.userface = read.vertex.ravel(), read.face.ravel()


def _in_folders(spec: mujoco.MjSpec, file: Path) -> Path | None:
    """Return the file as the spec's own folders place it, if it is there."""
    name = Path(file.name) if spec.strippath else file
    path = Path(spec.modelfiledir) / spec.meshdir / name
    return path if path.is_file() else None


def _path_of(model: mujoco.MjModel, mesh: int) -> Path | None:
    start = int(model.mesh_pathadr[mesh])
    return Path(model.paths[start:].split(b"\0")[0].decode()) if start >= 0 else None


def _obj(data: bytes) -> tuple[Floats, Ints]:
    """Return the vertices (V, 3) and triangles (F, 3) of an OBJ. Raises ValueError with the line."""
    vertex: list[list[float]] = []
    polygon: list[tuple[int, list[int]]] = []
    text = data.removeprefix(b"\xef\xbb\xbf").decode("latin-1").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.split("\n"), 1):
        word = line.partition("#")[0].split()
        if not word or NO_SURFACE.fullmatch(word[0]):
            continue
        try:
            if word[0] == "v":
                vertex.append([float(value) for value in word[1:4]])
                if len(word) < 4:
                    raise ValueError("a vertex has three coordinates")
            elif word[0] in ("f", "fo"):
                polygon.append((number, [_index(corner, len(vertex)) for corner in word[1:]]))
                if len(word) < 4:
                    raise ValueError("a face has three corners or more")
            elif FREE_FORM.fullmatch(word[0]):
                raise ValueError("free-form curves and surfaces are not read; export triangles")
            else:
                raise ValueError("this is no OBJ keyword that can be read")
        except ValueError as error:
            raise ValueError(f"line {number}, {' '.join(word)[:60]!r}: {error}") from None
    points = np.array(vertex, dtype=np.float64).reshape(-1, 3)
    face: list[tuple[int, int, int]] = []
    for number, corner in polygon:
        if max(corner) >= len(points):
            raise ValueError(f"line {number}: corner {max(corner) + 1}, but the file has {len(points)} vertices")
        try:
            face += [(corner[a], corner[b], corner[c]) for a, b, c in triangulated(points[corner])]
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
    return points, np.array(face, dtype=np.int64).reshape(-1, 3)


def _index(corner: str, before: int) -> int:
    """Return the vertex, from 0, of a corner such as 7, 7/1, 7//2 or -1, which counts back from the last one."""
    value = int(corner.partition("/")[0])
    if value == 0 or value < -before:
        raise ValueError(f"corner {value}, but vertices are counted from 1, or back from -1 to -{before}")
    return value - 1 if value > 0 else before + value


def triangulated(corner: Floats) -> list[tuple[int, int, int]]:
    """Return the triangles of a polygon of (n, 3) corners, as indices of corners, n - 2 of them.

    A fan where it is convex, else ears, cut one by one in the plane of its area's normal (Newell). Raises ValueError
    where its edges cross.
    """
    count = len(corner)
    fan = [(0, i, i + 1) for i in range(1, count - 1)]
    if count == 3:
        return fan
    centred = corner - corner.mean(axis=0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    # Seen along the axis of the largest component, counterclockwise.
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(centred, axis, axis=1)
    if (normal[axis] < 0) != (axis == 1):
        flat = flat[:, ::-1]

    def turn(a: int, b: int, c: int) -> float:
        one, two = flat[b] - flat[a], flat[c] - flat[b]
        return float(one[0] * two[1] - one[1] * two[0])

    least = -1e-12 * float(np.abs(normal).max())
    if all(turn(*one) >= least for one in fan):
        return fan
    edge = [(i, (i + 1) % count) for i in range(count)]
    for (a, b), (c, d) in combinations(edge, 2):
        if turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0:
            raise ValueError(f"the edges of a face of {count} corners cross each other")
    left, out = list(range(count)), list[tuple[int, int, int]]()
    while len(left) > 3:
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            inside = (turn(a, b, p) > 0 and turn(b, c, p) > 0 and turn(c, a, p) > 0 for p in left if p not in (a, b, c))
            if turn(a, b, c) > 0 and not any(inside):
                out.append((a, b, c))
                del left[i]
                break
        else:
            raise ValueError(f"the edges of a face of {count} corners cross each other")
    return [*out, (left[0], left[1], left[2])]


def _stl(data: bytes) -> tuple[Floats, Ints]:
    """Return the vertices (V, 3) and triangles (F, 3) of an STL. Raises ValueError."""
    count = int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else 0
    if len(data) >= HEADER and len(data) == HEADER + RECORD * count:
        record = np.frombuffer(data, dtype=np.uint8, offset=HEADER).reshape(-1, RECORD)
        corner = record[:, 12:48].copy().view("<f4").astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        corner = _ascii_stl(data.decode("latin-1"))
    elif len(data) < HEADER:
        raise ValueError(f"{len(data)} bytes, neither an ASCII nor a binary STL")
    else:
        raise ValueError(
            f"not an ASCII STL, and as a binary one its header says {count} triangles, which take "
            f"{HEADER + RECORD * count} bytes; the file has {len(data)}"
        )
    point, index = np.unique(corner, axis=0, return_inverse=True)
    return point, index.reshape(-1, 3)


def _ascii_stl(text: str) -> Floats:
    """Return the corners (3 F, 3) of an ASCII STL."""
    corner: list[list[float]] = []
    begun, ended, facets = 0, 0, 0
    for number, line in enumerate(text.split("\n"), 1):
        word = line.lower().split()
        if not word:
            continue
        try:
            if word[0] == "vertex":
                x, y, z = (float(value) for value in word[1:])
                corner.append([x, y, z])
            elif word[0] == "facet":
                facets += 1
            elif word[0] == "endloop" and len(corner) != 3 * facets:
                raise ValueError("a facet has three vertices")
            elif word[0] in ("solid", "endsolid"):
                begun, ended = begun + (word[0] == "solid"), ended + (word[0] == "endsolid")
            elif word[0] not in ("outer", "endloop", "endfacet"):
                raise ValueError("this is no keyword of STL")
        except ValueError as error:
            raise ValueError(f"line {number}, {line.strip()[:60]!r}: {error}") from None
    if begun != ended or len(corner) != 3 * facets:
        raise ValueError(f"it breaks off after {facets} facets, without 'endsolid'")
    return np.array(corner, dtype=np.float64).reshape(-1, 3)
