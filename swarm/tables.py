"""Tables at a terminal, all in one style."""

import os
from collections.abc import Sequence
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

FILE_WIDTH = 160
"""Columns of a table in a file or a pipe, where the variable COLUMNS does not say otherwise."""
GAP = 2
"""Blanks between two columns of a tight table."""


def counted(count: int, noun: str) -> str:
    """Return "1 run" or "3 runs"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def wide_console(*, stderr: bool = False, highlight: bool = True) -> Console:
    """Return a console as wide as its terminal, and in a file or a pipe, which has room, as `FILE_WIDTH`."""
    made = Console(stderr=stderr, highlight=highlight)
    if not made.file.isatty() and "COLUMNS" not in os.environ:
        made.width = FILE_WIDTH
    return made


def say(console: Console, text: str | Text) -> None:
    """Print a sentence, broken between words at a terminal; in a file or a pipe it stays one line."""
    console.print(text, soft_wrap=not console.is_terminal, markup=False, highlight=False)


class RankedColumn(NamedTuple):
    """A column that is left out where there is no room: those of high `rank` first. head: up to two lines."""

    rank: int
    head: str
    cells: Sequence[str]

    @property
    def width(self) -> int:
        """Characters of its widest line."""
        return max(len(text) for text in (*self.head.split("\n"), *self.cells))


def fitting(width: int, columns: Sequence[RankedColumn]) -> tuple[Table, str]:
    """Return the table of the columns that fit a terminal, and the heads of the others; the first one always stays.

    Args:
        width: Width of the terminal.
        columns: The columns, that of the names first.
    """
    kept, out = list(columns), list[str]()
    while len(kept) > 1 and sum(GAP + column.width for column in kept) - GAP > width:
        last = max(kept[1:], key=lambda column: column.rank)
        kept.remove(last)
        out.append(" ".join(last.head.replace("-\n", "").split()))
    made = table(*(column.head for column in kept), tight=True)
    for cells in zip(*(column.cells for column in kept), strict=True):
        made.add_row(*cells)
    return made, "; ".join(out)


def table(*heads: str, left: int = 1, tight: bool = False, wrap: bool = False) -> Table:
    """Return an empty table.

    Args:
        *heads: Headings of the columns.
        left: Number of columns, from the left, that hold words; the others hold numbers, and are not wrapped.
        tight: Leave two blanks between columns instead of three.
        wrap: Break the columns of numbers where the terminal is narrow, instead of the words.
    """
    made = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0) if tight else (0, 1))
    for i, head in enumerate(heads):
        if i < left:
            made.add_column(head, no_wrap=wrap)
        else:
            made.add_column(head, justify="right", no_wrap=not wrap)
    return made
