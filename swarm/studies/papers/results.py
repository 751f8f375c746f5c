"""What an experiment leaves: its data, a figure drawn like the paper's, and the comparison *paper beside ours*.

    data.parquet       what the figure shows, a row per point, units in the column names and as metadata
    figure.png, .svg   the figure
    comparison.json    every line of the comparison, with seed, sizes, versions

Nothing is written before the experiment is done; `comparison.json` comes last, and is the licence to replace the others
under --force.
"""

import json
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm import __version__
from swarm.errors import SwarmError
from swarm.figures import Figure, save
from swarm.results.disk import write_text, writing
from swarm.results.run_folder import PROGRAM
from swarm.studies.papers import Experiment

DATA, COMPARISON, PNG, SVG = "data.parquet", "comparison.json", "figure.png", "figure.svg"
VERSIONS = ("mujoco", "numpy", "scipy", "numba", "filterpy")

Value = float | tuple[float, float] | str | None
"""One figure, the smallest and the largest of several, words, or nothing."""


class Line(NamedTuple):
    """One line of the comparison.

    target: what ours must lie in, both ends (None: open); None: only to be looked at. group: a heading that it shares.
    """

    quantity: str
    unit: str
    paper: Value
    ours: Value
    target: tuple[float | None, float | None] | None = None
    group: str = ""

    @property
    def met(self) -> bool | None:
        """Whether all of ours lies in the target; None without a target."""
        if self.target is None:
            return None
        low, high = self.target
        ours = self.ours if isinstance(self.ours, tuple) else (self.ours,)
        return all(
            isinstance(value, int | float)
            and math.isfinite(value)
            and (low is None or value >= low)
            and (high is None or value <= high)
            for value in ours
        )


class Grid(NamedTuple):
    """A table of results beside the comparison: each row a name and a figure per column."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, tuple[Value, ...]]]


class Request(NamedTuple):
    """What an experiment is asked for. progress: to be told the share that is done, and what is being done."""

    seed: int
    sizes: Mapping[str, int]
    progress: Callable[[float, str], None]


class Outcome(NamedTuple):
    """What an experiment found. grids: printed above the comparison. notes: sentences below it."""

    comparison: list[Line]
    data: pa.Table
    figure: Figure
    notes: tuple[str, ...] = ()
    grids: tuple[Grid, ...] = ()


@dataclass(frozen=True)
class Reproduction:
    """An experiment's results on disk, and what was compared."""

    folder: Path
    experiment: Experiment
    outcome: Outcome


class ResultFolder:
    """Where an experiment's results go."""

    def __init__(self, path: Path, force: bool = False) -> None:
        """Look whether `path` is free, or holds an earlier experiment that `force` replaces. Raises SwarmError."""
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
        """Write everything. Raises SwarmError where it cannot be written."""
        with writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
            (self.path / COMPARISON).unlink(missing_ok=True)
            _replace(self.path / DATA, lambda file: pq.write_table(outcome.data, file))
            for file in (PNG, SVG):
                _replace(self.path / file, lambda temporary: save(outcome.figure, temporary, salt=name))
        head = {
            "program": PROGRAM,
            "version": __version__,
            "experiment": name,
            "source": experiment.source,
            "figure": experiment.figure,
            "seed": seed,
            "sizes": dict(sizes),
            "versions": {"python": platform.python_version(), **{package: version(package) for package in VERSIONS}},
        }
        lines = [{**line._asdict(), "met": line.met} for line in outcome.comparison]
        grids = [{**grid._asdict(), "rows": dict(grid.rows)} for grid in outcome.grids]
        body = {**head, "comparison": lines, "tables": grids, "notes": outcome.notes}
        write_text(self.path / COMPARISON, json.dumps(_without_nan(body), indent=2, allow_nan=False) + "\n")
        return Reproduction(self.path, experiment, outcome)


def print_comparison(console: Console, done: Reproduction) -> None:
    """Print the grids, the table *paper beside ours*, the notes, and where the files are."""
    console.print(Text(f"{done.experiment.source}, {done.experiment.figure}: {done.experiment.about}", "bold"))
    for grid in done.outcome.grids:
        console.print()
        console.print(_grid(grid))
    console.print()
    console.print(_comparison(done.outcome.comparison))
    for note in done.outcome.notes:
        console.print(f"\n{note}", highlight=False, markup=False)
    console.print(f"\n{done.folder}/", highlight=False, markup=False, soft_wrap=True)
    for file, meaning in ((DATA, "what the figure shows"), (PNG, "the figure; also .svg"), (COMPARISON, "this table")):
        console.print(Text.assemble(f"  {file:<16}", (meaning, "dim")))


def _grid(grid: Grid) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column(grid.title)
    for head in grid.columns:
        table.add_column(head, justify="right", no_wrap=True)
    for name, values in grid.rows:
        table.add_row(name, *map(_text, values))
    return table


def _comparison(lines: list[Line]) -> Table:
    judged = any(line.target is not None for line in lines)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("")
    for head in ("paper", "ours", *(("target",) if judged else ())):
        table.add_column(head, justify="right", no_wrap=True)
    if judged:
        table.add_column("")
    group = ""
    for line in lines:
        if line.group != group:
            group = line.group
            table.add_section()
            table.add_row(Text(group, "bold"))
        quantity = f"{line.quantity}, {line.unit}" if line.unit else line.quantity
        cells = [quantity, _text(line.paper), _text(line.ours)]
        if judged:
            mark = {True: Text("met", "green"), False: Text("missed", "bold red"), None: Text()}[line.met]
            table.add_row(*cells, _target(line.target), mark)
        else:
            table.add_row(*cells)
    return table


def column(name: str, values: Any, unit: str, meaning: str) -> tuple[pa.Field, pa.Array]:
    """A column of `data.parquet`; NaN becomes null."""
    array = pa.array(values, from_pandas=True)
    return pa.field(name, array.type, metadata={"unit": unit, "meaning": meaning}), array


def table_of(columns: list[tuple[pa.Field, pa.Array]]) -> pa.Table:
    """The table of these columns."""
    return pa.table([array for _, array in columns], schema=pa.schema([field for field, _ in columns]))


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
    """`value` with null where a number is missing: JSON knows no NaN."""
    if isinstance(value, Mapping):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _number(value: float) -> str:
    """Three significant digits, without an exponent where people would write none."""
    if not math.isfinite(value):
        return "–"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    decimals = 0 if value == 0 else min(max(2 - math.floor(math.log10(abs(value))), 0), 6)
    return f"{value:.{decimals}f}"


def _text(value: Value) -> str:
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    return " to ".join(map(_number, value)) if isinstance(value, tuple) else _number(value)


def _target(target: tuple[float | None, float | None] | None) -> str:
    match target:
        case None:
            return ""
        case None, high:
            return f"≤ {high:g}" if high is not None else ""
        case low, None:
            return f"≥ {low:g}"
        case low, high:
            return f"{low:g} to {high:g}"
