"""The command `swarm new`: a folder with a scenario and craft of one's own, to start from."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes


def new(
    name: Annotated[Path, typer.Argument(metavar="NAME", help="The folder; its last part names the scenario.")],
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="SCENARIO",
            autocompletion=completion.scenarios,
            help="Start from this scenario: a name, or a .toml file.",
        ),
    ] = None,
) -> None:
    """Write a scenario and craft of your own, to start from.

    \b
    swarm new probe
    swarm new probe --from docking

    Nothing is overwritten.
    """
    with mistakes(elsewhere="as NAME"):
        from swarm.cli.starter import start

        scenario = start(name, source)
        folder = scenario.parent
        typer.echo(f"{folder}/")
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            typer.echo(f"  {file.relative_to(folder)}")
        typer.echo(f"Next: swarm check {shlex.quote(str(scenario))}")
        typer.echo(f"      swarm run {shlex.quote(str(scenario))}")
        typer.echo(f"What to change: {folder / 'README.md'}")
