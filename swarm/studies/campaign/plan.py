"""From a study to its runs: every point of the grid, every random sample, every seed, each a validated scenario.

A random value depends on the study's sampling seed, its key and the number of the sample alone: more samples, or more
keys, leave the earlier ones where they were.
"""

import json
from collections.abc import Iterator, Mapping
from copy import deepcopy
from hashlib import sha256
from itertools import product
from math import exp, log
from pathlib import Path
from typing import Any, NamedTuple

from swarm import random
from swarm.assets import find_scenario
from swarm.errors import SwarmError
from swarm.random import Purpose
from swarm.results.owned_folder import RUNS
from swarm.scenario import Scenario, validate
from swarm.scenario.load import Override, parse_override, read_toml, safe_name, shown
from swarm.studies.campaign.study import Range, Study


class PlannedRun(NamedTuple):
    """One run of a study. key: names its settings for good. scenario: None where they are wrong; `problem` says why."""

    number: int
    key: str
    parameters: Mapping[str, Any]
    seed: int
    scenario: Scenario | None
    problem: str


def plan(study: Study) -> list[PlannedRun]:
    """Return every run of the study, in the order of the grid, then samples, then seeds.

    Raises SwarmError where not one of them can fly: then the study itself is wrong.
    """
    path = find_scenario(study.base)
    data = {"name": safe_name(path.stem), **read_toml(path)}
    always = [parse_override(text)._replace(source=_source(study, "overrides")) for text in study.overrides]
    runs: list[PlannedRun] = []
    for parameters in _points(study):
        tables = ((key, value, "grid" if key in study.grid else "random") for key, value in parameters.items())
        changes = [*always, *(Override(key, value, _source(study, table)) for key, value, table in tables)]
        scenario, problem = None, ""
        try:
            scenario = validate(deepcopy(data), changes, file=shown(path), folder=path.parent)
        except SwarmError as error:
            problem = str(error)
        for seed in _seeds(study, scenario):
            flown = None if scenario is None else scenario.model_copy(update={"seed": seed})
            settings = [dict(parameters), problem, seed] if flown is None else flown.model_dump(mode="json")
            text = json.dumps([settings, study.measure, study.telemetry], sort_keys=True, default=str)
            key = sha256(text.encode()).hexdigest()[:16]
            runs.append(PlannedRun(len(runs), key, parameters, seed, flown, problem))
    if all(run.scenario is None for run in runs):
        raise SwarmError(runs[0].problem)
    return runs


def _source(study: Study, table: str) -> str:
    return f"study {study.name}, {table}"


def _seeds(study: Study, scenario: Scenario | None) -> range | tuple[int, ...]:
    if not isinstance(study.seeds, int):
        return study.seeds
    first = 0 if scenario is None else scenario.seed
    return range(first, first + study.seeds)


def _points(study: Study) -> Iterator[dict[str, Any]]:
    for values in product(*study.grid.values()):
        point = dict(zip(study.grid, values, strict=True))
        for sample in range(max(study.samples, 1)):
            drawn = {key: _draw(study.sampling_seed, key, sample, limits) for key, limits in study.random.items()}
            yield {**point, **drawn}


def _draw(seed: int, key: str, sample: int, limits: Range) -> float | int:
    share = random.stream(seed, Purpose.SAMPLE, random.key(key), sample).random()
    # A whole number owns the half unit on either side of it.
    half = 0.5 if limits.integer else 0.0
    low, high = limits.low - half, limits.high + half
    value = exp(log(low) + share * (log(high) - log(low))) if limits.log else low + share * (high - low)
    value = min(max(value, limits.low), limits.high)
    return round(value) if limits.integer else float(value)


def default_folder(study: Study) -> Path:
    """Return the folder of a study that is not told another one."""
    return RUNS / str(study.name)
