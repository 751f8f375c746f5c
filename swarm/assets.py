"""Lookup of models/ and scenarios/: beside the package in a checkout, inside it once installed.

    models/lighthouse/lighthouse.xml          a lighthouse
    models/craft/<name>/<name>.xml            a craft
    scenarios/<name>.toml                     a scenario
    scenarios/studies/<name>.toml             a study: many runs of a scenario
    scenarios/recordings/<name>.rec.gz        a recording to replay, with the station's calibration in <name>.json

A user names one of these, or gives the path of a file.
"""

from pathlib import Path

from swarm.errors import SwarmError, did_you_mean
from swarm.user_text import short, user_path

PACKAGE = Path(__file__).resolve().parent


def folder(name: str) -> Path:
    """Return the folder `models` or `scenarios`. Raises SwarmError where the installation lacks it."""
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


def find_model(name_or_path: str | Path, relative_to: Path | None = None) -> Path:
    """Return the MJCF file of a craft or a lighthouse, given by a known name, a path to an .xml file, or its folder.

    A relative path starts at `relative_to` (the folder of the scenario that names it), or else at the working
    directory. Raises SwarmError with the nearest known name, or with the file that the folder lacks.
    """
    known = lighthouses() | models()
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
    raise SwarmError(f"no model {short(text)!r}{did_you_mean(text, known)}; or give the path of an .xml file")


def find_scenario(name_or_path: str | Path) -> Path:
    """Return the TOML file of a scenario, a known name or a path. Raises SwarmError with the nearest known name."""
    return _find_toml("scenario", str(name_or_path), scenarios())


def find_study(name_or_path: str | Path) -> Path:
    """Return the TOML file of a study, a known name or a path. Raises SwarmError with the nearest known name."""
    return _find_toml("study", str(name_or_path), studies())


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
        raise SwarmError(f"no recording {text!r}{did_you_mean(text, known)}; or give the path of a file")
    return path


def _find_toml(what: str, text: str, known: dict[str, Path]) -> Path:
    if text in known:
        return known[text]
    path = user_path(text)
    if path.is_file():
        return path.resolve()
    if path.exists():
        raise SwarmError(f"{path} is not a scenario file{' but a folder' if path.is_dir() else ''}")
    if _is_path(text, ".toml"):
        raise SwarmError(f"{what} file {path} does not exist{did_you_mean(path.stem, known)}")
    raise SwarmError(f"no {what} {short(text)!r}{did_you_mean(text, known)}; or give the path of a .toml file")


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
