"""The command `swarm smooth`: the estimates of a run, with all that its filters learned later."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes


def smooth(
    run: Annotated[
        Path,
        typer.Argument(metavar="RUN", autocompletion=completion.runs, help="The folder of a run, flown or replayed."),
    ],
    force: Annotated[bool, typer.Option("--force", help="Smooth again what is smoothed already.")] = False,
) -> None:
    """Smooth the estimates of a run: each with all light before and after it.

    Adds the columns smooth_* to the telemetry (in smooth.parquet), their figures to summary.json and their lines
    to the recording. The run keeps everything that it has.

    \b
    swarm smooth runs/formation-7
    swarm report runs/formation-7
    """
    with mistakes(elsewhere=""):
        from rich.console import Console

        from swarm.cli.progress import ProgressDisplay
        from swarm.report.run_table import print_report
        from swarm.results.smoothing import refuse_unsmoothable
        from swarm.results.smoothing import smooth as smooth_run
        from swarm.tables import wide_console

        refuse_unsmoothable(run, force)
        with ProgressDisplay(Console(stderr=True), f"smooth {run.name}") as progress:
            made = smooth_run(
                run, force=force, progress=lambda share: progress.experiment(share, f"{100 * share:.0f} % smoothed")
            )
        print_report(wide_console(), made.summary, made.folder)
