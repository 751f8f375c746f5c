"""The command `swarm list`: the scenarios, studies, craft models and recordings that there are."""

import sys
from pathlib import Path

import typer

from swarm.cli.terminal import mistakes


def list_all() -> None:
    """List the scenarios, studies, craft models and recordings."""
    with mistakes():
        import tomllib
        from shutil import get_terminal_size

        from swarm.assets import models, recordings, scenarios, studies

        lines: list[str] = []
        width = max(len(name) for name in (*scenarios(), *studies(), *models(), *recordings())) + 1
        for head, files in (("Scenarios: swarm run NAME", scenarios()), ("Studies: swarm study NAME", studies())):
            about = {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
            lines += [*([""] if lines else []), head]
            lines += [f"  {name:<{width}} {table.get('description', '')}" for name, table in sorted(about.items())]
        lines += ["", 'Craft: model = "NAME" in a scenario']
        lines += [
            f"  {name:<{width}} {_first_sentence(path.with_name('README.md'))}" for name, path in models().items()
        ]
        lines += ["", "Recordings: swarm replay NAME"]
        lines += [
            f"  {name:<{width}} {_first_sentence(path.with_name(f'{name}.md'))}" for name, path in recordings().items()
        ]
        room = get_terminal_size().columns if sys.stdout.isatty() else 1000
        for line in lines:
            typer.echo(line.rstrip() if len(line) <= room else f"{line[: room - 1]}…")


def _first_sentence(readme: Path) -> str:
    """Return the first sentence below a README's title; empty if there is none."""
    if not readme.is_file():
        return ""
    paragraphs = readme.read_text(encoding="utf-8").split("\n\n")
    text = next((p for p in paragraphs if p.strip() and not p.startswith("#")), "")
    return " ".join(text.split()).partition(". ")[0].removesuffix(".").replace("`", "")
