"""The command `swarm view`: a run's recording, in the viewer."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes, stoppable
from swarm.errors import SwarmError


def view(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", autocompletion=completion.runs, help="The folder of a run, or a .rrd file.")
    ],
    web: Annotated[bool, typer.Option("--web", help="Show it in the browser, served to this machine only.")] = False,
) -> None:
    """Open a run's recording in the viewer.

    \b
    swarm view runs/formation-7
    swarm view runs/formation-7 --web
    """
    with mistakes():
        from swarm.results.recording.viewer import view as open_viewer
        from swarm.results.run_folder import open_run

        opened = None if run.suffix == ".rrd" else open_run(run)
        recording = run if opened is None else opened.recording
        smoothed = None if opened is None else opened.smoothed_recording
        more = [] if smoothed is None else [smoothed]
        if recording is None:
            folder = run if opened is None else opened.folder
            raise SwarmError(
                f"{folder} has no recording: it was flown with --no-recording, or recording.enabled = false"
            )
        with stoppable():
            code = open_viewer(recording, web=web, more=more)
        raise typer.Exit(code)
