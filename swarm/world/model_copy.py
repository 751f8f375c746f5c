"""A craft's or a lighthouse's model file, copied with all that it names, so that the copies need nothing else.

An MJCF may include parts and name meshes, textures and further models anywhere on the disk. Its copy has the parts in
it, and names the copies of the other files by paths that begin at its own folder: `inputs/` here.

    inputs/servicer.xml     <mesh file="hull.obj"/>, in place of meshdir="/home/me/cad" and <mesh file="v3/hull.obj"/>
    inputs/hull.obj

A file that several models name is copied once. A model without such names is copied byte by byte.
"""

import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from swarm.assets import MESHES
from swarm.errors import SwarmError

FILE_KEYS = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
"""Attributes of MJCF that name a file; a texture has one per face of its cube."""
FOLDER_KEYS = ("assetdir", "meshdir", "texturedir", "strippath")
"""Attributes of <compiler> that say where named files are."""


class Copies:
    """Copies of model files and of all that they name, not written yet.

    files: their contents by their path, which begins at the folder of them all.
    """

    def __init__(self) -> None:
        """Begin without a file."""
        self.files: dict[PurePosixPath, bytes] = {}
        self._of: dict[Path, PurePosixPath] = {}

    def add(self, path: Path) -> PurePosixPath:
        """Copy any file that names no other one, and return the copy's path. Raises SwarmError if it is unreadable."""
        path = path.resolve()
        if path not in self._of:
            self._of[path] = self._place(path.name, _read(path))
        return self._of[path]

    def add_model(self, path: Path) -> PurePosixPath:
        """Copy a model with all that it names, and return the copy's path. Raises SwarmError if one is unreadable."""
        path = path.resolve()
        if path.suffix.lower() in MESHES:
            return self.add(path)
        if path not in self._of:
            data = _read(path)
            try:
                root = _parsed(data)
            except ElementTree.ParseError as error:
                raise SwarmError(f"{path} cannot be copied: {error}") from None
            folders = _expand(root, path)
            named = list(_named(root, path, folders))
            if folders is None and not named:
                self._of[path] = self._place(path.name, data)
            else:
                self._of[path] = self._place_model(path, root, named)
        return self._of[path]

    def _place_model(self, path: Path, root: Element, named: list[tuple[Element, str, Path]]) -> PurePosixPath:
        targets = [
            (element, key, self.add_model(file) if element.tag == "model" else self.add(file))
            for element, key, file in named
        ]
        # The names in the copy depend on its own folder, which depends on what is there already.
        for number in range(1, len(self.files) + 2):
            place = _numbered(path.name, number)
            for element, key, target in targets:
                element.set(key, os.path.relpath(target, place.parent).replace(os.sep, "/"))
            data = ElementTree.tostring(root, encoding="utf-8")
            if self.files.setdefault(place, data) == data:
                break
        return place

    def _place(self, name: str, data: bytes) -> PurePosixPath:
        """Return the place of a file: by its own name, in a numbered folder where another file has that name."""
        places = (_numbered(name, number) for number in range(1, len(self.files) + 2))
        return next(place for place in places if self.files.setdefault(place, data) == data)


def _numbered(name: str, number: int) -> PurePosixPath:
    return PurePosixPath(name) if number == 1 else PurePosixPath(str(number), name)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SwarmError(f"{path} cannot be read: {error.strerror}") from None


def _parsed(data: bytes) -> Element:
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    return ElementTree.fromstring(data, parser)


def _expand(root: Element, path: Path) -> dict[str, str] | None:
    """Replace every <include> by what it includes, and take the folders of named files out of <compiler>.

    Returns:
        The folders by their attribute, or None where the file has no include and no such attribute.
    """
    changed = _include(root, path.parent, path.parent)
    folders: dict[str, str] = {}
    for compiler in root.iter("compiler"):
        if "assetdir" in compiler.attrib:
            folders |= dict.fromkeys(("meshdir", "texturedir"), compiler.attrib["assetdir"])
        folders |= {key: compiler.attrib[key] for key in FOLDER_KEYS if key in compiler.attrib}
        for key in FOLDER_KEYS:
            changed = compiler.attrib.pop(key, None) is not None or changed
    return folders if changed else None


def _include(parent: Element, main: Path, here: Path) -> bool:
    """Replace the includes below an element; files are looked for in the main file's folder, then in the part's own."""
    found = False
    for i, child in reversed(list(enumerate(parent))):
        if child.tag != "include":
            found = _include(child, main, here) or found
            continue
        name = child.get("file", "")
        file = next((place / name for place in (main, here) if (place / name).is_file()), main / name)
        part = _parsed(_read(file))
        _include(part, main, file.parent)
        parent[i : i + 1] = list(part)
        found = True
    return found


def _named(root: Element, path: Path, folders: dict[str, str] | None) -> Iterator[tuple[Element, str, Path]]:
    """Yield every element that names a file that is there, with the attribute and the file."""
    folders = folders or {}
    for element in root.iter():
        for key in FILE_KEYS:
            if key not in element.attrib:
                continue
            name = Path(element.attrib[key])
            if folders.get("strippath") == "true":
                name = Path(name.name)
            inside = (
                ""
                if element.tag == "model"
                else folders.get("texturedir" if element.tag == "texture" else "meshdir", "")
            )
            for place in (path.parent / inside, path.parent):
                if (place / name).is_file():
                    yield element, key, place / name
                    break
