"""Lookup of models/, scenarios/ and docs/: beside the package in a checkout, inside it once installed.

    models/lighthouse/lighthouse.xml          a lighthouse
    models/craft/<name>/<name>.xml            a craft
    scenarios/<name>.toml                     a scenario
    scenarios/studies/<name>.toml             a study: many runs of a scenario
    scenarios/recordings/<name>.rec.gz        a recording to replay, with the station's calibration in <name>.json
    docs/<name>.md                            a page of the documentation

A user names one of these, or gives the path of a file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from swarm.errors import SwarmError, did_you_mean, question, surely_meant
from swarm.user_text import short, user_path

PACKAGE = Path(__file__).resolve().parent
MESHES = (".obj", ".stl")
"""Endings of mesh files, each of which is a craft by itself."""


def folder(name: str) -> Path:
    """Return the folder `models`, `scenarios` or `docs`. Raises SwarmError where the installation lacks it."""
    for place in (PACKAGE / name, PACKAGE.parent / name):
        if place.is_dir():
            return place
    raise SwarmError(f"the folder {name}/ is missing: not in {PACKAGE}, not in {PACKAGE.parent}; install again")


def models() -> dict[str, Path]:
    """Return the craft models that come with the package: name -> MJCF file."""
    return _models_in(folder("models") / "craft")


def lighthouses() -> dict[str, Path]:
    """Return the lighthouse models that come with the package: name -> MJCF file."""
    return _models_in(folder("models"))


def scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package: name -> TOML file."""
    return {path.stem: path for path in sorted(folder("scenarios").glob("*.toml"))}


def studies() -> dict[str, Path]:
    """Return the studies that come with the package: name -> TOML file."""
    return {path.stem: path for path in sorted((folder("scenarios") / "studies").glob("*.toml"))}


def recordings() -> dict[str, Path]:
    """Return the recordings that come with the package: name -> file, with the calibration <name>.json beside it."""
    files = sorted((folder("scenarios") / "recordings").glob("*.rec.gz"))
    return {path.name.partition(".")[0]: path for path in files}


class OwnRecording(NamedTuple):
    """A recording that comes with the package: its name, and the file of its station's calibration."""

    name: str
    calibration: Path


def own_recording(file: Path) -> OwnRecording | None:
    """Return which of the recordings that come with the package a file is, None if it is another one."""
    name = next((name for name, own in recordings().items() if own == file), None)
    return None if name is None else OwnRecording(name, file.with_name(f"{name}.json"))


def find_model(name_or_path: str | Path, relative_to: Path | None = None) -> Path:
    """Return the MJCF file of a craft or a lighthouse, given by a known name, a path to an .xml file, or its folder.

    A relative path starts at `relative_to` (the folder of the scenario that names it), or else at the working
    directory. Raises SwarmError with the nearest known name, or with the file that the folder lacks.
    """
    known = MODEL.known()
    text = str(name_or_path)
    if text in known:
        return known[text]
    path = user_path((relative_to or Path()) / user_path(text))
    if path.is_dir():
        return _model_of_folder(path)
    if path.is_file():
        return path.resolve()
    if _is_path(text, ".xml"):
        raise SwarmError(f"model file {path} does not exist")
    raise SwarmError(_no_such(MODEL, text, "an .xml file"))


def pages() -> dict[str, Path]:
    """Return the pages of the documentation: name -> Markdown file."""
    return {path.stem: path for path in sorted(folder("docs").glob("*.md"))}


class Kind(NamedTuple):
    """A kind of file that commands take. known: those that come along. use: how one is used, with `{}` for it."""

    what: str
    known: Callable[[], dict[str, Path]]
    use: str


SCENARIO = Kind("scenario", scenarios, "swarm run {}")
STUDY = Kind("study", studies, "swarm study {}")
CRAFT = Kind("craft model", models, 'a scenario names it, as in --set swarm.model="{}"')
RECORDING = Kind("recording", recordings, "swarm replay {}")
KINDS = (SCENARIO, STUDY, CRAFT, RECORDING)
MODEL = Kind("model", lambda: lighthouses() | models(), CRAFT.use)
"""What a scenario names as a model: the lighthouse's too."""


def another_kind(text: str, wanted: Kind) -> str:
    """Return a hint that ends a message, that `text` is the name of another kind of file, or an empty string."""
    for kind in KINDS:
        if kind is not wanted and text in kind.known():
            return f", but a {kind.what}: {kind.use.format(text)}"
    return ""


def file_of_another_kind(path: Path, wanted: Kind) -> str:
    """Return what a file is by its name, where that is not the wanted kind, and how it is used; or an empty string."""
    name = path.name.lower()
    if name.endswith((".xml", *MESHES)):
        kind = CRAFT
    elif name.endswith((".rec", ".rec.gz")):
        kind = RECORDING
    elif name.endswith(".rrd"):
        return f"the recording of a run: swarm view {path}"
    elif name.endswith((".parquet", ".json")):
        return f"a file of results: swarm report {path.parent}"
    else:
        return ""
    return "" if kind is wanted else f"a {kind.what}: {kind.use.format(path)}"


def find_scenario(name_or_path: str | Path) -> Path:
    """Return the TOML file of a scenario, a known name or a path. Raises SwarmError with the nearest known name."""
    return _find_toml(SCENARIO, str(name_or_path))


def find_study(name_or_path: str | Path) -> Path:
    """Return the TOML file of a study, a known name or a path. Raises SwarmError with the nearest known name."""
    return _find_toml(STUDY, str(name_or_path))


def find_recording(name_or_path: str | Path) -> Path:
    """Return the file of a recording, a known name or a path. Raises SwarmError with the nearest known name."""
    text, known = str(name_or_path), recordings()
    try:
        path = Path(text).expanduser()
        there = path.exists()
    except (OSError, ValueError, RuntimeError) as error:
        raise SwarmError(f"{text!r} is no path: {error}") from None
    if not there and text in known:
        return known[text]
    if not there and not path.suffix and path.name == text:
        raise SwarmError(_no_such(RECORDING, text, "a file"))
    if there and path.suffix == ".toml":
        raise SwarmError(f"{path} is no recording, but a .toml file: swarm run {path}")
    if there and (other := file_of_another_kind(path, RECORDING)):
        raise SwarmError(f"{path} is no recording, but {other}")
    return path


def _find_toml(kind: Kind, text: str) -> Path:
    known = kind.known()
    if text in known:
        return known[text]
    path = user_path(text)
    if path.is_file():
        if other := file_of_another_kind(path, kind):
            raise SwarmError(f"{path} is no {kind.what}, but {other}")
        return path.resolve()
    if path.is_dir():
        inside = path / f"{kind.what}.toml"
        hint = question(str(inside) if inside.is_file() else "")
        raise SwarmError(f"{path} is not a {kind.what} file but a folder{hint}")
    if path.exists():
        raise SwarmError(f"{path} is not a {kind.what} file")
    if _is_path(text, ".toml"):
        beside = [str(path.with_name(file.name)) for file in path.parent.glob("*.toml")]
        near = surely_meant(str(path), beside) or surely_meant(path.stem, known)
        raise SwarmError(f"{kind.what} file {path} does not exist{near}")
    raise SwarmError(_no_such(kind, text, "a .toml file"))


def _no_such(kind: Kind, text: str, file: str) -> str:
    """Return the message about a name that no file of this kind has."""
    hint = another_kind(text, kind)
    if not hint:
        near = did_you_mean(text, kind.known())
        hint = f"{near} Or give the path of {file}" if near.endswith("?") else f"{near}; or give the path of {file}"
    return f"no {kind.what} {short(text)!r}{hint}"


def _models_in(place: Path) -> dict[str, Path]:
    return {path.parent.name: path for path in sorted(place.glob("*/*.xml")) if path.stem == path.parent.name}


def _model_of_folder(path: Path) -> Path:
    files = sorted(path.glob("*.xml"))
    own = [file for file in files if file.stem == path.resolve().name]
    candidates = own or [file for file in files if file.stem != "scene"]
    if len(candidates) == 1:
        return candidates[0].resolve()
    found = ", ".join(file.name for file in files) or "no .xml file"
    raise SwarmError(f"{path}: expected the craft's model as {path.resolve().name}.xml, found {found}")


def _is_path(text: str, suffix: str) -> bool:
    return text.endswith(suffix) or "/" in text or "\\" in text
