"""The command `swarm list`: the scenarios, studies, craft models and recordings there are, or one of them whole."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarm.cli.terminal import mistakes

if TYPE_CHECKING:
    from rich.console import Console

    from swarm.assets import Kind

HEADS = {
    "scenario": "Scenarios: swarm run NAME",
    "study": "Studies: swarm study NAME",
    "craft model": 'Craft: model = "NAME" in a scenario',
    "recording": "Recordings: swarm replay NAME",
}
COLUMNS = {"scenario": ("craft", "flown\ns"), "study": ("runs", "flown\ns")}
"""Figures beside the description, where there is room for them."""
WIDE = 76
"""Columns of a terminal from which there is."""
DURATION_S = 30.0
"""Default of duration_s."""


def list_all(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Tell all about this one, and how long it takes.")
    ] = None,
) -> None:
    """List the scenarios, studies, craft models and recordings.

    \b
    swarm list
    swarm list formation
    """
    with mistakes():
        from rich.console import Console

        from swarm.assets import KINDS
        from swarm.errors import SwarmError, did_you_mean

        if name is None:
            for kind in KINDS:
                if sys.stdout.isatty():
                    _print_kind(Console(), kind)
                else:
                    _print_lines(kind)
            return
        meant = next((kind for kind in KINDS if name in kind.known()), None)
        if meant is None:
            known = [one for kind in KINDS for one in kind.known()]
            raise SwarmError(f"nothing is called {name!r}{did_you_mean(name, known)}")
        from swarm.cli.about import print_about

        print_about(Console(), meant, name)


def _print_kind(console: "Console", kind: "Kind") -> None:
    """Print the table of one kind."""
    from rich.text import Text

    from swarm.tables import table

    heads = COLUMNS.get(kind.what, ()) if console.width >= WIDE else ()
    console.print(Text(HEADS[kind.what], "bold"))
    made = table("name", *heads, left=1, tight=True)
    made.add_column("", overflow="fold")
    made.columns[0].no_wrap = True
    for name, path in sorted(kind.known().items()):
        figures = figures_of(kind.what, read(path)) if heads else ()
        made.add_row(Text(name), *figures, Text(description(kind.what, name, path)))
    console.print(made)
    console.print()


def _print_lines(kind: "Kind") -> None:
    """Print one kind for a program that reads it: a line each."""
    from swarm.assets import KINDS

    width = max(len(name) for one in KINDS for name in one.known()) + 1
    typer.echo(HEADS[kind.what])
    for name, path in sorted(kind.known().items()):
        typer.echo(f"  {name:<{width}} {description(kind.what, name, path)}".rstrip())
    if kind is not KINDS[-1]:
        typer.echo()


def description(what: str, name: str, path: Path) -> str:
    """Return one line about a scenario, a study, a craft model or a recording."""
    if what in COLUMNS:
        return str(read(path).get("description", ""))
    return _first_sentence(path.with_name("README.md" if what == "craft model" else f"{name}.md"))


def figures_of(what: str, data: dict[str, Any]) -> tuple[str, str]:
    """Return the number of craft or of runs, and the simulated time of one [s]."""
    if what == "scenario":
        return str(craft_count(data)), f"{duration_s(data):g}"
    from swarm.assets import find_scenario

    base = read(find_scenario(str(data.get("base"))))
    return str(run_count(data)), f"{duration_s(base, data.get('overrides', ())):g}"


def craft_count(data: dict[str, Any]) -> int:
    """Return the number of craft of a scenario's tables."""
    return int(data.get("swarm", {}).get("count", 0)) + len(data.get("craft", ()))


def run_count(data: dict[str, Any]) -> int:
    """Return the number of runs of a study's tables."""
    seeds = data.get("seeds", 1)
    count = max(int(data.get("samples", 0)), 1) * (seeds if isinstance(seeds, int) else len(seeds))
    for _, values in flat(data.get("grid", {})):
        count *= len(values)
    return count


def flat(grid: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, list[Any]]]:
    """Yield the dotted keys of a study's grid, which TOML reads as tables in tables, with their values."""
    for key, value in grid.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def duration_s(data: dict[str, Any], overrides: Any = ()) -> float:
    """Return the simulated time of a scenario's tables [s], with a study's changes."""
    said = [text.partition("=")[2] for text in overrides if text.startswith("duration_s=")]
    return float(said[-1] if said else data.get("duration_s", DURATION_S))


def read(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file that comes along."""
    import tomllib

    return tomllib.loads(path.read_text(encoding="utf-8"))


def _first_sentence(readme: Path) -> str:
    """Return the first sentence below a README's title; empty if there is none."""
    if not readme.is_file():
        return ""
    paragraphs = readme.read_text(encoding="utf-8").split("\n\n")
    text = next((p for p in paragraphs if p.strip() and not p.startswith("#")), "")
    return " ".join(text.split()).partition(". ")[0].removesuffix(".").replace("`", "")
