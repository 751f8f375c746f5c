"""The command `swarm layout`: where a craft's photodiodes should sit."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.terminal import mistakes


def layout(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A craft: a name that `swarm list` shows, an .xml file, its folder.")
    ],
    photodiodes: Annotated[
        int | None, typer.Option("--photodiodes", metavar="N", help="How many; else the fewest that do.")
    ] = None,
    attitude_deg: Annotated[
        float | None, typer.Option("--attitude-deg", metavar="DEG", help="Wanted precision, 1 sigma.")
    ] = None,
    position_mm: Annotated[
        float | None, typer.Option("--position-mm", metavar="MM", help="Wanted precision, 1 sigma.")
    ] = None,
    distance_m: Annotated[
        list[float] | None, typer.Option("--distance-m", metavar="M", help="From the lighthouse; 2 m. Repeatable.")
    ] = None,
    cone_deg: Annotated[
        float,
        typer.Option("--cone-deg", metavar="DEG", help="Attitudes with +z so near to the lighthouse; 180: all."),
    ] = 180.0,
    off_axis_deg: Annotated[
        float, typer.Option("--off-axis-deg", metavar="DEG", help="Positions up to so far off the boresight.")
    ] = 30.0,
    share: Annotated[
        float, typer.Option("--share", metavar="SHARE", help="Of the poses, those that the precision is for.")
    ] = 0.95,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change lighthouse.KEY. Repeatable.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of the search.")] = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The new craft model; else below runs/.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there already.")] = False,
) -> None:
    """Find where a craft's photodiodes should sit.

    \b
    swarm layout mockup --photodiodes 12
    swarm layout mockup --position-mm 2 --attitude-deg 0.1 \\
        --distance-m 3 --cone-deg 60 --out my/model.xml
    swarm run static --set swarm.model=my/model.xml
    """
    with mistakes():
        from rich.console import Console

        from swarm.studies.layout.report import print_report
        from swarm.studies.layout.request import Request
        from swarm.studies.layout.study import study

        request = Request(
            model,
            photodiodes,
            attitude_deg,
            position_mm,
            tuple(distance_m or (2.0,)),
            cone_deg,
            off_axis_deg,
            share,
            tuple(overrides or ()),
        )
        made = study(request, out, force, lambda text: typer.echo(f"layout: {text}", err=True), seed)
        print_report(Console(highlight=False), made.figures)
        for file in made.files:
            typer.echo(file)
