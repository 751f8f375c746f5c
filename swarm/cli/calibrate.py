"""The command `swarm calibrate`: from a survey to a calibration file."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.terminal import mistakes
from swarm.errors import SwarmError


class Poses(StrEnum):
    """Whose poses a calibration goes by."""

    TRUTH = "truth"
    OWN = "own"


def calibrate(
    survey: Annotated[
        Path, typer.Argument(metavar="SURVEY", help="The folder of a run with angles, or a libsurvive recording.")
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="The calibration file to write.", show_default=True)
    ] = Path("calibration.toml"),
    poses: Annotated[
        Poses | None,
        typer.Option("--poses", help="Known poses, or each craft's own as a start. Else truth where there is one."),
    ] = None,
    hold: Annotated[
        str,
        typer.Option(
            "--hold",
            metavar="LIST",
            show_default=False,
            help="What to leave as it is believed: of phase, tilt, curve, gibbous, photodiodes.",
        ),
    ] = "",
    object_name: Annotated[
        str | None, typer.Option("--object", metavar="NAME", help="Of a recording: the tracked object, such as HMD.")
    ] = None,
    lighthouse: Annotated[
        int, typer.Option("--lighthouse", metavar="N", min=0, help="Of a recording: the station.", show_default=True)
    ] = 0,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", metavar="FILE", help="Of a recording: what to start from.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
) -> None:
    """Find the fans' errors and the photodiodes' places from a survey.

    \b
    swarm run survey
    swarm calibrate runs/survey-1 --out calibration.toml
    swarm run survey --seed 2 --calibration calibration.toml
    swarm calibrate walk.rec.gz --object HMD --lighthouse 0 \\
        --hold curve,gibbous
    """
    with mistakes():
        # In threads, the small products of a calibration take longer than by themselves, much longer on a busy machine.
        for library in ("OPENBLAS", "MKL", "OMP"):
            os.environ.setdefault(f"{library}_NUM_THREADS", "1")
        from rich.console import Console

        from swarm.flight.recordings.calibration_file import held_parts, place_for, write_calibration
        from swarm.studies.calibration.calibrate import calibrate_survey
        from swarm.studies.calibration.report import file_text, print_calibration
        from swarm.studies.calibration.survey import observe_recording, observe_run

        held, file = held_parts(hold), place_for(out, force=force)
        if survey.is_file():
            seen = observe_recording(survey, object_name, lighthouse, calibration)
        elif object_name is not None or calibration is not None:
            raise SwarmError("--object and --calibration belong to a recording, and a run goes by its own scenario")
        else:
            seen = observe_run(survey)
        found = calibrate_survey(seen, None if poses is None else poses.value, held)
        write_calibration(file, file_text(found))
        print_calibration(Console(), found, file)
