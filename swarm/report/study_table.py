"""The end of `swarm study` at the terminal: a table of the points, what failed, and where the rest is."""

from rich.console import Console
from rich.text import Text

from swarm.report.sweep import point_table
from swarm.studies.campaign.study_folder import ROWS, FinishedStudy
from swarm.studies.campaign.task import COMPLETE, LOST
from swarm.tables import table

MOST_ROWS = 20


def print_study(console: Console, study: FinishedStudy) -> None:
    """Print the study."""
    rows = study.rows.to_pylist()
    failed = [row for row in rows if row["status"] != COMPLETE]
    if len(failed) < len(rows):
        points = point_table(study)
        printed = table(*(f"{column.name}\n{column.unit}" for column in points.columns), left=0, wrap=True)
        for cells in points.rows[:MOST_ROWS]:
            printed.add_row(*cells)
        console.print(printed)
        if len(points.rows) > MOST_ROWS:
            console.print(Text(f"The first {MOST_ROWS} points; {ROWS} has every run.", "dim"))
    for row in failed[:3]:
        console.print(Text(f"\nrun {row['run']} {row['status']}: {row['reason']}", "yellow"), soft_wrap=True)
    if len(failed) > 3:
        console.print(Text(f"... and {len(failed) - 3} more", "yellow"))
    again = ", --resume tries those that were lost again" if any(row["status"] == LOST for row in failed) else ""
    missing = f", {len(failed)} failed{again}" if failed else ""
    wall_s = float(study.state.get("wall_s", 0.0))
    console.print(f"\n{len(rows) - len(failed)} runs in {wall_s:.1f} s{missing}", highlight=False)
    console.print(f"{study.folder}/{ROWS}  a row per run", highlight=False, markup=False, soft_wrap=True)
    console.print("Look at it: ", end="")
    console.print(f"swarm report {study.folder}", style="bold", highlight=False, markup=False, soft_wrap=True)
