"""The command `swarm layout`: the places of a craft's photodiodes."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import AttitudeDeg, ForceFiles, PositionMm, SearchSeed, out_path
from swarm.cli.terminal import mistakes

Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        autocompletion=completion.models,
        help="A craft: a name that `swarm list` shows, an .xml file, or its folder.",
    ),
]
Photodiodes = Annotated[
    int | None,
    typer.Option("--photodiodes", metavar="N", help="Place so many. Default: the fewest that reach the precision."),
]
DistanceM = Annotated[
    list[float] | None,
    typer.Option("--distance-m", metavar="M", help="Distance from the lighthouse. Default: 2 m. Repeatable."),
]
ConeDeg = Annotated[
    float | None,
    typer.Option(
        "--cone-deg",
        metavar="DEG",
        help="Largest angle of +z from the lighthouse. Default: 180, any attitude; with --scene: 5, away from the "
        "flown attitude.",
    ),
]
OffAxisDeg = Annotated[
    float | None,
    typer.Option("--off-axis-deg", metavar="DEG", help="Largest angle of positions off the boresight. Default: 30."),
]
Losses = Annotated[
    int,
    typer.Option(
        "--losses",
        metavar="0|1",
        help="Photodiodes that may be dead or shadowed. 1: every pose stays solvable without any one.",
    ),
]
KeepOut = Annotated[
    list[str] | None,
    typer.Option(
        "--keep-out",
        metavar="ZONE",
        help="Place none here: a body, geom or site of the model, or a box x0,x1,y0,y1,z0,z1 in metres. Repeatable.",
    ),
]
Scene = Annotated[
    str | None,
    typer.Option("--scene", metavar="SCENARIO", help="Take the poses from this scenario's flight, and what shades."),
]
CraftName = Annotated[
    str | None, typer.Option("--craft", metavar="NAME", help="The craft of the scene that the layout is for.")
]
Share = Annotated[
    float, typer.Option("--share", metavar="SHARE", help="Share of the poses that must reach the precision.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change one value: of the scene, or else lighthouse.KEY. Repeatable."
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", parser=out_path, metavar="FILE", help="Write the new craft model here. Default: below runs/."
    ),
]


def layout(
    model: Model,
    photodiodes: Photodiodes = None,
    attitude_deg: AttitudeDeg = None,
    position_mm: PositionMm = None,
    distance_m: DistanceM = None,
    cone_deg: ConeDeg = None,
    off_axis_deg: OffAxisDeg = None,
    share: Share = 0.95,
    losses: Losses = 1,
    keep_out: KeepOut = None,
    scene: Scene = None,
    craft: CraftName = None,
    overrides: Overrides = None,
    seed: SearchSeed = 0,
    out: Out = None,
    force: ForceFiles = False,
) -> None:
    """Find where a craft's photodiodes should sit.

    \b
    swarm layout mockup --photodiodes 12 --cone-deg 60
    swarm layout mockup --position-mm 2 --attitude-deg 0.1 \\
        --distance-m 3 --cone-deg 60 --out my/model.xml
    swarm layout my/probe.xml --photodiodes 16 \\
        --scene my/docking.toml \\
        --keep-out wing_left --keep-out wing_right
    swarm run formation --set swarm.model=my/model.xml
    """
    with mistakes():
        from swarm.studies.layout.report import print_report
        from swarm.studies.layout.request import Request
        from swarm.studies.layout.study import study
        from swarm.tables import wide_console

        request = Request(
            model,
            photodiodes,
            attitude_deg,
            position_mm,
            tuple(distance_m or ()),
            cone_deg,
            off_axis_deg,
            share,
            losses,
            tuple(keep_out or ()),
            scene,
            craft,
            tuple(overrides or ()),
        )
        made = study(request, out, force, lambda text: typer.echo(f"layout: {text}", err=True), seed)
        print_report(wide_console(highlight=False), made.figures)
        for file in made.files:
            typer.echo(file)
