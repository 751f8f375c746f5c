"""The command `swarm study`: many runs of a scenario."""

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes, stoppable
from swarm.errors import SwarmError

Name = Annotated[
    str,
    typer.Argument(
        metavar="STUDY", autocompletion=completion.studies, help="A name that `swarm list` shows, or a .toml file."
    ),
]
Craft = Annotated[
    str | None, typer.Option("--craft", metavar="N,N,...", help="Fly these numbers of craft: the grid of swarm.count.")
]
Seeds = Annotated[int | None, typer.Option("--seeds", metavar="N", help="Fly every point with so many seeds.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value in every run. Repeatable."),
]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDR", help="Fly on a dask scheduler's workers, such as tcp://host:8786's."),
]
Workers = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", help="Fly so many runs at a time on this machine. Default: one per core."),
]
Serial = Annotated[bool, typer.Option("--serial", help="Fly one run after the other, in this process.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on where an earlier start was stopped.")]
Out = Annotated[
    Path | None,
    typer.Option("--out", parser=out_path, metavar="FOLDER", help="Write to this folder. Default: runs/<study>."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace a study that is there already.")]


def study(
    study: Name,
    craft: Craft = None,
    seeds: Seeds = None,
    overrides: Overrides = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    serial: Serial = False,
    resume: Resume = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Fly a scenario many times: a row per run. Exit code 1: a run failed.

    \b
    swarm study scaling --craft 1,10,100,1000 --seeds 8
    swarm study my/study.toml --resume
    swarm study my/study.toml --scheduler tcp://host:8786
    """
    with mistakes():
        from swarm.results.owned_folder import refuse_taken
        from swarm.studies.campaign.plan import default_folder
        from swarm.studies.campaign.study import load_study

        if scheduler and (serial or workers):
            raise SwarmError("--scheduler flies on a cluster; --serial and --workers are for this machine")
        if resume and force:
            raise SwarmError("--resume keeps what is there, --force replaces it: choose one")
        chosen = load_study(study, overrides or (), craft=_numbers(craft), seeds=seeds, workers=workers)
        folder = out or default_folder(chosen)

        from rich.console import Console

        from swarm.cli.progress import ProgressDisplay
        from swarm.report.study_table import print_study
        from swarm.studies.campaign.conduct import conduct
        from swarm.studies.campaign.study_folder import CONTENTS
        from swarm.studies.campaign.task import COMPLETE
        from swarm.tables import wide_console

        refuse_taken(folder, CONTENTS, force or resume)
        command = shlex.join(["swarm", *sys.argv[1:]])

        with (
            stoppable(lambda name: _say_how_to_go_on(folder, command)),
            ProgressDisplay(Console(stderr=True), str(chosen.name)) as progress,
        ):
            done = conduct(
                chosen,
                out=folder,
                force=force,
                resume=resume,
                scheduler=scheduler,
                serial=serial,
                command=command,
                progress=progress.study,
            )
        print_study(wide_console(), done)
        if set(done.rows["status"].to_pylist()) - {COMPLETE}:
            raise typer.Exit(1)


def _numbers(text: str | None) -> list[int]:
    if text is None:
        return []
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise SwarmError(f"--craft: {text!r} is not a list of whole numbers, such as 1,10,100") from None


def _say_how_to_go_on(folder: Path, command: str) -> None:
    """Print how many runs of a study that was stopped are there, and the command that flies the others."""
    from swarm.studies.campaign.study_folder import open_study
    from swarm.tables import counted

    done = counted(len(open_study(folder).rows), "run")
    typer.echo(f"stopped; {done} finished, and kept in {folder}/\nGo on: {_resume(command)}", err=True)


def _resume(command: str) -> str:
    words = [word for word in shlex.split(command) if word != "--force"]
    return shlex.join(words if "--resume" in words else [*words, "--resume"])
