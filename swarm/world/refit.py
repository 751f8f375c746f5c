"""A craft's MJCF with its photodiodes replaced: all else stays as in the file.

The sites whose name starts with `photodiode` are removed; new ones, numbered from 0, are added to the root body, in its
frame, with the appearance of the first of the old ones. Included files are written out; comments inside the file are
lost. Meshes and textures stay where they are: the new file names their folder relative to its own.
"""

import os
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from swarm.errors import SwarmError
from swarm.world.craft import quiet
from swarm.world.hull import Mount
from swarm.world.model_file import open_model

PREFIX = "photodiode"
LOOKS = {"type": "cylinder", "size": "0.0015 0.0004", "rgba": "0.75 0.1 0.15 1"}
"""Appearance of a photodiode on a craft that had none."""
LOOK_KEYS = ("class", "type", "size", "material", "group", "rgba", "user")
FOLDERS = {"meshdir": ("meshes", "hfields", "skins"), "texturedir": ("textures",)}
"""The compiler's folders, and the kinds of assets in each."""


def refit(path: Path, mount: Mount, target: Path, about: str) -> str:
    """Return the MJCF text of a craft with other photodiodes.

    Args:
        path: model file of the craft.
        mount: poses of the photodiodes.
        target: file to which the text will be written; it is not written here.
        about: line for the head of the file.

    Raises:
        SwarmError: MuJoCo does not compile `path`.
    """
    try:
        with quiet():
            spec = open_model(path)
            spec.compile()
            root = ElementTree.fromstring(spec.to_xml())
    except ValueError as error:
        raise SwarmError(f"{path} does not compile: {' '.join(str(error).split())}") from None
    looks = _remove_photodiodes(root)
    body = root.find("worldbody/body")
    assert body is not None
    for number, (point, normal) in enumerate(zip(mount.point_m, mount.normal, strict=True)):
        place = {"pos": _numbers(point), "zaxis": _numbers(normal)}
        body.append(ElementTree.Element("site", {"name": f"{PREFIX}{number}", **looks, **place}))
    _point_to_assets(root, spec, path, target)
    ElementTree.indent(root)
    root.insert(0, ElementTree.Comment(f" {about.replace('--', '- -')} "))
    root[0].tail = root.text
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _remove_photodiodes(root: ElementTree.Element) -> dict[str, str]:
    """Remove the photodiodes, and return the appearance of the first one on the root body."""
    looks: dict[str, str] | None = None
    body = root.find("worldbody/body")
    for parent in root.iter():
        for site in parent.findall("site"):
            if site.get("name", "").startswith(PREFIX):
                parent.remove(site)
                own = {key: site.attrib[key] for key in LOOK_KEYS if key in site.attrib}
                # Defaults that a part of the craft sets for its own sites do not apply on the root body.
                if looks is None and (parent is body or "class" in own or "type" in own):
                    looks = own
    return LOOKS if looks is None else looks


def _point_to_assets(root: ElementTree.Element, spec: mujoco.MjSpec, path: Path, target: Path) -> None:
    compiler = root.find("compiler")
    assert compiler is not None
    for folder, kinds in FOLDERS.items():
        if any(getattr(item, "file", "") for kind in kinds for item in getattr(spec, kind)):
            there = path.resolve().parent / getattr(spec, folder)
            compiler.set(folder, Path(os.path.relpath(there, target.resolve().parent)).as_posix())


def _numbers(vector: object) -> str:
    return " ".join(f"{value:.6g}" for value in vector)  # type: ignore[attr-defined]
