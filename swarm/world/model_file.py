"""The model file of a craft, opened: an MJCF or a bare mesh, or else a sentence on what the file is instead."""

import tomllib
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from swarm.errors import SwarmError
from swarm.world.mesh_file import SUFFIXES, mesh_spec

CRAFT = "a craft is MJCF, an OBJ or an STL"
URDF = (
    'to convert it, write <mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco> below <robot>, read it '
    "with mujoco.MjSpec.from_file, compile, save to_xml(), and add the photodiodes (swarm docs models)"
)
ROOTS = {
    "robot": f"a URDF, a craft is MJCF: {URDF}",
    "sdf": "an SDF, a craft is MJCF: to convert it, use sdf2mjcf of gz-mujoco, and add the photodiodes",
    "mujocoinclude": "a part that an MJCF includes, not one of its own: its root element must be <mujoco>",
}
"""Root elements of XML files that are no MJCF."""
OTHER_FORMATS = {
    ".mjb": "a compiled MuJoCo model: save its MJCF with mujoco.mj_saveLastXML",
    ".msh": "MuJoCo's own mesh format: export an OBJ or an STL",
    **dict.fromkeys(
        (".ply", ".dae", ".gltf", ".glb", ".fbx", ".3ds", ".off", ".blend", ".step", ".stp", ".iges", ".igs", ".usd"),
        "a format that is not read: export an OBJ or an STL, in metres",
    ),
}


def open_model(path: Path) -> mujoco.MjSpec:
    """Return the model of a file, not compiled yet.

    Raises:
        SwarmError: the file is no MJCF and no mesh; the message says what it is, where that can be told.
        ValueError: MuJoCo refuses the file.
    """
    if path.suffix.lower() in SUFFIXES:
        return mesh_spec(path)
    _check_kind(path)
    return mujoco.MjSpec.from_file(str(path))


def check_one_body(spec: mujoco.MjSpec, path: Path) -> None:
    """Check that a model has exactly one root body.

    Raises:
        SwarmError: it has none, or several; with their names.
    """
    roots = spec.worldbody.bodies
    if len(roots) == 1:
        return
    names = ", ".join(repr(body.name) for body in roots) or "none"
    advice = "a craft is one rigid body: give each its own file" if roots else "put the craft's geoms into a <body>"
    raise SwarmError(f"{path}: exactly one root body is needed, found {len(roots)} ({names}); {advice}")


def _check_kind(path: Path) -> None:
    """Raise SwarmError for a file that is not an MJCF; an XML file that is damaged later on is MuJoCo's to refuse."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SwarmError(f"model file {path} cannot be read: {error.strerror}") from None
    if not data.strip(b" \t\r\n\0"):
        raise SwarmError(f"{path} is empty; {CRAFT}")
    suffix = path.suffix.lower()
    if suffix in OTHER_FORMATS:
        raise SwarmError(f"{path} is {OTHER_FORMATS[suffix]}; {CRAFT}")
    root, problem = _root(data)
    if root == "mujoco":
        return
    if root is None:
        what = f"no XML: {problem}" if data.lstrip()[:1] == b"<" else _text_kind(data)
        raise SwarmError(f"{path} is {what}; {CRAFT}")
    name = root.rpartition("}")[2].lower()
    raise SwarmError(f"{path} is " + ROOTS.get(name, f"XML, but no MJCF: its root element is <{name}>; {CRAFT}"))


def _root(data: bytes) -> tuple[str | None, str]:
    """Return the name of an XML file's root element, or None and what is wrong before it."""
    try:
        for _, element in ElementTree.iterparse(BytesIO(data), events=("start",)):
            return str(element.tag), ""
    except ElementTree.ParseError as error:
        return None, str(error)
    return None, "no element found"


def _text_kind(data: bytes) -> str:
    try:
        table = tomllib.loads(data.decode())
    except (ValueError, RecursionError):
        return "neither XML nor a mesh"
    return f"TOML{', a scenario or a study' if 'craft' in table or 'swarm' in table else ''}, not a craft's model"
