"""Load a scenario: from a file or a shipped name, and `--set key=value`, to validated tables with absolute paths.

All mistakes are reported together, in one `SwarmError`: one line each with file, key, value and limit.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from swarm.assets import find_model, find_scenario, lighthouses, models
from swarm.errors import SwarmError, surely_meant
from swarm.plugin_files import PLUG_INS
from swarm.scenario import mistakes
from swarm.scenario.cameras import Ccd
from swarm.scenario.fleet import SingleCraft, Swarm
from swarm.scenario.lidar import Lidar
from swarm.scenario.mistakes import Problem, dotted, parse_path
from swarm.scenario.schema import Scenario
from swarm.scenario.table import Table
from swarm.scenario.text import toml_value
from swarm.user_text import NotToml, check_text, parse_toml, read_text, short, user_path

OWN_NAVIGATOR = ("swarm", "navigator")


@dataclass(frozen=True)
class Craft:
    """One craft of a scenario: its table, and its model's file.

    index, count: its place among the craft that share its table.
    """

    name: str
    model: Path
    table: Swarm | SingleCraft
    index: int = 0
    count: int = 1

    @property
    def ccd(self) -> Ccd | None:
        """The table of its cameras."""
        return self.table.ccd if isinstance(self.table, SingleCraft) else None

    @property
    def lidar(self) -> Lidar | None:
        """The table of its LiDAR."""
        return self.table.lidar if isinstance(self.table, SingleCraft) else None


class Override(NamedTuple):
    """One changed value.

    key: dotted. value: as TOML gives it. source, text: for messages, where and how the change was given.
    """

    key: str
    value: Any
    source: str = "--set"
    text: str = ""


Overrides = Iterable[str | Override] | Mapping[str, Any]
"""Changed values: "key=value" each, `Override`s, or a mapping from dotted keys to values."""


def load(name_or_path: str | Path, overrides: Overrides = (), seed: int | None = None) -> Scenario:
    """Load and validate a scenario.

    Args:
        name_or_path: The name of a shipped scenario, or the path of a TOML file.
        overrides: "key=value" with a dotted key and a value as TOML writes it, quotes around plain words left out:
            "swarm.count=16", "craft[1].motion.from_m=[0, 0, 8]"; or `Override` records; or a mapping, such as
            {"swarm.count": 16}.
        seed: Replaces the seed of the file.

    Raises:
        SwarmError: The file cannot be read, or a value is wrong.
    """
    path = find_scenario(str(name_or_path))
    data = {"name": safe_name(path.stem), **read_toml(path)}
    if "base" in data and not {"swarm", "craft"} & data.keys():
        raise SwarmError(f"{shown(path)} is no scenario, but a study: swarm study {shown(path)}")
    return validate(data, overrides, seed, file=shown(path), folder=path.parent)


def validate(
    data: dict[str, Any], overrides: Overrides = (), seed: int | None = None, *, file: str, folder: Path
) -> Scenario:
    """Validate a scenario.

    Args:
        data: The tables, as TOML gives them; changed by the overrides.
        overrides: As in `load`.
        seed: Replaces the seed of the data.
        file: The name of the data in messages.
        folder: The folder that relative paths begin at.

    Raises:
        SwarmError: A value is wrong.
    """
    sources: dict[mistakes.Path, str] = {}
    for said in parsed(overrides):
        sources[_put(data, said)] = said.source
    if seed is not None:
        data["seed"] = seed
        sources[("seed",)] = "--seed"
    problems = [*_resolve_paths(data, folder, sources), *_without_effect(data, sources)]
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        problems += mistakes.problems_of(error, data, kinds_set=[key[:-1] for key in sources if key[-1] == "kind"])
    if problems:
        raise SwarmError(mistakes.report(problems, data, sources, file))
    return scenario


def checked(scenario: Scenario | str | Path) -> Scenario:
    """Return a scenario that can be flown, of one that Python code may have changed, or of a name or a file.

    Raises SwarmError where a value is wrong, as `load` does: pydantic's `model_copy(update=...)` takes anything.
    """
    if not isinstance(scenario, Scenario):
        return load(scenario)
    return validate(_data(scenario), file="the scenario", folder=Path.cwd())


def _data(table: Any) -> Any:
    """Return a table as TOML would give it, whatever its attributes hold: with the keys that somebody has set, so that
    what is found where nothing is set is still found.
    """
    if isinstance(table, Table):
        told = table.model_fields_set
        return {key: _data(value) for key, value in vars(table).items() if key in told and value is not None}
    return [_data(entry) for entry in table] if isinstance(table, list | tuple) else table


def for_replay(recording: Path, overrides: Iterable[str] = (), seed: int | None = None) -> Scenario:
    """Return the settings of a replay, of which only name, seed, [navigation] and [recording] mean something.

    Args:
        recording: The file that is replayed.
        overrides: As in `load`.
        seed: As in `load`.

    Raises:
        SwarmError: A value is wrong, or a replay would ignore the key.
    """
    overrides = list(overrides)
    for override in overrides:
        path = parse_path(override.partition("=")[0].strip())
        if path[:1] not in (("navigation",), ("recording",), ("name",), ("description",)) and path != OWN_NAVIGATOR:
            taken = "navigation.*, recording.*, swarm.navigator, name and description"
            raise SwarmError(f"--set: {override}: a replay takes only {taken}")
    name = safe_name(recording.name.partition(".")[0])
    data = {
        "name": name,
        "description": f"Replay of {recording.name}"[:200],
        "swarm": {"count": 1},
        # The light is the recording's own: it has no noise of a scenario beside it.
        "lighthouse": {"angle_noise_arcsec": 0.0},
        # What a factory calibration leaves of a real station's errors, photodiodes do not share: half of the variance.
        # The noise itself is found in the recording.
        "navigation": {"rotor_correlation": 0.5},
    }
    return validate(data, overrides, seed, file=shown(recording), folder=Path.cwd())


def parsed(overrides: Overrides) -> Iterator[Override]:
    """Yield each changed value. Raises SwarmError where the changes are neither a list nor a mapping."""
    if isinstance(overrides, str):
        key, _, value = overrides.partition("=")
        example = f"{{{key.strip()!r}: {value.strip() or '...'}}}"
        raise SwarmError(f"overrides: {short(overrides)!r} is one string: give a list, [{overrides!r}], or {example}")
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            yield Override(str(key), _plain(value), "overrides")
        return
    for override in overrides:
        yield parse_override(override) if isinstance(override, str) else override


def _plain(value: Any) -> Any:
    """Return a value that Python code gives as TOML would give it: tables, lists, and paths as text."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value


def parse_override(text: str) -> Override:
    """Parse "key=value". Raises SwarmError where the text is not of this form."""
    check_text(text, "--set")
    key, equals, value = text.partition("=")
    if not equals or not parse_path(key.strip()):
        raise SwarmError(f"--set: {text!r} is not key=value, such as swarm.count=16")
    return Override(key.strip(), _value(text, value.strip()), text=text)


def craft(scenario: Scenario) -> list[Craft]:
    """Return every craft, those of the swarm first."""
    tables, names, count = scenario.tables, scenario.craft_names, scenario.swarm.count
    model = find_model(scenario.swarm.model, Path()) if count else Path()
    return [
        Craft(name, model, table, i, count) if i < count else Craft(name, find_model(table.model, Path()), table)
        for i, (name, (_, table)) in enumerate(zip(names, tables, strict=True))
    ]


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises SwarmError, with the place in the file, where it cannot be read or is not TOML."""
    where = shown(path)
    return parse_toml(read_text(path, where, "a scenario file"), where)


def _put(data: dict[str, Any], override: Override) -> mistakes.Path:
    """Put the override into `data`, and return its path."""
    path = parse_path(override.key)
    if not path:
        raise SwarmError(f"{override.source}: {override.key!r} is not a key, such as swarm.count")
    said = f"{override.source}: {override.text or f'{override.key}={short(toml_value(override.value))}'}"
    inner: Any = data
    for depth, part in enumerate(path):
        last = depth == len(path) - 1
        so_far = dotted(path[: depth + 1])
        if isinstance(part, int):
            if not isinstance(inner, list) or part >= len(inner):
                entries = f"has {len(inner)} entries, counted from 0" if isinstance(inner, list) else "is not a list"
                raise SwarmError(f"{said}: {so_far} does not exist: {dotted(path[:depth])} {entries}")
        elif not isinstance(inner, dict):
            index = f"; say which, as in {_by_number(inner, path, depth)}" if isinstance(inner, list) else ""
            raise SwarmError(f"{said}: {dotted(path[:depth])} is not a table{index}")
        if last:
            inner[part] = override.value
        else:
            # Copies on the way down: a default table of the schema or of the caller is never written to.
            below = inner.get(part, {}) if isinstance(inner, dict) else inner[part]
            inner[part] = below = below.copy() if isinstance(below, dict | list) else below
            inner = below
    return path


def _by_number(entries: list[Any], path: mistakes.Path, depth: int) -> str:
    """Return the key `path` with the number of the list's entry that `path[depth]` names, else of the first one."""
    named = [i for i, entry in enumerate(entries) if isinstance(entry, dict) and entry.get("name") == path[depth]]
    return dotted((*path[:depth], named[0] if named else 0, *path[depth + bool(named) :]))


def _value(override: str, text: str) -> Any:
    """Return the value of an override, which TOML gives or which is a word without quotes."""
    said = f"--set: {short(override)}"
    try:
        data = parse_toml(f"value = {text}", said)
    except NotToml:
        if text and text[0] not in "\"'[{" and not re.search(r"[\x00-\x1f]", text):
            return text
        raise SwarmError(f"{said}: the value is not TOML: write a number, true, a word or a list") from None
    if list(data) != ["value"]:
        # A line break ends the value, and what follows would be another key.
        raise SwarmError(f"{said!r}: one --set changes one key; give each its own --set")
    return data["value"]


def _without_effect(data: dict[str, Any], sources: Iterable[mistakes.Path]) -> Iterator[Problem]:
    """Refuse changes of [swarm] in a scenario whose swarm is empty: they would silently change nothing."""
    swarm, single = data.get("swarm", {}), data.get("craft")
    count = swarm.get("count", Swarm().count) if isinstance(swarm, dict) else None
    if count != 0 or not single or not isinstance(single, list):
        return
    for path in sources:
        if path[0] != "swarm" or path == ("swarm", "count") or (len(path) == 1 and set(swarm) <= {"count"}):
            continue
        own = path[1:] if path[1:2] and path[1] in SingleCraft.model_fields else ("model",)
        others = "" if len(single) == 1 else ", and so on," if len(single) > 2 else f" and craft[1].{own[0]}"
        said = f"change {dotted(('craft', 0, *own))}{others} instead, or swarm.count"
        yield Problem(2, (path,), f"has no effect, because swarm.count = 0; {said}")


def _resolve_paths(data: dict[str, Any], folder: Path, sources: Mapping[mistakes.Path, str]) -> Iterator[Problem]:
    """Make the paths of files in `data` absolute, so that a copy of the scenario elsewhere means the same.

    They begin at the scenario's folder; those given with `--set` begin at the working directory.
    """
    single = data.get("craft")
    indices = range(len(single)) if isinstance(single, list) else ()
    for path in (("swarm", "model"), *(("craft", i, "model") for i in indices), ("lighthouse", "model")):
        table = mistakes.value_at(data, path[:-1])
        value = table.get("model") if isinstance(table, dict) else None
        if isinstance(value, str) and value not in (lighthouses() if path[0] == "lighthouse" else models()):
            try:
                found = find_model(value, Path.cwd() if path in sources else folder)
            except SwarmError as error:
                yield Problem(2, (path,), str(error))
            else:
                table["model"] = str(found.resolve())
    yield from _resolve_plug_ins(data, folder, sources)
    path, table = ("navigation", "calibration"), data.get("navigation")
    value = table.get("calibration") if isinstance(table, dict) else None
    if isinstance(table, dict) and isinstance(value, str):
        try:
            file = user_path((Path.cwd() if path in sources else folder) / user_path(value)).resolve()
        except SwarmError as error:
            yield Problem(2, (path,), str(error))
            return
        if file.is_file():
            data["navigation"] = {**table, "calibration": str(file)}
        else:
            yield Problem(2, (path,), f"there is no file {file}")


def _resolve_plug_ins(data: dict[str, Any], folder: Path, sources: Mapping[mistakes.Path, str]) -> Iterator[Problem]:
    """Make the paths of plug-ins absolute, as those of other files; the names of entry points stay as they are."""
    single = data.get("craft")
    indices = range(len(single)) if isinstance(single, list) else ()
    places: list[mistakes.Path] = [("swarm",), *(("craft", i) for i in indices)]
    for place, key in itertools.product(places, PLUG_INS):
        path, table = (*place, key), mistakes.value_at(data, place)
        value = table.get(key) if isinstance(table, dict) else None
        if not isinstance(table, dict) or not isinstance(value, str):
            continue
        file, colon, name = value.rpartition(":")
        if not colon and "/" not in value and not value.endswith(".py"):
            continue
        if not colon or not name.isidentifier():
            example = f"{file or value}:{key.title()}"
            yield Problem(2, (path,), f"which class of the file? FILE.py:CLASS, such as {example}")
            continue
        try:
            found = user_path((Path.cwd() if path in sources else folder) / user_path(file)).resolve()
        except SwarmError as error:
            yield Problem(2, (path,), str(error))
            continue
        if not found.is_file():
            near = surely_meant(found.name, [other.name for other in found.parent.glob("*.py")])
            yield Problem(2, (path,), f"there is no file {found}{near}")
            continue
        table[key] = f"{found}:{name}"


def safe_name(stem: str) -> str:
    """Turn a file's name into the name of a run: characters that no folder may have become hyphens."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", stem).lstrip("_.-")[:64] or "scenario"


def shown(path: Path) -> str:
    """Return the path as its user would type it: relative where it lies below the working directory."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)
