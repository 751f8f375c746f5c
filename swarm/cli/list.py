"""The command `swarm list`: the scenarios, studies, craft models and recordings there are, or one of them whole."""

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes

if TYPE_CHECKING:
    from rich.console import Console

    from swarm.cli.entries import Entry

WIDE = 76
"""Columns of a terminal from which there is room for figures beside the descriptions."""


def list_all(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", autocompletion=completion.everything, help="Tell all about this one, and how long it takes."
        ),
    ] = None,
) -> None:
    """List the scenarios, studies, craft models and recordings.

    \b
    swarm list
    swarm list formation
    """
    with mistakes():
        from rich.console import Console

        from swarm.cli.entries import entries
        from swarm.errors import SwarmError, did_you_mean

        known = entries()
        if name is None:
            if not sys.stdout.isatty():
                _print_lines(known)
                return
            for kind, listed in known.items():
                _print_table(Console(), kind, listed)
            return
        every = [entry for listed in known.values() for entry in listed]
        meant = next((entry for entry in every if entry.name == name), None)
        if meant is None:
            raise SwarmError(f"nothing is called {name!r}{did_you_mean(name, [entry.name for entry in every])}")
        from swarm.cli.about import print_about

        print_about(Console(), meant)


def _print_table(console: "Console", kind: "type[Entry]", listed: "list[Entry]") -> None:
    """Print the table of one kind."""
    from rich.text import Text

    from swarm.tables import table

    heads = kind.columns if console.width >= WIDE else ()
    console.print(Text(kind.head, "bold"))
    made = table("name" if heads else "", *heads, left=1, tight=True)
    made.show_header = bool(heads)
    made.add_column("", overflow="fold")
    made.columns[0].no_wrap = True
    for entry in listed:
        made.add_row(Text(entry.name), *(entry.figures if heads else ()), Text(entry.description))
    console.print(made)
    console.print()


def _print_lines(known: "dict[type[Entry], list[Entry]]") -> None:
    """Print all kinds for a program that reads them: a line each."""
    width = max(len(entry.name) for listed in known.values() for entry in listed) + 1
    parts = []
    for kind, listed in known.items():
        lines = [f"  {entry.name:<{width}} {entry.description}".rstrip() for entry in listed]
        parts.append("\n".join([kind.head, *lines]))
    typer.echo("\n\n".join(parts))
