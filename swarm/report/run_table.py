"""The summary of a run at a terminal: a table with a row per craft and one for the swarm, then sentences and files.

Columns are left out, the least important first, until the table fits the terminal, and a line names them; a figure that
nobody has (errors against the truth, in a replay) has no column. Errors are the filter's unless the head says PnP.
"""

import math
import shlex
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from swarm.report.findings import colour, names, of_summary, reasons
from swarm.report.measured import measured
from swarm.tables import table

Figures = Mapping[str, Any]
RECORDING = "recording.rrd"
MOST_ROWS = 16
"""Up to so many craft have a row each; of more, the worst ones are shown."""
WORST_ROWS = 8
ARCSEC_PER_RAD = math.degrees(1) * 3600
HEAD, NAME_WIDTH = "craft", 16
GAP = 2
"""Blanks between two columns."""
NOTHING = "–"


Value = Callable[[Figures], float | None]


class Column(NamedTuple):
    """One or two figures side by side. Columns of high `rank` are dropped first; `head` is two lines."""

    rank: int
    head: str
    values: tuple[Value, ...]
    between: str = " / "


def _figure(key: str, scale: float = 1.0, inside: str | None = None) -> Value:
    def value(figures: Figures) -> float | None:
        found = figures if inside is None else figures.get(inside) or {}
        number = found.get(key)
        return None if number is None else scale * number

    return value


def _error(source: str, what: str, scale: float = 1.0) -> tuple[Value, Value]:
    quantity, unit = what.split()
    return _figure(f"{source}_{quantity}_rms_{unit}", scale), _figure(f"{source}_{quantity}_max_{unit}", scale)


def _band(of: str) -> tuple[Value, Value]:
    return _figure("band_low", inside=of), _figure("band_high", inside=of)


def _scatter(key: str) -> tuple[Value, Value]:
    return _figure(f"ekf_{key}"), _figure(f"smooth_{key}")


TRACKING = Column(0, "tracking\n%", (_figure("tracking_share", 100),))
ADOP = Column(4, "ADOP\n°/rad", (_figure("mean_adop_deg_per_rad"),))
PDOP = Column(5, "PDOP\nm/rad", (_figure("mean_pdop_m_per_rad"),))
AT_NOISE = Column(6, "at noise\n° / mm", (_figure("predicted_attitude_deg"), _figure("predicted_position_m", 1000)))
"""What ADOP and PDOP make of this scenario's angle noise."""
NEES = Column(3, "NEES\nmean", (_figure("mean", inside="nees"),))
POSITION_ERROR = Column(1, "position, mm\nRMS / max", _error("ekf", "position m", 1000))
ATTITUDE_ERROR = Column(2, "attitude, °\nRMS / max", _error("ekf", "attitude deg"))
COLUMNS = (
    TRACKING,
    POSITION_ERROR,
    ATTITUDE_ERROR,
    Column(2, "smoothed, mm\nRMS / max", _error("smooth", "position m", 1000)),
    Column(4, "smoothed, °\nRMS / max", _error("smooth", "attitude deg")),
    Column(2, "smoothed\nNEES", (_figure("mean", inside="smooth_nees"),)),
    Column(9, "smoothed\n95 % band", _band("smooth_nees"), "–"),
    Column(7, "PnP, mm\nRMS / max", _error("pnp", "position m", 1000)),
    Column(8, "PnP, °\nRMS / max", _error("pnp", "attitude deg")),
    ADOP,
    PDOP,
    AT_NOISE,
    NEES,
    Column(6, "95 %\nband", _band("nees"), "–"),
)


def _left_out(figures: Figures) -> float | None:
    return (figures.get("integrity") or {}).get("mean_dropped_photodiodes") or None


REPLAY_COLUMNS = (
    TRACKING,
    POSITION_ERROR,
    ATTITUDE_ERROR,
    Column(1, "solved\n%, ≥5 lit", (_figure("solved_share_with_5_photodiodes", 100),)),
    Column(2, "residual\narcsec", (_figure("residual_median_rad", ARCSEC_PER_RAD),)),
    Column(3, "lit\nmean", (_figure("mean_visible"),)),
    Column(3, "left out\nmean", (_left_out,)),
    Column(8, "LM steps\nmean", (_figure("mean_iterations"),)),
    Column(4, "scatter, mm\nEKF / smoothed", _scatter("position_scatter_mm")),
    Column(5, "scatter, °\nEKF / smoothed", _scatter("attitude_scatter_deg")),
    Column(6, "to peer\nmm", (_figure("peer_position_scatter_mm"),)),
    Column(7, "to peer\n°", (_figure("peer_attitude_scatter_deg"),)),
    ADOP,
    PDOP,
)


def print_report(console: Console, summary: Mapping[str, Any], folder: Path) -> None:
    """Print the table and the sentences of a run, and where it is.

    Args:
        console: Where to print.
        summary: The run's summary.
        folder: Its folder.
    """
    console.print(results(summary, console.width))
    if verdicts := summary.get("criteria"):
        console.print()
        console.print(criteria_table(verdicts))
        for missed in reasons(verdicts):
            console.print(Text(missed.text, missed.style))
    if summary.get("status") != "complete":
        reason = summary.get("reason", "the program was killed")
        console.print(Text(f"\nThis run is not complete ({reason}); this is what there is until then.", style="yellow"))
    console.print(f"\n{folder}/", highlight=False, markup=False, soft_wrap=True)
    files = list(written(folder))
    width = max((len(file) for file, _ in files), default=0)
    for file, meaning in files:
        below = "\n" + " " * (width + 4)
        words = below.join(textwrap.wrap(meaning, max(console.width - width - 4, 20)))
        console.print(Text.assemble(f"  {file:<{width}}", (f"  {words}", "dim")))
    if (folder / RECORDING).exists():
        console.print("Look at it: ", end="")
        console.print(
            f"swarm view {shlex.quote(str(folder))}", style="bold", highlight=False, markup=False, soft_wrap=True
        )


def criteria_table(verdicts: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of criteria: name, outcome, value, limits, and whose value it is."""
    made = table("criterion", "", "value", left=2, tight=True)
    made.columns[1].no_wrap = True
    made.columns[2].no_wrap = False
    made.add_column("limits")
    made.add_column("craft")
    for v in verdicts:
        held = Text(outcome(v), {True: "green", False: "bold red", None: "yellow"}[v["held"]])
        made.add_row(Text(v["name"]), held, *measured(v), Text(about(v)))
    return made


def outcome(verdict: Mapping[str, Any]) -> str:
    """Return in words whether a criterion held."""
    return {True: "held", False: "MISSED", None: "not judged: after the end"}[verdict["held"]]


def about(verdict: Mapping[str, Any]) -> str:
    """Return whose value it is, or which craft it is about."""
    named = list(verdict.get("about") or ())
    return verdict["craft"] or (names(named) if named else "all")


def results(summary: Mapping[str, Any], width: int) -> RenderableType:
    """Return the table and the sentences below it, for a terminal of `width` columns."""
    swarm = summary.get("swarm")
    if not swarm:
        return Text("Not one lighthouse period was recorded.")
    navigating = {name: f for name, f in summary["craft"].items() if f.get("navigates", True)}
    craft = _chosen(navigating)
    groups = summary.get("groups") or {}
    rows = [*craft.items(), *groups.items(), *([("swarm", swarm)] if len(navigating) > 1 else [])]
    columns, left_out = _columns(rows, width)
    nobody = Text("No craft navigates in this run, so there is no tracking and no error to show.")
    lines: list[RenderableType] = [_table(rows, columns) if navigating else nobody]
    if left_out and navigating:
        heads = "; ".join(" ".join(column.head.split()) for column in left_out)
        lines.append(Text(f"No room in {width} columns for: {heads} (summary.json has them).", "dim"))
    if len(craft) < len(navigating):
        lines.append(Text(f"The {len(craft)} worst of {len(navigating)} craft; summary.json has them all.", "dim"))
    return Group(*lines, Text(), *(Text(sentence.text, sentence.style) for sentence in of_summary(summary)))


def written(folder: Path) -> list[tuple[str, str]]:
    """Return the files of a run that exist, and what each is."""
    files = (
        ("telemetry.parquet", "a row per craft and period"),
        ("angles.parquet", "every sweep angle, for swarm calibrate"),
        ("scans.parquet", "a row per LiDAR scan"),
        ("filter.history", "what the filters believed, for swarm smooth"),
        ("smooth.parquet", "what they believe with all that came later"),
        ("summary.json", "these figures, and more"),
        ("scenario.toml", "all that was set; run it again"),
        ("inputs/", "the models and other files that it names"),
        (RECORDING, "for the viewer"),
        ("smooth.rrd", "its smoothed lines"),
    )
    return [(name, meaning) for name, meaning in files if (folder / name).exists()]


def _chosen(craft: Mapping[str, Figures]) -> dict[str, Figures]:
    """Return all craft, or the worst of many: those that tracked least, then those with the largest error."""
    if len(craft) <= MOST_ROWS:
        return dict(craft)

    def badness(item: tuple[str, Figures]) -> tuple[float, float]:
        error = item[1].get("ekf_position_rms_m")
        return -(item[1].get("tracking_share") or 0.0), math.inf if error is None else error

    return dict(sorted(craft.items(), key=badness, reverse=True)[:WORST_ROWS])


def _columns(rows: list[tuple[str, Figures]], width: int) -> tuple[list[tuple[Column, list[str]]], list[Column]]:
    """Return the columns that fit the terminal, with their cells, and those that are left out for want of room."""
    replay = any("peer_samples" in figures for _, figures in rows)
    columns = [(c, _cells(c, rows)) for c in (REPLAY_COLUMNS if replay else COLUMNS)]
    columns = [(c, cells) for c, cells in columns if any(cell != NOTHING for cell in cells)]
    room = width - min(max(len(name) for name, _ in [*rows, (HEAD, None)]), NAME_WIDTH)
    left_out = []
    while columns and sum(GAP + _width(c, cells) for c, cells in columns) > room:
        last = max(columns, key=lambda pair: pair[0].rank)
        columns.remove(last)
        left_out.append(last[0])
    return columns, left_out


def _table(rows: list[tuple[str, Figures]], columns: list[tuple[Column, list[str]]]) -> Table:
    made = table(HEAD, *(column.head for column, _ in columns), tight=True)
    name_column = made.columns[0]
    name_column.no_wrap, name_column.max_width, name_column.overflow = True, NAME_WIDTH, "ellipsis"
    for i, (name, figures) in enumerate(rows):
        is_swarm = i == len(rows) - 1 > 0 and name == "swarm"
        if is_swarm:
            made.add_section()
        cells = (Text(texts[i], colour(figures.get("nees")) if c is NEES else "") for c, texts in columns)
        made.add_row(Text(name), *cells, style="bold" if is_swarm else "")
    return made


def _cells(column: Column, rows: list[tuple[str, Figures]]) -> list[str]:
    """Return the texts of a column.

    The largest of each figure has three significant digits, or so many up to two more that the smallest one has two.
    """
    parts = []
    for value in column.values:
        numbers = [value(figures) for _, figures in rows]
        sizes = [abs(v) for v in numbers if v]
        decimals = 0
        if sizes:
            least, most = (max(2 - math.floor(math.log10(size)), 0) for size in (max(sizes), min(sizes)))
            decimals = min(max(least, min(most - 1, least + 2)), 5)
        texts = [NOTHING if v is None else f"{v:.{decimals}f}" for v in numbers]
        parts.append([text.rjust(max(map(len, texts))) for text in texts])
    joined = (column.between.join(cells) for cells in zip(*parts, strict=True))
    known = ([value(figures) is not None for value in column.values] for _, figures in rows)
    return [text if any(some) else NOTHING for text, some in zip(joined, known, strict=True)]


def _width(column: Column, cells: list[str]) -> int:
    return max(len(text) for text in (*column.head.split("\n"), *cells))
