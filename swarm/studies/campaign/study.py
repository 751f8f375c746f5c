"""The study file: which scenario to fly how often, with which keys changed. TOML, validated as a scenario is.

    base = "formation"                      # a scenario's name, or a path that begins at the study's folder
    seeds = 4                               # the scenario's seed and the three after it; or a list of seeds
    overrides = ["duration_s=10"]           # for every run, as `--set` takes them
    samples = 20                            # random points, each flown at every point of the grid
    [grid]
    swarm.count = [4, 8, 16]
    [random]
    lighthouse.angle_noise_arcsec = { low = 2.0, high = 30.0, log = true }

A run is one point of the grid, one random sample and one seed.
"""

import operator
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, Strict, ValidationError

from swarm.assets import find_scenario, find_study, scenarios
from swarm.errors import SwarmError
from swarm.scenario import mistakes
from swarm.scenario.load import parse_override, read_toml, safe_name, shown
from swarm.scenario.mistakes import parse_path
from swarm.scenario.stations import NAME_PATTERN
from swarm.scenario.table import Mistake, Table
from swarm.scenario.text import toml_value
from swarm.user_text import dotted_keys, user_path

Seed = Annotated[int, Field(ge=0, lt=10**18)]
Measure = Literal["onboard", "central", "first_craft", "bound"]
MOST_RUNS = 1_000_000


class Range(Table):
    """The range of a key's random values."""

    low: float = Field(description="The least value.")
    high: float = Field(description="The largest value.")
    log: bool = Field(default=False, description="Uniform in the logarithm.")
    integer: bool = Field(default=False, description="Whole numbers, both ends among them.")

    def between_keys(self) -> Iterator[Mistake]:
        """Check that the range is not empty, and that its logarithm exists."""
        if self.low >= self.high:
            yield f"low ({self.low:g}) must be below high ({self.high:g})", "low", "high"
        if self.log and self.low <= 0:
            yield "must be above 0 where log = true", "low", "log"


class Study(Table):
    """Many runs of one scenario."""

    name: str | None = Field(
        default=None,
        pattern=NAME_PATTERN,
        max_length=64,
        description="Names the study's folder. Unset: the file's name.",
    )
    description: str = Field(default="", max_length=200, description="One line; `swarm list` shows it.")
    base: str = Field(description="The scenario: a name that `swarm list` shows, or a path relative to this file.")
    seeds: Annotated[int, Field(ge=1, le=MOST_RUNS)] | Annotated[tuple[Seed, ...], Strict(False)] = Field(
        default=1, description="How many seeds, from the scenario's own upwards; or a list of seeds."
    )
    samples: int = Field(default=0, ge=0, le=MOST_RUNS, description="How many random points of the keys in [random].")
    sampling_seed: int = Field(default=0, ge=0, lt=10**18, description="What the random points follow from.")
    overrides: Annotated[tuple[str, ...], Strict(False)] = Field(
        default=(), description='Changes for every run, "key=value" each, as `--set` takes them.'
    )
    telemetry: bool = Field(default=False, description="Keep every run's telemetry.")
    measure: Annotated[tuple[Measure, ...], Strict(False)] = Field(
        default=(), description="What else to measure: `onboard`, `central`, `first_craft`, `bound`."
    )
    workers: int | None = Field(
        default=None, ge=1, le=10000, description="Runs at a time on this machine. Unset: one per core."
    )
    grid: dict[str, Annotated[tuple[Any, ...], Strict(False), Field(min_length=1)]] = Field(
        default={}, description="Scenario keys, each with a list of values: every combination is flown."
    )
    random: dict[str, Range] = Field(default={}, description="Scenario keys, each with the range of its random values.")

    def between_keys(self) -> Iterator[Mistake]:
        """Check that random keys come with samples, no key is set twice, and the study is not absurdly large."""
        if self.random and not self.samples:
            yield "must be at least 1: [random] has keys", "samples"
        if self.samples and not self.random:
            yield f"has nothing to draw: samples = {self.samples}, but [random] has no key", "samples"
        if self.seeds == ():
            yield "must not be empty", "seeds"
        for key in self.random:
            if key in self.grid:
                yield f"{key} is in [grid] too", "random", "grid"
        count = max(self.samples, 1) * (self.seeds if isinstance(self.seeds, int) else len(self.seeds))
        for values in self.grid.values():
            count *= len(values)
        if count > MOST_RUNS:
            yield f"makes {count} runs; at most {MOST_RUNS}", "grid"


def load_study(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    *,
    craft: Sequence[int] = (),
    seeds: int | None = None,
    workers: int | None = None,
) -> Study:
    """Return the study of a file, or a shipped one by its name. Its `base` is a name or an absolute path.

    Args:
        name_or_path: Name or file of the study.
        overrides: More overrides, "key=value" each.
        craft: Numbers of craft; they replace the grid of swarm.count.
        seeds: Number of seeds; replaces the file's.
        workers: Number of workers; replaces the file's.

    Raises:
        SwarmError: Something is wrong; the message names file, key and value.
    """
    path = find_study(name_or_path)
    data = read_toml(path)
    if "base" not in data and {"swarm", "craft"} & data.keys():
        name = shown(path)
        raise SwarmError(
            f'{name} is no study, but a scenario: swarm run {name}; a study names it, base = "{path.name}", and says '
            "what differs between its runs"
        )
    for table, is_leaf in (("grid", operator.not_), ("random", _is_range)):
        if isinstance(data.get(table), dict):
            data[table] = dict(dotted_keys(data[table], is_leaf))
    sources: dict[mistakes.Path, str] = {}
    # A wrong type is for the schema to say, below.
    if craft and isinstance(data.setdefault("grid", {}), dict):
        data["grid"]["swarm.count"] = list(craft)
        sources[("grid", "swarm.count")] = "--craft"
    for key, value in (("seeds", seeds), ("workers", workers)):
        if value is not None:
            data[key] = value
            sources[(key,)] = f"--{key}"
    if isinstance(overrides, str):
        raise SwarmError(f"overrides: {overrides!r} is one string: give a list, [{overrides!r}]")
    for override in overrides:
        parse_override(override)
    if isinstance(data.get("overrides", []), list):
        data["overrides"] = [*data.get("overrides", []), *overrides]
    problems = list(_keys(data))
    try:
        study = Study.model_validate({"name": safe_name(path.stem), **data})
    except ValidationError as error:
        problems += mistakes.problems_of(error, data, Study)
    if problems:
        raise SwarmError(mistakes.report(problems, data, sources, shown(path)))
    return study.model_copy(update={"base": _base(study.base, path)})


def study_toml(study: Study, comments: Sequence[str] = ()) -> str:
    """Return the study as TOML text that `load_study` reads back to an equal one. comments: lines for its head."""
    lines = [f"# {line}" for line in comments]
    for key in Study.model_fields:
        value = getattr(study, key)
        if value is not None and key not in ("grid", "random"):
            lines.append(f"{key} = {toml_value(value)}")
    for table in ("grid", "random"):
        if entries := getattr(study, table):
            lines += ["", f"[{table}]"]
            for key, value in entries.items():
                lines.append(f"{toml_value(key)} = {toml_value(value.model_dump() if table == 'random' else value)}")
    return "\n".join(lines) + "\n"


def _base(base: str, file: Path) -> str:
    """Return `base` as it can be found from anywhere."""
    if base in scenarios():
        return base
    try:
        beside = user_path(file.parent / user_path(base))
        return str(find_scenario(beside if beside.is_file() else base))
    except SwarmError as error:
        raise SwarmError(f"{shown(file)}: base = {toml_value(base)}: {error}") from None


def _keys(data: dict[str, Any]) -> Iterator[mistakes.Problem]:
    for table in ("grid", "random"):
        for key in data[table] if isinstance(data.get(table), dict) else ():
            if not parse_path(key):
                yield mistakes.Problem(0, ((table, key),), "is not a scenario's key, such as swarm.count")
            elif key == "seed":
                yield mistakes.Problem(0, ((table, key),), "the seeds are listed in `seeds`")


def _is_range(table: dict[str, Any]) -> bool:
    return not table or not all(isinstance(value, dict) for value in table.values())
