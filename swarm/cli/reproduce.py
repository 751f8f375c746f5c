"""The command `swarm reproduce`: the papers' experiments."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.takes import in_words
from swarm.cli.terminal import error_message, mistakes, stoppable

Name = Annotated[
    str | None,
    typer.Argument(
        metavar="EXPERIMENT",
        autocompletion=completion.experiments,
        help="The experiment's name. Without it, all are listed.",
    ),
]
Size = Annotated[int | None, typer.Option(metavar="N", help="Run a smaller, quicker form; see the list.")]
Shapes = Annotated[
    Path | None,
    typer.Option("--shapes", metavar="FOLDER", help="Scan the shapes (OBJ, STL) of this folder: lidar-shapes."),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", parser=out_path, metavar="FOLDER", help="Write to this folder. Default: runs/<experiment>-<seed>."
    ),
]
LONG_S = 20.0
"""Processor time from which a command says beforehand how long it takes."""


def reproduce(
    experiment: Name = None,
    poses: Size = None,
    frames: Size = None,
    runs: Size = None,
    seconds: Size = None,
    draws: Size = None,
    quick: Annotated[bool, typer.Option("--quick", help="Take a smaller sample, for a first look.")] = False,
    listed: Annotated[bool, typer.Option("--list", help="List all experiments, and how long they take.")] = False,
    seed: Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of its own.")] = None,
    shapes: Shapes = None,
    out: Out = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an experiment that is there already.")] = False,
) -> None:
    """Repeat an experiment of a paper, and print its table beside ours.

    \b
    swarm reproduce
    swarm reproduce lighthouse-static
    swarm reproduce lidar-acquisition --quick
    swarm reproduce lighthouse-static --poses 5 --frames 300

    Without EXPERIMENT, or with --list, all are listed: how long each takes, and what makes it smaller.
    The files: data.parquet, figure.png, figure.svg, comparison.json.
    """
    with mistakes():
        from swarm.studies.papers import find
        from swarm.studies.papers import reproduce as repeat
        from swarm.studies.papers.catalogue import MACHINE

        if experiment is None or listed:
            _list()
            return
        asked = {"poses": poses, "frames": frames, "runs": runs, "seconds": seconds, "draws": draws}
        sizes = {size: value for size, value in asked.items() if value is not None}
        known = find(experiment)
        from rich.console import Console

        from swarm.cli.progress import ProgressDisplay
        from swarm.studies.papers.results import print_comparison
        from swarm.tables import wide_console

        def say(name: str) -> None:
            error_message(f"stopped by {name} before anything was written")

        takes_s = known.quick_takes_s if quick else known.takes_s
        if takes_s >= LONG_S and not sizes:
            said = f"{experiment} takes {in_words(takes_s)}"
            shorter = "" if quick else f"; --quick: {in_words(known.quick_takes_s)}"
            Console(stderr=True).print(f"{said} on {MACHINE}{shorter}, without compiling", highlight=False)
        with stoppable(say), ProgressDisplay(Console(stderr=True), experiment) as progress:
            tell = progress.experiment
            done = repeat(
                experiment, out=out, force=force, seed=seed, sizes=sizes, quick=quick, shapes=shapes, progress=tell
            )
        print_comparison(wide_console(), done)


def _list() -> None:
    """Print every experiment: its source, how long it takes, and its sizes."""
    from swarm.studies.papers.catalogue import EXPERIMENTS, MACHINE

    for name, known in EXPERIMENTS.items():
        sizes, quick = (
            " ".join(f"--{size} {value}" for size, value in of.items()) for of in (known.sizes, known.quick)
        )
        typer.echo(f"swarm reproduce {name}")
        typer.echo(f"  {known.source}, {known.figure}: {known.about}")
        typer.echo(f"  {in_words(known.takes_s)}: {sizes}")
        typer.echo(f"  {in_words(known.quick_takes_s)} with --quick: {quick}")
    typer.echo(
        f"\nTimes without compiling, which the first run does, up to a minute more, on {MACHINE}. "
        "A busy machine takes several times as long."
    )
