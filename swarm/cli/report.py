"""The command `swarm report`: one HTML page of a run or a study."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes


class Paper(StrEnum):
    """A format of figures for a paper."""

    PDF = "pdf"
    SVG = "svg"


def report(
    run: Annotated[
        Path,
        typer.Argument(metavar="RUN", autocompletion=completion.results, help="The folder of a study, or of a run."),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", parser=out_path, metavar="FILE", help="Write to this file. Default: FOLDER/report.html."),
    ] = None,
    figures: Annotated[
        Paper | None,
        typer.Option(
            "--figures",
            help="Also write every figure for a paper: 180 mm and 89 mm wide, in a serif type, signs as LaTeX sets "
            "them, text as text.",
        ),
    ] = None,
) -> None:
    """Make one HTML page of a run or a study.

    \b
    swarm report runs/scaling
    swarm report runs/formation-7 --out formation.html
    swarm report runs/formation-7 --figures pdf
    """
    with mistakes():
        from swarm.report.write import write_report
        from swarm.tables import counted

        page, files = write_report(run, out, None if figures is None else figures.value)
        typer.echo(f"{page}  opens in any browser, and needs nothing else")
        if files:
            count = len({file for file in files if file.suffix == ".png"})
            also = "" if figures is None else f", and for a paper (NAME-page.{figures}, NAME-column.{figures})"
            typer.echo(f"{files[0].parent}/  {counted(count, 'figure')}, as SVG and PNG{also}")
