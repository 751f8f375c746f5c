"""The command `swarm survey`: where the stations stand, from recordings."""

import os
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes
from swarm.errors import SwarmError

Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="libsurvive recordings and Crazyflie event logs in which objects see two stations or more at once. A "
        "trajectory among them is a truth.",
    ),
]
Truths = Annotated[
    list[Path] | None,
    typer.Option(
        "--truth",
        metavar="FILE...",
        help="Motion capture: .npy, TUM or CSV, one per recording in their order. It fixes frame and scale.",
    ),
]
Out = Annotated[Path, typer.Option("--out", parser=out_path, metavar="FILE", help="Write the stations to this file.")]
ObjectName = Annotated[
    str | None,
    typer.Option("--object", metavar="NAME", help="Use only this tracked object, such as HMD."),
]
Calibration = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="FILE", help="Take the calibrations of this libsurvive configuration."),
]
Stations = Annotated[
    Path | None, typer.Option("--stations", metavar="FILE", help="Start from this file of stations and keep its frame.")
]
Adjust = Annotated[
    str,
    typer.Option(
        "--adjust",
        metavar="LIST",
        show_default=False,
        help="Adjust these error terms of the fans, too: phase, tilt, curve, gibbous, ogee.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]


def survey(
    files: Files,
    truth: Truths = None,
    out: Out = Path("stations.toml"),
    object_name: ObjectName = None,
    calibration: Calibration = None,
    stations: Stations = None,
    adjust: Adjust = "",
    force: Force = False,
) -> None:
    """Find where the stations stand from recordings of real light.

    \b
    swarm survey walk.rec.gz --out stations.toml
    swarm survey walk.rec.gz --adjust phase,tilt
    swarm survey handheld
    swarm survey FLIGHT/log0* --truth FLIGHT/mocap0*
    swarm replay walk.rec.gz --stations stations.toml
    """
    with mistakes():
        # In threads, many small products take longer than by themselves, much longer on a busy machine.
        for library in ("OPENBLAS", "MKL", "OMP"):
            os.environ.setdefault(f"{library}_NUM_THREADS", "1")

        from rich.console import Console
        from rich.text import Text

        from estimators.survey.terms import PARTS
        from swarm.assets import find_recording, own_recording
        from swarm.flight.recordings.calibration_file import place_for, write_calibration
        from swarm.flight.recordings.formats import Format, format_of
        from swarm.flight.recordings.stations_file import read_stations
        from swarm.studies.survey.collect import collect
        from swarm.studies.survey.report import adjusted_parts, file_text, print_survey
        from swarm.studies.survey.solve import solve_survey
        from swarm.tables import wide_console

        parts, file = adjusted_parts(adjust, tuple(PARTS)), place_for(out, force=force)
        # A shell gives the second and later files of `--truth FLIGHT/mocap*` as arguments.
        files = [one if one.exists() else find_recording(one) for one in files]
        if calibration is None and len(files) == 1 and (own := own_recording(files[0])):
            calibration = own.calibration
        kinds = [format_of(one) for one in files]
        truths = list(truth or []) + [f for f, kind in zip(files, kinds, strict=True) if kind is Format.TRAJECTORY]
        recordings = [f for f, kind in zip(files, kinds, strict=True) if kind is not Format.TRAJECTORY]
        if not recordings:
            raise SwarmError(f"{files[0]}: a trajectory is a truth for a recording; no recording is given")
        if truths and len(truths) != len(recordings):
            raise SwarmError(
                f"--truth: {len(truths)} given for {len(recordings)} recordings; give one for each, in their order"
            )
        start = None if stations is None else read_stations(stations)
        result = solve_survey(collect(recordings, object_name, calibration, start, alone=bool(truths)), truths, parts)
        write_calibration(file, file_text(result))
        print_survey(wide_console(), result, file)
        for note in result.notes:
            Console(stderr=True, highlight=False).print(Text(f"note: {note}", "yellow"), soft_wrap=True)
