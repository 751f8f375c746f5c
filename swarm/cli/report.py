"""The command `swarm report`: one HTML page of a run or a study."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.terminal import mistakes


def report(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a study, or of a run.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Write to this file. Default: FOLDER/report.html."),
    ] = None,
) -> None:
    """Make one HTML page of a run or a study.

    \b
    swarm report runs/scaling
    swarm report runs/formation-7 --out formation.html
    """
    with mistakes():
        from swarm.report.write import write_report

        page, figures = write_report(run, out)
        typer.echo(f"{page}  opens in any browser, and needs nothing else")
        if figures:
            typer.echo(f"{figures[0].parent}/  its {len(figures)} figures, as SVG and PNG")
