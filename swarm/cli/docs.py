"""The command `swarm docs`: the documentation, at the terminal; it is installed with the program."""

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes


def docs(
    page: Annotated[
        str | None,
        typer.Argument(
            metavar="PAGE", autocompletion=completion.pages, help="Print this page. Without it, all are listed."
        ),
    ] = None,
) -> None:
    """Read the documentation.

    \b
    swarm docs
    swarm docs scenario
    """
    with mistakes():
        from rich.console import Console
        from rich.text import Text

        from swarm.assets import pages
        from swarm.errors import SwarmError, did_you_mean
        from swarm.tables import table

        known = pages()
        if page is None:
            made = table("page", tight=True)
            made.add_column("")
            for name, path in known.items():
                title = path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
                made.add_row(Text(name), Text(title))
            Console().print(made)
            typer.echo(f"\nThe files are in {next(iter(known.values())).parent}")
            return
        name = page.removeprefix("docs/").removesuffix(".md")
        if name not in known:
            about = [one for one, path in known.items() if _tells(path, name)]
            hint = f"; {page!r} is a subject of: {', '.join(about)}" if about else did_you_mean(name, known)
            raise SwarmError(f"no page {page!r}{hint}")
        text = known[name].read_text(encoding="utf-8")
        if sys.stdout.isatty():
            from rich.markdown import Markdown

            Console().print(Markdown(text))
        else:
            typer.echo(text, nl=False)


def _tells(page: Path, word: str) -> bool:
    """Tell whether a heading of a page has a word."""
    headings = (line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("#"))
    return any(re.search(rf"\b{re.escape(word)}", line, re.IGNORECASE) for line in headings)
