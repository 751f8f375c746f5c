"""The command `swarm run`: a scenario, flown."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm.cli.options import Force, NoRecording, Out, Overrides, Scenario, Seed
from swarm.cli.terminal import fly_and_report, mistakes

if TYPE_CHECKING:
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run


def run(
    scenario: Scenario,
    overrides: Overrides = None,
    seed: Seed = None,
    out: Out = None,
    force: Force = False,
    live: Annotated[bool, typer.Option("--live", help="Open the viewer, and watch while it flies.")] = False,
    no_recording: NoRecording = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration", metavar="FILE", help="Remove these errors on board: a file of `swarm calibrate`."
        ),
    ] = None,
) -> None:
    """Fly a scenario, and write what happened.

    \b
    swarm run formation
    swarm run formation --set swarm.count=16 \\
        --set lighthouse.angle_noise_arcsec=20 --seed 3
    swarm run my/scenario.toml --live --out runs/mine
    """
    with mistakes():
        from rich.console import Console

        from swarm.results.owned_folder import folder_of
        from swarm.results.run_folder import refuse_run
        from swarm.scenario import load
        from swarm.scenario.faults import too_late
        from swarm.scenario.text import toml_value
        from swarm.tables import say

        also = [] if calibration is None else [f"navigation.calibration={toml_value(str(calibration))}"]
        settings = load(scenario, [*(overrides or ()), *also], seed)
        folder = folder_of(settings.name, settings.seed, out)
        refuse_run(settings.name, settings.seed, folder, force)
        for note in too_late(settings.fault, settings.duration_s):
            say(Console(stderr=True), f"note: {note}")

        def fly(progress: Callable[["Progress"], None]) -> "Run":
            from swarm.flight.simulate import simulate

            return simulate(settings, out=folder, force=force, live=live, record=not no_recording, progress=progress)

        fly_and_report(settings.name, folder, fly)
