"""The command `swarm video`: a run as a video."""

import re
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes
from swarm.errors import SwarmError


def video(
    run: Annotated[Path, typer.Argument(metavar="RUN", autocompletion=completion.runs, help="The folder of a run.")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="The video, .mp4, or one picture, .png.")],
    speed: Annotated[
        float, typer.Option("--speed", metavar="X", help="Show so many simulated seconds per second.")
    ] = 1.0,
    fps: Annotated[int, typer.Option("--fps", metavar="N", help="Pictures per second.")] = 30,
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Width and height in pixels.")] = "1280x720",
    at: Annotated[
        float | None, typer.Option("--at", metavar="SECONDS", help="Time of a picture. Default: the middle.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")] = False,
) -> None:
    """Draw a run as a video, or a picture of it.

    \b
    swarm video runs/formation-7 formation.mp4
    swarm video runs/docking-1 docking.mp4 --speed 2
    swarm video runs/docking-1 docking.png --at 40

    The craft at their true poses, the light, and what each
    craft believes. It needs no graphics card, but the library
    PyAV (in a clone: pip install '.[video]').
    """
    with mistakes(elsewhere="as FILE"):
        from rich.console import Console

        from swarm.results.disk import refuse_existing

        found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", size)
        if not found:
            raise SwarmError(f"--size: {size!r} is not width and height such as 1280x720")
        refuse_existing(out, force=force)
        from swarm.world.offscreen import choose

        choose()
        from swarm.cli.progress import ProgressDisplay
        from swarm.exports.video import Options, still
        from swarm.exports.video import video as draw

        looks = Options(fps, speed, int(found[1]), int(found[2]))
        if out.suffix.lower() == ".png":
            still(run, out, at, looks)
            typer.echo(f"{out}")
            return
        if at is not None:
            raise SwarmError("--at is the time of a picture, .png; a video, .mp4, has all")
        with ProgressDisplay(Console(stderr=True), out.name) as display:
            draw(run, out, looks, lambda done, most: display.experiment(done / most, f"{done}/{most} pictures"))
        typer.echo(f"{out}")
