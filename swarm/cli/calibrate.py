"""The command `swarm calibrate`: from a survey to a calibration file."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes
from swarm.errors import SwarmError


class Poses(StrEnum):
    """The poses that a calibration goes by."""

    TRUTH = "truth"
    OWN = "own"


Survey = Annotated[
    Path,
    typer.Argument(
        metavar="SURVEY",
        autocompletion=completion.runs,
        help="The folder of a run with angles, or a libsurvive recording.",
    ),
]
Out = Annotated[
    Path, typer.Option("--out", parser=out_path, metavar="FILE", help="Write the calibration to this file.")
]
ByPoses = Annotated[
    Poses | None,
    typer.Option("--poses", help="Use known poses, or each craft's own as a start. Default: truth where there is one."),
]
Hold = Annotated[
    str,
    typer.Option(
        "--hold",
        metavar="LIST",
        show_default=False,
        help="Leave these parts as they are believed to be: phase, tilt, curve, gibbous, photodiodes.",
    ),
]
ObjectName = Annotated[
    str | None, typer.Option("--object", metavar="NAME", help="Use this tracked object of a recording, such as HMD.")
]
Lighthouse = Annotated[
    int, typer.Option("--lighthouse", metavar="N", min=0, help="Use this station of a recording.", show_default=True)
]
Start = Annotated[
    Path | None, typer.Option("--calibration", metavar="FILE", help="Start a recording from this calibration.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]


def calibrate(
    survey: Survey,
    out: Out = Path("calibration.toml"),
    poses: ByPoses = None,
    hold: Hold = "",
    object_name: ObjectName = None,
    lighthouse: Lighthouse = 0,
    calibration: Start = None,
    force: Force = False,
) -> None:
    """Calibrate fans and photodiodes from a survey.

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

        from swarm.flight.recordings.calibration_file import held_parts, place_for, write_calibration
        from swarm.results.files import SUMMARY
        from swarm.studies.calibration.calibrate import calibrate_survey
        from swarm.studies.calibration.report import file_text, print_calibration
        from swarm.studies.calibration.survey import observe_recording, observe_run
        from swarm.tables import wide_console

        held, file = held_parts(hold), place_for(out, force=force)
        if survey.is_file() and not (survey.parent / SUMMARY).is_file():
            seen = observe_recording(survey, object_name, lighthouse, calibration)
        elif object_name is not None or calibration is not None:
            raise SwarmError("--object and --calibration belong to a recording, and a run goes by its own scenario")
        else:
            seen = observe_run(survey)
        found = calibrate_survey(seen, None if poses is None else poses.value, held)
        write_calibration(file, file_text(found))
        print_calibration(wide_console(), found, file)
