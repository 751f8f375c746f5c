"""Values of a recording's lines: checks of words, and arrays of what was collected."""

import math
from array import array
from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats


def finite(text: str) -> float:
    """Return the number that a word is; raise ValueError if it is none, or not finite."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def within(value: int, low: int, high: int) -> int:
    """Return a value that lies within bounds.

    Args:
        value: the value.
        low: smallest value.
        high: first value that is too large.

    Raises:
        ValueError: the value lies outside.
    """
    if not low <= value < high:
        raise ValueError
    return value


def as_rows(values: "array[float]", columns: int) -> Floats:
    """Return collected values as rows, (N, columns)."""
    return np.array(values, dtype=np.float64).reshape(-1, columns)


def keep_from(values: "array[float]", columns: int, column: int, first: float) -> None:
    """Remove those collected rows of which a column is below a bound.

    Args:
        values: what is collected, row by row.
        columns: of a row.
        column: the one that counts.
        first: least value that is kept.
    """
    rows = as_rows(values, columns)
    kept = rows[rows[:, column] >= first]
    if len(kept) < len(rows):
        values[:] = array("d", kept.tobytes())


def in_order(rows: Floats, column: int) -> Floats:
    """Return the rows in order of a column; equal ones keep their order."""
    out: Floats = rows[np.argsort(rows[:, column], kind="stable")]
    return out


def once(rows: Floats, key: Sequence[int]) -> tuple[Floats, int]:
    """Return the rows without those that repeat an earlier one in the columns `key`, and the number of those."""
    if not len(rows):
        return rows, 0
    order = np.lexsort(rows[:, list(key)].T)
    ordered = rows[order][:, list(key)]
    again = np.zeros(len(rows), dtype=np.bool_)
    again[order[1:]] = np.all(ordered[1:] == ordered[:-1], axis=1)
    return rows[~again], int(np.count_nonzero(again))
