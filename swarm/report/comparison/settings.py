"""The settings in which runs differ: dotted keys of their scenarios, with the values of each run.

A run's `scenario.toml` has every default, so a key that one run lacks belongs to a table that it does not have. Keys
without effect are left out: those of an empty swarm, and in a replay all but the navigation's. The number of physics
steps counts as a setting where a run has chosen it itself.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from swarm.report.subject import Subject
from swarm.results.inputs import FOLDER
from swarm.scenario.text import toml_value
from swarm.tables import counted

REPLAY = "swarm replay "
"""Beginning of the line in the head of a replay's scenario.toml that repeats it."""
REPLAYED = ("name", "seed", "navigation", "recording")
"""Tables and keys that mean something in a replay."""
STEPS = "physics.steps_per_period"
"""Key that a run finds a value for where it is not set; its summary has it."""
WORDS = "description"
"""Key that tells about a scenario and changes nothing."""
FEW = 3
"""So many keys of a table that only some runs have are a row each; more are one row."""
TOLD = 8
"""Characters of a file's digest, where files of one name differ."""


class Setting(NamedTuple):
    """A key of a scenario. values: its value in each run as TOML writes it, None where the run has no such key."""

    key: str
    values: tuple[str | None, ...]


def differing(subjects: Sequence[Subject]) -> list[Setting]:
    """Return the settings in which runs differ, in the order of the scenario files. Raises SwarmError as `Subject`."""
    flat = [_effective(subject) for subject in subjects]
    keys = dict.fromkeys(key for one in flat for key in one)
    rows = [Setting(key, tuple(one.get(key) for one in flat)) for key in keys]
    return [*(_by_name(row) for row in rows if len(set(row.values)) > 1), *_other_files(subjects)]


def gathered(settings: Sequence[Setting]) -> list[Setting]:
    """Return the settings with one row for a table that only some of the runs have, all of them the same: its keys."""
    tables: dict[str, list[Setting]] = {}
    for row in settings:
        if None in row.values and len(set(row.values)) == 2 and "." in row.key:
            tables.setdefault(row.key.partition(".")[0], []).append(row)
    out: dict[str, Setting] = {}
    for row in settings:
        table = row.key.partition(".")[0]
        if row not in (rows := tables.get(table, [])) or len(rows) <= FEW:
            out[row.key] = row
        else:
            counts = [
                sum(value is not None for value in values) for values in zip(*(r.values for r in rows), strict=True)
            ]
            out[f"{table}.*"] = Setting(f"{table}.*", tuple(counted(n, "key") if n else None for n in counts))
    return list(out.values())


def is_replay(subject: Subject) -> bool:
    """Tell whether a run replays a recording of real light."""
    return bool(_replays(subject))


def _replays(subject: Subject) -> list[str]:
    head = [line.removeprefix("# ") for line in (subject.run.scenario or "").splitlines() if line.startswith("# ")]
    return [line for line in head if line.startswith(REPLAY)]


def _effective(subject: Subject) -> dict[str, str]:
    """Return the settings of a run that have an effect, by their dotted keys."""
    tables, replays = {key: value for key, value in subject.scenario.items() if key != WORDS}, _replays(subject)
    if replays:
        tables = {key: tables[key] for key in REPLAYED if key in tables}
    swarm = tables.get("swarm")
    if isinstance(swarm, dict) and swarm.get("count") == 0:
        tables["swarm"] = {"count": 0}
    out = {key: _told(value, subject.run.folder) for key, value in _flat("", tables)}
    physics = subject.summary.get("physics", {})
    if physics.get("chosen") and "steps_per_period" in physics:
        out[STEPS] = f"{physics['steps_per_period']} (chosen)"
    return out | ({"replay": replays[0].removeprefix(REPLAY)} if replays else {})


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys below a table or a list of tables, and their values; an empty list of tables has none."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}".removeprefix("."), inner)
    elif isinstance(value, list) and all(isinstance(entry, Mapping) for entry in value):
        for i, entry in enumerate(value):
            yield from _flat(f"{name}[{i}]", entry)
    else:
        yield name, value


def _told(value: Any, folder: Path) -> str:
    """Return a value as TOML writes it; a file of the run's own folder by its name and, after a zero, its digest."""
    if not isinstance(value, str) or not value.startswith(f"{FOLDER}/"):
        return toml_value(value)
    file, name = folder / value, value.removeprefix(f"{FOLDER}/")
    return f"{name}\0{_digest(file)}" if file.is_file() else name


def _by_name(row: Setting) -> Setting:
    """Return a setting whose files are told by their names alone, or with their digests where the names are one."""
    names = tuple(value and value.partition("\0")[0] for value in row.values)
    if len(set(names)) == len(set(row.values)):
        return Setting(row.key, names)
    return Setting(row.key, tuple(v and re.sub("\0(.*)", r" (\1)", v) for v in row.values))


def _other_files(subjects: Sequence[Subject]) -> Iterator[Setting]:
    """Yield the files that runs have under one name but with other contents, such as the meshes of a model."""
    named = {text for subject in subjects for _, text in _flat("", subject.scenario) if isinstance(text, str)}
    files = [_files(subject.run.folder) for subject in subjects]
    for name in sorted({name for one in files for name in one} - named):
        values = tuple(one.get(name) for one in files)
        if len(set(values) - {None}) > 1:
            yield Setting(name, values)


def _files(folder: Path) -> dict[str, str]:
    found = (file for file in (folder / FOLDER).rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): _digest(file) for file in found}


def _digest(file: Path) -> str:
    return sha256(file.read_bytes()).hexdigest()[:TOLD]
