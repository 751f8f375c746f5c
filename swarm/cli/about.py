"""All about one scenario, study, craft model or recording that comes along, for `swarm list NAME`."""

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from swarm.cli.entries import Entry

MOST_WIDTH = 88


def print_about(console: "Console", entry: "Entry") -> None:
    """Print all about one entry."""
    from rich.text import Text

    width = min(console.width, MOST_WIDTH)
    console.print(Text(f"{entry.name}, a {entry.kind.what}", "bold"))
    for paragraph in entry.paragraphs:
        for line in [paragraph] if paragraph.startswith("  ") else textwrap.wrap(paragraph, width):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        console.print()
    facts = entry.facts
    column = max(map(len, facts))
    for head, fact in facts.items():
        room = max(width - column - 2, 20)
        lines = textwrap.wrap(fact, room, break_on_hyphens=False, break_long_words=False) or [""]
        for i, line in enumerate(lines):
            console.print(f"{head if i == 0 else '':<{column}}  {line}", highlight=False, markup=False, soft_wrap=True)
    console.print(f"\n{entry.use}", style="bold", highlight=False, markup=False, soft_wrap=True)
