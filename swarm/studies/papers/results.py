"""The files that an experiment leaves, and the table *paper beside ours* at the terminal.

    data.parquet       what the figure shows, a row per point, units in the column names and as metadata
    figure.png, .svg   the figure
    comparison.json    every line of the comparison, with seed, sizes, versions

Nothing is written before the experiment is done; `comparison.json` comes last, and is the licence to replace the others
under --force.
"""

import json
import math
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from rich.console import Console
from rich.text import Text

from swarm import __version__
from swarm.errors import SwarmError
from swarm.figures import save
from swarm.results.disk import write_text, writing
from swarm.results.run_folder import PROGRAM
from swarm.studies.papers.experiment import Experiment, Limits, Line, Outcome, Value
from swarm.tables import table

DATA, COMPARISON, PNG, SVG = "data.parquet", "comparison.json", "figure.png", "figure.svg"
VERSIONS = ("mujoco", "numpy", "scipy", "numba", "filterpy")


@dataclass(frozen=True)
class Reproduction:
    """An experiment's results on disk."""

    folder: Path
    experiment: Experiment
    outcome: Outcome


class ResultFolder:
    """The folder that an experiment's results go to."""

    def __init__(self, path: Path, force: bool = False) -> None:
        """Check that `path` is free, or holds an earlier experiment that `force` replaces. Raises SwarmError."""
        self.path = path
        if path.exists() and not path.is_dir():
            raise SwarmError(f"cannot write {path}: a file is in its place; choose another --out")
        ours = _is_ours(path / COMPARISON)
        if ours and not force:
            raise SwarmError(
                f"{path} holds an experiment already; --force (force=True) replaces it, --out (out=...) writes "
                "elsewhere"
            )
        for name in () if ours else (DATA, COMPARISON, PNG, SVG):
            if (path / name).exists():
                raise SwarmError(
                    f"{path / name} was not written by {PROGRAM}, and an experiment would replace it; move it away or "
                    "choose another --out"
                )

    def write(
        self, name: str, experiment: Experiment, seed: int, sizes: Mapping[str, int], outcome: Outcome
    ) -> Reproduction:
        """Write all files.

        Args:
            name: Name of the experiment.
            experiment: Its entry.
            seed: Seed that it ran with.
            sizes: Sizes that it ran with, by name.
            outcome: What it found.

        Raises:
            SwarmError: The folder cannot be written.
        """
        with writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
            (self.path / COMPARISON).unlink(missing_ok=True)
            _replace(self.path / DATA, lambda file: pq.write_table(outcome.data, file))
            for file in (PNG, SVG):
                _replace(self.path / file, lambda temporary: save(outcome.figure, temporary, salt=name))
        body = {
            "program": PROGRAM,
            "version": __version__,
            "experiment": name,
            "source": experiment.source,
            "figure": experiment.figure,
            "seed": seed,
            "sizes": dict(sizes),
            "versions": {"python": platform.python_version(), **{package: version(package) for package in VERSIONS}},
            "comparison": [{**line._asdict(), "met": line.met} for line in outcome.comparison],
            "tables": [{**grid._asdict(), "rows": dict(grid.rows)} for grid in outcome.grids],
            "notes": outcome.notes,
        }
        write_text(self.path / COMPARISON, json.dumps(_without_nan(body), indent=2, allow_nan=False) + "\n")
        return Reproduction(self.path, experiment, outcome)


def print_comparison(console: Console, done: Reproduction) -> None:
    """Print the grids, the table *paper beside ours*, the notes, and where the files are."""
    console.print(Text(f"{done.experiment.source}, {done.experiment.figure}: {done.experiment.about}", "bold"))
    for grid in done.outcome.grids:
        console.print()
        printed = table(grid.title, *grid.columns)
        for name, values in grid.rows:
            printed.add_row(name, *map(_text, values))
        console.print(printed)
    console.print()
    _print_lines(console, done.outcome.comparison)
    for note in done.outcome.notes:
        console.print(f"\n{note}", highlight=False, markup=False)
    console.print(f"\n{done.folder}/", highlight=False, markup=False, soft_wrap=True)
    for file, meaning in ((DATA, "what the figure shows"), (PNG, "the figure; also .svg"), (COMPARISON, "this table")):
        console.print(Text.assemble(f"  {file:<16}", (meaning, "dim")))


def _print_lines(console: Console, lines: list[Line]) -> None:
    judged = any(line.target is not None for line in lines)
    printed = table("", "paper", "ours", *(("target",) if judged else ()))
    if judged:
        printed.add_column("")
    group = ""
    for line in lines:
        if line.group != group:
            group = line.group
            printed.add_section()
            printed.add_row(Text(group, "bold"))
        quantity = f"{line.quantity}, {line.unit}" if line.unit else line.quantity
        mark = {True: Text("met", "green"), False: Text("missed", "bold red"), None: Text()}[line.met]
        verdict = (_target(line.target), mark) if judged else ()
        printed.add_row(quantity, _text(line.paper), _text(line.ours), *verdict)
    console.print(printed)


def _is_ours(file: Path) -> bool:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("program") == PROGRAM and "experiment" in content


def _replace(file: Path, write: Callable[[Path], Any]) -> None:
    """Write `file` under another name first: a kill leaves the old one or the new one."""
    temporary = file.with_name(file.name + ".tmp")
    try:
        write(temporary)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)


def _without_nan(value: Any) -> Any:
    """Return `value` with null where a number is missing: JSON knows no NaN."""
    if isinstance(value, Mapping):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: Value) -> str:
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    return " to ".join(map(_number, value)) if isinstance(value, tuple) else _number(value)


def _number(value: float) -> str:
    """Return three significant digits, without an exponent where people would write none."""
    if not math.isfinite(value):
        return "–"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    decimals = 0 if value == 0 else min(max(2 - math.floor(math.log10(abs(value))), 0), 6)
    return f"{value:.{decimals}f}"


def _target(target: Limits | None) -> str:
    low, high = target or (None, None)
    if low is None:
        return "" if high is None else f"≤ {high:g}"
    return f"≥ {low:g}" if high is None else f"{low:g} to {high:g}"
