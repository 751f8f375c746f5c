"""Tables at a terminal, all in one style."""

from rich import box
from rich.table import Table


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
