"""The command `swarm reproduce`: the papers' experiments."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.terminal import error_message, mistakes, stoppable

Size = Annotated[int | None, typer.Option(metavar="N", help="Run a smaller, quicker form; see the list.")]


def reproduce(
    experiment: Annotated[
        str | None, typer.Argument(metavar="EXPERIMENT", help="The experiment's name. Without it, all are listed.")
    ] = None,
    poses: Size = None,
    frames: Size = None,
    runs: Size = None,
    seconds: Size = None,
    draws: Size = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of its own.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FOLDER", help="Write to this folder. Default: runs/<experiment>-<seed>."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an experiment that is there already.")] = False,
) -> None:
    """Repeat an experiment of a paper, and print its table beside ours.

    \b
    swarm reproduce
    swarm reproduce lighthouse-static
    swarm reproduce lighthouse-static --poses 5 --frames 300

    Without EXPERIMENT, all are listed, with what makes each smaller.
    The files: data.parquet, figure.png, figure.svg, comparison.json.
    """
    with mistakes():
        from swarm.studies.papers import find
        from swarm.studies.papers import reproduce as repeat
        from swarm.studies.papers.catalogue import EXPERIMENTS

        if experiment is None:
            for name in EXPERIMENTS:
                known = find(name)
                sizes = " ".join(f"--{size} {value}" for size, value in known.sizes.items())
                typer.echo(f"swarm reproduce {name}")
                typer.echo(f"  {known.source}, {known.figure}: {known.about}")
                typer.echo(f"  {sizes}")
            return
        asked = {"poses": poses, "frames": frames, "runs": runs, "seconds": seconds, "draws": draws}
        sizes_asked = {size: value for size, value in asked.items() if value is not None}
        find(experiment)

        from rich.console import Console

        from swarm.cli.progress import ProgressDisplay
        from swarm.studies.papers.results import print_comparison

        def say(name: str) -> None:
            error_message(f"stopped by {name} before anything was written")

        with stoppable(say), ProgressDisplay(Console(stderr=True), experiment) as progress:
            done = repeat(experiment, out=out, force=force, seed=seed, sizes=sizes_asked, progress=progress.experiment)
        print_comparison(Console(), done)
