"""The command `swarm replay`: a real recording through the same on-board code."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm.cli.options import Force, NoRecording, Out, Overrides, Seed, default_folder
from swarm.cli.terminal import fly_and_report, mistakes

if TYPE_CHECKING:
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run


class Source(StrEnum):
    """The part of a recording that is fed to the on-board code."""

    PULSES = "pulses"
    ANGLES = "angles"


def replay(
    recording: Annotated[
        Path,
        typer.Argument(metavar="RECORDING", help="A recording of a real lighthouse: libsurvive's .rec or .rec.gz."),
    ],
    object_name: Annotated[
        str | None, typer.Option("--object", metavar="NAME", help="Use this tracked object, such as HMD.")
    ] = None,
    lighthouse: Annotated[
        int, typer.Option("--lighthouse", metavar="N", min=0, help="Use this station as the reference.")
    ] = 0,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration", metavar="FILE", help="Remove the station's errors: libsurvive's config, or ours (TOML)."
        ),
    ] = None,
    source: Annotated[
        Source, typer.Option("--from", help="Feed raw light pulses, or the angles that the recording computed of them.")
    ] = Source.PULSES,
    overrides: Overrides = None,
    seed: Seed = None,
    out: Out = None,
    force: Force = False,
    no_recording: NoRecording = False,
) -> None:
    """Feed a real recording to the same on-board code.

    \b
    swarm replay walk.rec.gz --object HMD --lighthouse 0 \\
        --calibration config.json
    swarm replay walk.rec.gz --object HMD --from angles \\
        --set navigation.motion_compensation=false
    """
    with mistakes():
        from swarm.scenario import for_replay

        settings = for_replay(recording, overrides or (), seed)
        folder = out or default_folder(settings.name, settings.seed)

        def fly(progress: Callable[["Progress"], None]) -> "Run":
            from swarm.flight.replay import replay as fly_again

            return fly_again(
                recording,
                object_name=object_name,
                lighthouse=lighthouse,
                calibration=calibration,
                source=source.value,
                scenario=settings,
                out=folder,
                force=force,
                record=not no_recording,
                progress=progress,
            )

        fly_and_report(settings.name, folder, fly)
