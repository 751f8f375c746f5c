"""The files that an experiment leaves, and the table *paper beside ours* at the terminal.

    data.parquet       what the figure shows, a row per point, units in the column names and as metadata
    figure.png, .svg   the figure
    comparison.json    every line of the comparison, with seed, sizes, versions

Where the sample is smaller than the full experiment's, all of them and the terminal say so.
Nothing is written before the experiment is done. `comparison.json` is the folder's marker.
"""

import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from swarm.figures import save
from swarm.results.owned_folder import Contents, OwnedFolder
from swarm.results.parquet import write_table
from swarm.studies.papers.catalogue import Experiment
from swarm.studies.papers.experiment import Limits, Line, Outcome, Request, Value
from swarm.tables import table
from swarm.version import VERSION

DATA, COMPARISON, PNG, SVG = "data.parquet", "comparison.json", "figure.png", "figure.svg"
CONTENTS = Contents("an experiment", COMPARISON, (DATA, PNG, SVG))
VERSIONS = ("mujoco", "numpy", "scipy", "numba", "filterpy")


@dataclass(frozen=True)
class Reproduction:
    """An experiment's results on disk."""

    folder: Path
    experiment: Experiment
    outcome: Outcome
    sample: str = "full"

    def __repr__(self) -> str:
        """Say in one line which experiment this is."""
        return f"<Experiment {self.folder}: {self.experiment.source}, {self.experiment.figure}>"


def write(
    folder: Path, name: str, experiment: Experiment, request: Request, outcome: Outcome, force: bool = False
) -> Reproduction:
    """Write all files.

    Args:
        folder: Where to write.
        name: Name of the experiment.
        experiment: Its entry.
        request: The seed and the sizes that it ran with.
        outcome: What it found.
        force: Replace an earlier experiment.

    Raises:
        SwarmError: There is an earlier experiment, or the folder cannot be written.
    """
    sample, table_ = experiment.sample(request.sizes), outcome.data
    if sample != "full":
        outcome.figure.supxlabel(_smaller(sample), size=7, color="#555555")
        table_ = table_.replace_schema_metadata({**(table_.schema.metadata or {}), "sample": sample})
    with OwnedFolder(folder, CONTENTS, force=force) as owned:
        owned.replace(DATA, lambda file: write_table(table_, file))
        for file in (PNG, SVG):
            owned.replace(file, lambda temporary: save(outcome.figure, temporary, salt=name))
        body = {
            "version": VERSION,
            "experiment": name,
            "source": experiment.source,
            "figure": experiment.figure,
            "seed": request.seed,
            "sizes": dict(request.sizes),
            "sample": sample,
            "versions": {"python": platform.python_version(), **{package: version(package) for package in VERSIONS}},
            "comparison": [{**line._asdict(), "met": line.met} for line in outcome.comparison],
            "tables": [{**grid._asdict(), "rows": dict(grid.rows)} for grid in outcome.grids],
            "notes": outcome.notes,
        }
        owned.finish(_without_nan(body))
    return Reproduction(folder, experiment, outcome, sample)


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
    if done.sample != "full":
        console.print(Text(f"\n{_smaller(done.sample)}", "yellow"))
    for note in done.outcome.notes:
        console.print(f"\n{note}", highlight=False, markup=False)
    console.print(f"\n{done.folder}/", highlight=False, markup=False, soft_wrap=True)
    for file, meaning in ((DATA, "what the figure shows"), (PNG, "the figure; also .svg"), (COMPARISON, "this table")):
        console.print(Text.assemble(f"  {file:<16}", (meaning, "dim")))


def _smaller(sample: str) -> str:
    return f"Smaller sample: {sample}. The targets are those of the full experiment."


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
