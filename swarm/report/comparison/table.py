"""The comparison of runs at a terminal: one table, the settings in which they differ above, the figures below.

Where the runs do not fit the terminal, the table goes on below with the first run and the next ones.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm.report.comparison.comparison import Comparison
from swarm.report.comparison.measures import NOTHING, Measure
from swarm.report.comparison.settings import Setting, gathered
from swarm.tables import GAP, counted, table

MOST_SETTINGS = 24
"""Settings that the table has unless all are asked for."""
NAME_WIDTH, LEAST_NAME = 36, 25
"""Most characters of a key or a figure's name on a line, and the fewest for which runs go to the next part."""

LEAST_VALUE = 10
"""Characters of a setting's value that its column has at least."""
DIGITS = 6
"""Digits of a number in a setting, unless two runs differ in a later one."""


class Layout(NamedTuple):
    """The widths of a part of the table. runs: indices of its runs. values: of each run's column; ratios: likewise."""

    runs: Sequence[int]
    name: int
    values: Sequence[int]
    ratios: Sequence[int]


def print_comparison(console: Console, comparison: Comparison, all_settings: bool = False) -> None:
    """Print the comparison.

    Args:
        console: Where to print.
        comparison: The runs.
        all_settings: Print every setting in which they differ, however many there are.
    """
    for label, subject in zip(comparison.labels, comparison.subjects, strict=True):
        scenario = subject.scenario
        told = [str(scenario.get("name", "?")), f"seed {scenario.get('seed', '?')}", str(subject.run.status)]
        line = Text.assemble((f"{label}  ", "bold"), str(subject.run.folder), (f"  {', '.join(told)}", "dim"))
        console.print(line, soft_wrap=True)
    console.print()
    found = comparison.settings if all_settings else gathered(comparison.settings)
    settings = found if all_settings else found[:MOST_SETTINGS]
    rest = list(range(1, len(comparison.subjects)))
    while rest:
        layout = _layout(comparison, settings, rest, console.width)
        console.print(_table(comparison, settings, layout))
        console.print()
        rest = rest[len(layout.runs) - 1 :]
    if not comparison.settings:
        console.print("The scenarios are the same, value by value.")
    if len(settings) < len(found) or found != comparison.settings:
        console.print(f"{counted(len(comparison.settings), 'setting')} differ: --all shows each.")
    for note in comparison.notes:
        console.print(Text(note))


def _layout(comparison: Comparison, settings: Sequence[Setting], rest: Sequence[int], width: int) -> Layout:
    """Return the next part of the table: the first run, and as many of the `rest` as fit beside it, at least one."""
    measures = comparison.measures
    names = max(map(len, [*(row.key for row in settings), *map(_name, measures)]), default=1)
    count = len(rest)
    while True:
        runs = [0, *rest[:count]]
        values = [max((len(row.text(run)) for row in measures), default=1) for run in runs]
        ratios = [max((len(row.ratio_text(run)) for row in measures), default=3) for run in runs[1:]]
        wanted = [max((len(_value(row, run)) for row in settings), default=0) for run in runs]
        values = [max(value, min(want, LEAST_VALUE)) for value, want in zip(values, wanted, strict=True)]
        room = width - sum(GAP + each for each in (*values, *ratios))
        if count == 1 or room >= min(names, LEAST_NAME):
            break
        count -= 1
    name = max(min(names, NAME_WIDTH, room), LEAST_NAME // 2)
    spare = max(room - name, 0)
    for left, i in enumerate(sorted(range(len(runs)), key=wanted.__getitem__)):
        more = min(max(wanted[i] - values[i], 0), spare // (len(runs) - left))
        values[i], spare = values[i] + more, spare - more
    return Layout(runs, min(names, name + spare), values, ratios)


def _table(comparison: Comparison, settings: Sequence[Setting], layout: Layout) -> Table:
    """Return a part of the table, without the rows in which its runs have nothing, or do not differ."""
    labels, runs = comparison.labels, layout.runs
    made = table("", tight=True)
    made.columns[0].overflow, made.columns[0].width = "fold", layout.name
    for i, run in enumerate(runs):
        made.add_column(labels[run], justify="right", overflow="fold", width=layout.values[i])
        if i:
            made.add_column(f"{labels[run]}/A", justify="right", no_wrap=True, width=layout.ratios[i - 1])
    differing = [row for row in settings if len({row.values[run] for run in runs}) > 1]
    for row in differing:
        cells = [_value(row, run) for run in runs]
        made.add_row(Text(_folded(row.key, layout.name)), *(Text(cell) for cell in _beside(cells, [""] * len(cells))))
    measures = [row for row in comparison.measures if any(row.values[run] is not None for run in runs)]
    if differing and measures:
        made.add_section()
    for measure in measures:
        cells = _beside([measure.text(run) for run in runs], [measure.ratio_text(run) for run in runs])
        made.add_row(Text(_name(measure)), *(Text(cell) for cell in cells))
    return made


def _folded(key: str, width: int) -> str:
    """Return a key on lines of at most `width` characters, which end where one of its words does, if they can."""
    lines: list[str] = []
    while len(key) > width:
        cut = 1 + max(key.rfind(sign, 0, width) for sign in "._") or width
        lines, key = [*lines, key[:cut]], key[cut:]
    return "\n".join([*lines, key])


def _beside(values: Sequence[str], ratios: Sequence[str]) -> list[str]:
    """Return the cells of a row: the value of each run and, but for the first, its ratio."""
    return [values[0], *(cell for pair in zip(values[1:], ratios[1:], strict=True) for cell in pair)]


def _name(measure: Measure) -> str:
    return f"{measure.name}, {measure.unit}" if measure.unit else measure.name


def _value(row: Setting, run: int) -> str:
    shown = [_short(value) for value in row.values]
    value = shown[run] if len(set(shown)) == len(set(row.values)) else row.values[run]
    return NOTHING if value is None else value.strip('"') or '""'


def _short(value: str | None) -> str | None:
    """Return a setting's value with few digits, if it is a number of many."""
    try:
        return value if value is None or len(value) <= DIGITS + 2 else f"{float(value):.{DIGITS}g}"
    except ValueError:
        return value
