"""A folder to start from, for `swarm new`: a scenario with own craft models, and a README of what to change.

Without another scenario it is made of `scenarios/new/`. From a scenario, its text stays as it is, comments too, but
for the models of its craft and its calibration, which are copied beside it. The folder appears whole or not at all.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from swarm.assets import find_model, find_scenario, folder
from swarm.errors import SwarmError
from swarm.plugin_files import PLUG_INS, of_file
from swarm.results.disk import writing
from swarm.scenario import load
from swarm.scenario.load import read_toml, safe_name, shown
from swarm.scenario.text import toml_value
from swarm.user_text import read_text, user_path
from swarm.world.model_copy import Copies

NAME = "NAME"
"""Placeholder of the name in the files of `scenarios/new/`."""
MODELS = PurePosixPath("models")
"""Folder of the craft models that come from another scenario."""
USUAL_MODEL = "mockup"
Files = dict[PurePosixPath, bytes]


def start(target: str | Path, source: str | Path | None = None) -> Path:
    """Write a folder to start from, and return its scenario file.

    Args:
        target: The folder, which must not exist, or be empty; its last part is the scenario's name.
        source: A scenario to start from, a name or a path.

    Raises:
        SwarmError: The folder is taken, its name cannot be a scenario's, or `source` cannot be read.
    """
    place = user_path(target)
    name = place.name
    if not name:
        raise SwarmError("the new folder has no name: its last part names the scenario, as in `swarm new probe`")
    if safe_name(name) != name:
        hint = f", such as {safe_name(name)!r}" if name.strip(".") else ""
        raise SwarmError(f"{str(target)!r} cannot be the name of a scenario: letters, digits, '-', '_' and '.'{hint}")
    if os.path.lexists(place) and not (place.is_dir() and not place.is_symlink() and not any(place.iterdir())):
        raise SwarmError(f"{place} is there already, and nothing is overwritten; choose another name")
    files = _usual(name) if source is None else _of_scenario(name, source)
    _write(place, files)
    scenario = place / f"{name}.toml"
    load(scenario)
    return scenario


def _usual(name: str) -> Files:
    """Return the files without another scenario."""
    source = folder("scenarios") / "new"
    text = {file.name: read_text(file, str(file)).replace(NAME, name) for file in source.iterdir() if file.is_file()}
    scenario = text.pop("scenario.toml")
    seed = int(re.findall(r"^seed = (\d+)", scenario, re.MULTILINE)[0])
    text["README.md"] = _readme(name, seed, [PurePosixPath("craft.xml")])
    return {PurePosixPath(file): content.encode() for file, content in {**text, f"{name}.toml": scenario}.items()}


def _of_scenario(name: str, source: str | Path) -> Files:
    """Return the files that start from a scenario."""
    path = find_scenario(source)
    settings = load(path)  # a scenario with a mistake is told before anything is written
    text, data, copies = read_text(path, shown(path)), read_toml(path), Copies()
    tables = [("[swarm]", 0, data["swarm"])] if settings.swarm.count else []
    tables += [("[[craft]]", i, table) for i, table in enumerate(data.get("craft", ()))]
    for head, number, table in tables:
        said = table.get("model")
        copy = MODELS / copies.add_model(find_model(said or USUAL_MODEL, path.parent))
        text = _replaced(text, "model", said, str(copy)) if said else _inserted(text, head, number, str(copy))
    files = {MODELS / file: content for file, content in copies.files.items()}
    plug_ins = Copies()
    for table in [data.get("swarm", {}), *data.get("craft", ())]:
        for key in PLUG_INS:
            if (said := table.get(key)) and (named := of_file(said)) is not None:
                copy = plug_ins.add(path.parent / user_path(named[0]))
                text = _replaced(text, key, said, f"{copy}:{named[1]}")
    files |= plug_ins.files
    if said := data.get("navigation", {}).get("calibration"):
        calibration = Copies()
        text = _replaced(text, "calibration", said, str(calibration.add(path.parent / user_path(said))))
        files |= calibration.files
    if "name" in data:
        text = re.sub(r"^name *=.*$", f"name = {toml_value(name)}", text, count=1, flags=re.MULTILINE)
    models = [MODELS / file for file in copies.files if file.suffix == ".xml"]
    readme = _readme(name, settings.seed, models)
    return {**files, PurePosixPath("README.md"): readme.encode(), PurePosixPath(f"{name}.toml"): text.encode()}


def _replaced(text: str, key: str, said: str, new: str) -> str:
    """Return the text with another value of a key, wherever it has the old one."""
    return re.sub(rf'(\b{key} *= *)(["\']){re.escape(said)}\2', lambda found: found[1] + toml_value(new), text)


def _inserted(text: str, head: str, number: int, model: str) -> str:
    """Return the text with a model below the n-th head of a table, counted from 0."""
    heads = list(re.finditer(rf"^{re.escape(head)}.*$", text, re.MULTILINE))
    if number >= len(heads):
        return text  # a table on one line keeps its usual model
    end = heads[number].end()
    return f"{text[:end]}\nmodel = {toml_value(model)}{text[end:]}"


def _readme(name: str, seed: int, models: list[PurePosixPath]) -> str:
    """Return the README of a folder with these craft models."""
    file = folder("scenarios") / "new" / "README.md"
    first = str(models[0]) if models else "MODEL.xml"
    values: Mapping[str, Any] = {
        "FILES": "\n".join(
            f"| `{model}` | a craft, as MJCF | fly another shape, other photodiodes |" for model in models
        ),
        "CRAFT": ", ".join(f"`{model}`" for model in models) or "The craft come from the scenario",
        "MODEL": first,
        "SEED": seed,
        NAME: name,
    }
    text = read_text(file, str(file))
    for placeholder, value in values.items():
        text = re.sub(rf"\b{placeholder}\b", str(value), text)
    return text


def _write(place: Path, files: Files) -> None:
    with writing(place):
        place.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{place.name}-", dir=place.parent))
        try:
            scratch.chmod(0o755)
            for name, content in files.items():
                (scratch / name).parent.mkdir(parents=True, exist_ok=True)
                (scratch / name).write_bytes(content)
            scratch.replace(place)
        except BaseException:
            shutil.rmtree(scratch, ignore_errors=True)
            raise
