"""The command `swarm compare`: several runs beside each other."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes


def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN", autocompletion=completion.runs, help="The folders of two or more runs."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            parser=out_path,
            metavar="FILE",
            help="Also draw a figure (.png, .svg, .pdf) or write a page (.html).",
        ),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Print every setting that differs, however many there are.")
    ] = False,
) -> None:
    """Compare runs: what differs in their scenarios, and their figures.

    \b
    swarm compare runs/formation-7 runs/mine
    swarm compare runs/formation-7 runs/mine --out mine.html

    The ratios are to the first run.
    """
    with mistakes():
        from swarm.report.comparison.comparison import Comparison
        from swarm.report.comparison.table import print_comparison
        from swarm.report.comparison.write import check_format, write_comparison
        from swarm.tables import wide_console

        if out is not None:
            check_format(out)
        comparison = Comparison(runs)
        print_comparison(wide_console(highlight=False), comparison, every)
        if out is not None:
            write_comparison(comparison, out)
            typer.echo(f"\n{out}")
