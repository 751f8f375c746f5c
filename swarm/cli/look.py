"""The commands `swarm list` and `swarm view`: what there is, and what it looked like."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli.terminal import mistakes, stoppable
from swarm.errors import SwarmError


def list_() -> None:
    """Show the scenarios, studies and craft models there are."""
    with mistakes():
        import tomllib
        from shutil import get_terminal_size

        from swarm.assets import models, scenarios, studies

        lines: list[str] = []
        width = max(len(name) for name in (*scenarios(), *studies(), *models())) + 1
        for head, files in (("Scenarios: swarm run NAME", scenarios()), ("Studies: swarm study NAME", studies())):
            about = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
            lines += [*([""] if lines else []), head]
            lines += [f"  {name:<{width}} {table.get('description', '')}" for name, table in sorted(about.items())]
        lines += ["", 'Craft: model = "NAME" in a scenario']
        lines += [
            f"  {name:<{width}} {_first_sentence(path.with_name('README.md'))}" for name, path in models().items()
        ]
        room = get_terminal_size().columns if sys.stdout.isatty() else 1000
        for line in lines:
            typer.echo(line.rstrip() if len(line) <= room else f"{line[: room - 1]}…")


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run, or a .rrd file.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser, served to this machine only.")] = False,
) -> None:
    """Open a run's recording in the viewer.

    \b
    swarm view runs/formation-7
    swarm view runs/formation-7 --web
    """
    with mistakes():
        from swarm.results.recording.viewer import view as open_viewer
        from swarm.results.run_folder import open_run

        recording = run if run.suffix == ".rrd" else open_run(run).recording
        if recording is None:
            raise SwarmError(f"{run} has no recording: it was flown with --no-recording, or recording.enabled = false")
        with stoppable():
            code = open_viewer(recording, web=web)
        raise typer.Exit(code)


def _first_sentence(readme: Path) -> str:
    """What a model is, from the text below its README's title; empty if it has none."""
    if not readme.is_file():
        return ""
    paragraphs = readme.read_text(encoding="utf-8").split("\n\n")
    text = next((p for p in paragraphs if p.strip() and not p.startswith("#")), "")
    return " ".join(text.split()).partition(". ")[0].removesuffix(".").replace("`", "")
