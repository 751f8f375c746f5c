"""The end of `swarm study` at the terminal: a table of the points, what failed, and where the rest is.

Headings are words below each other. Where the terminal is narrow, the figures of merit that matter least are left out,
and a line names them.
"""

import textwrap
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table as Printed
from rich.text import Text

from swarm.report.page import Column
from swarm.report.sweep import point_table
from swarm.studies.campaign.study_folder import ROWS, FinishedStudy
from swarm.studies.campaign.task import COMPLETE, LOST
from swarm.tables import counted, table

MOST_ROWS = 20
HEAD_WIDTH, GAP = 10, 2
"""Letters of a line of a heading, where its words allow it, and blanks between two columns."""
LEFT_OUT_FIRST = ("NEES, mean", "time tracking", "attitude error, RMS")


def print_study(console: Console, study: FinishedStudy) -> None:
    """Print the study."""
    rows = study.rows.to_pylist()
    failed = [row for row in rows if row["status"] != COMPLETE]
    if len(failed) < len(rows):
        points = point_table(study)
        shown = points.rows[:MOST_ROWS]
        printed, missing = _table(points.columns, shown, console.width)
        console.print(printed)
        if missing:
            console.print(
                Text(f"No room in {console.width} columns for: {'; '.join(missing)} ({ROWS} has them).", "dim")
            )
        if len(points.rows) > MOST_ROWS:
            console.print(Text(f"The first {MOST_ROWS} points; {ROWS} has every run.", "dim"))
    for row in failed[:3]:
        console.print(Text(f"\nrun {row['run']} {row['status']}: {row['reason']}", "yellow"), soft_wrap=True)
    if len(failed) > 3:
        console.print(Text(f"... and {len(failed) - 3} more", "yellow"))
    again = ", --resume tries those that were lost again" if any(row["status"] == LOST for row in failed) else ""
    failures = f", {len(failed)} failed{again}" if failed else ""
    wall_s = float(study.state.get("wall_s", 0.0))
    console.print(f"\n{counted(len(rows) - len(failed), 'run')} in {wall_s:.1f} s{failures}", highlight=False)
    console.print(f"{study.folder}/{ROWS}  a row per run", highlight=False, markup=False, soft_wrap=True)
    console.print("Look at it: ", end="")
    console.print(f"swarm report {study.folder}", style="bold", highlight=False, markup=False, soft_wrap=True)


def _table(columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int) -> tuple[Printed, list[str]]:
    """Return the table of all columns that fit, and the names of those that do not."""
    heads = [_head(column) for column in columns]
    widths = [
        max(len(line) for line in (*head.split("\n"), *(row[i] for row in rows))) + GAP for i, head in enumerate(heads)
    ]
    kept, missing = list(range(len(columns))), []
    for name in LEFT_OUT_FIRST:
        if sum(widths[i] for i in kept) - GAP <= width:
            break
        missing.append(name)
        kept = [i for i in kept if columns[i].name != name]
    printed = table(*(heads[i] for i in kept), left=0, tight=True)
    for row in rows:
        printed.add_row(*(row[i] for i in kept))
    return printed, missing


def _head(column: Column) -> str:
    """Return a heading of several lines: the words, and the unit below them."""
    return "\n".join([*textwrap.wrap(column.name, HEAD_WIDTH, break_long_words=False), column.unit])
