"""The command `swarm place`: the places of lighthouse stations."""

from pathlib import Path
from typing import Annotated, Any

import typer

from swarm.cli import completion
from swarm.cli.options import AttitudeDeg, ForceFiles, PositionMm, SearchSeed, out_path
from swarm.cli.terminal import mistakes

BOX = "x0,x1,y0,y1,z0,z1"
Subject = Annotated[
    str,
    typer.Argument(
        metavar="MODEL|SCENARIO",
        help="A craft, with --volume, or a scenario, for the poses of its flight: a name that `swarm list` shows, or a "
        "file.",
        autocompletion=completion.models_and_scenarios,
    ),
]
Stations = Annotated[
    int | None,
    typer.Option(
        "--stations",
        metavar="K",
        help="Place so many. Default: as many as stand in the scenario, or the fewest that reach the precision.",
    ),
]
Kind = Annotated[
    str | None,
    typer.Option(
        "--kind",
        metavar="KIND",
        help="lighthouse-2, or lighthouse-1 (at most two). Default: as in the scenario, or lighthouse-2.",
    ),
]
Volume = Annotated[
    str | None,
    typer.Option("--volume", metavar=BOX, help="Poses of the craft are in this box, in metres."),
]
TiltDeg = Annotated[
    float,
    typer.Option(
        "--tilt-deg", metavar="DEG", help="Largest tilt of the craft's +z from up, at any heading. 180: any attitude."
    ),
]
Room = Annotated[
    str | None, typer.Option("--room", metavar=BOX, help="Stations may stand on the walls and the ceiling of this box.")
]
On = Annotated[
    list[str] | None,
    typer.Option("--on", metavar="FACE", help="Only on these faces of the room: walls, ceiling, floor. Repeatable."),
]
ShellM = Annotated[
    list[float] | None,
    typer.Option(
        "--shell-m", metavar="M", help="They may stand at this distance from the volume's middle. Repeatable."
    ),
]
At = Annotated[
    list[str] | None, typer.Option("--at", metavar="x,y,z", help="They may stand at this point. Repeatable.")
]
Up = Annotated[str, typer.Option("--up", metavar="AXIS", help="The axis that is up: z, -y, ...")]
KeepOut = Annotated[
    list[str] | None, typer.Option("--keep-out", metavar=BOX, help="No station may stand here. Repeatable.")
]
NearM = Annotated[
    float | None,
    typer.Option("--near-m", metavar="M", help="Least distance from the volume. Default: the light's least range."),
]
FarM = Annotated[
    float | None,
    typer.Option("--far-m", metavar="M", help="Largest distance from the volume. Default: the light's range."),
]
Fixed = Annotated[
    str | None, typer.Option("--fixed", metavar="FILE", help="Stations of this stations.toml stand already.")
]
Share = Annotated[
    float,
    typer.Option("--share", metavar="SHARE", help="Share of the poses that must be decided, and precise. 1: all."),
]
Losses = Annotated[
    int,
    typer.Option("--losses", metavar="0|1", help="Stations that may fail. 1: the poses are those without any one."),
]
AngleNoise = Annotated[
    float | None,
    typer.Option(
        "--angle-noise-arcsec",
        metavar="ARCSEC",
        help="Noise of one sweep angle. Default: 2.6 of lighthouse-2, the scenario's (8.8) of lighthouse-1.",
    ),
]
RotorCorrelation = Annotated[
    float | None,
    typer.Option(
        "--rotor-correlation",
        metavar="RHO",
        help="Share of its variance that a sweep's photodiodes have in common. Default: 0.35, the scenario's (0.8717).",
    ),
]
CraftName = Annotated[
    str | None, typer.Option("--craft", metavar="NAME", help="The craft of the scenario that they are placed for.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change one value: of the scenario, or else lighthouse.KEY. Repeatable."
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", parser=out_path, metavar="FILE", help="Write the stations here (.toml). Default: below runs/."
    ),
]


def place(
    subject: Subject,
    stations: Stations = None,
    kind: Kind = None,
    volume: Volume = None,
    tilt_deg: TiltDeg = 180.0,
    room: Room = None,
    on: On = None,
    shell_m: ShellM = None,
    at: At = None,
    up: Up = "z",
    keep_out: KeepOut = None,
    near_m: NearM = None,
    far_m: FarM = None,
    fixed: Fixed = None,
    attitude_deg: AttitudeDeg = None,
    position_mm: PositionMm = None,
    share: Share = 0.95,
    losses: Losses = 0,
    angle_noise_arcsec: AngleNoise = None,
    rotor_correlation: RotorCorrelation = None,
    craft: CraftName = None,
    overrides: Overrides = None,
    seed: SearchSeed = 0,
    out: Out = None,
    force: ForceFiles = False,
) -> None:
    """Find where lighthouse stations should stand.

    \b
    swarm place mockup --stations 4 --volume=-1,1,-1,1,0,2 \\
        --tilt-deg 30 --room=-3,3,-3,3,0,3
    swarm place mockup --position-mm 2 \\
        --volume=-1,1,-1,1,0,2 --losses 1
    swarm place my/docking.toml --stations 2 --shell-m 3
    swarm place two-stations
    """
    given: dict[str, Any] = {key: value for key, value in locals().items() if value is not None}
    with mistakes():
        from swarm.studies.placement.report import print_report
        from swarm.studies.placement.request import Request
        from swarm.studies.placement.study import study
        from swarm.tables import wide_console

        request = Request(**{key: value for key, value in given.items() if key in Request._fields})
        made = study(request, out, force, lambda text: typer.echo(f"place: {text}", err=True), seed)
        print_report(wide_console(highlight=False), made.figures)
        for file in made.files:
            typer.echo(file)
