"""Statistics of a series, JSON-able: None where nothing is known. Most follow from its moments, which add up."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel


class Moments(NamedTuple):
    """The number n of a series' known values, their sum, the sum of their squares, and the largest."""

    n: float
    total: float
    square: float
    largest: float

    @classmethod
    def of(cls, x: Floats) -> "Moments":
        """Return the moments of a series (n,), NaN where unknown."""
        part, out = np.zeros(len(x), dtype=np.int64), no_moments(1)
        add_moments(runs_of(part), part, x, out)
        return cls(*out[:, 0].tolist())


Series = dict[str, tuple[Callable[..., Any], *tuple[Floats, ...]]]
"""Figures by name: a function of moments, and the series (rows,), NaN where unknown, of which it takes them."""


def no_moments(parts: int) -> Floats:
    """Return the moments (4, parts) of parts without a value."""
    return np.repeat([[0.0], [0.0], [0.0], [-np.inf]], parts, axis=1)


def together(moments: Floats) -> Floats:
    """Return the moments (4,) of parts (4, parts) as one."""
    # Columns are summed one after the other, as rows of the file are.
    return np.append(np.ascontiguousarray(moments[:3].T).sum(axis=0), moments[3].max(initial=-np.inf))


def runs_of(part: Ints) -> Ints:
    """Return where runs of rows begin whose parts (rows,) are neighbours in ascending order, and the number of rows."""
    return np.concatenate([[0], np.flatnonzero(np.diff(part) != 1) + 1, [len(part)]])


@kernel
def add_moments(runs: Ints, part: Ints, value: Floats, moments: Floats) -> None:
    """Add the known values of a series to the moments of their parts.

    Args:
        runs: As `runs_of` gives them: the rows of a run are taken side by side.
        part: Part of each row, (rows,).
        value: The series, (rows,), NaN where unknown.
        moments: Number, sum, sum of squares and maximum of each part's values, (4, parts).
    """
    for run in range(len(runs) - 1):
        first, count = runs[run], runs[run + 1] - runs[run]
        if count:
            x, own = value[first : first + count], slice(part[first], part[first] + count)
            n, total, square, most = moments[0, own], moments[1, own], moments[2, own], moments[3, own]
            # Few arrays in a loop, so that it is compiled for several numbers at once.
            for i in range(count):
                known = np.isfinite(x[i])
                n[i] += 1.0 if known else 0.0
                total[i] += x[i] if known else 0.0
            for i in range(count):
                known = np.isfinite(x[i])
                y = x[i] if known else 0.0
                square[i] += y * y
                most[i] = max(most[i], x[i] if known else -np.inf)


def number(value: float | np.floating[Any]) -> float | None:
    """Return the value, None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def count(x: Moments) -> int:
    """Return the number of the known values."""
    return int(x.n)


def any_known(x: Moments) -> bool:
    """Return whether any value is known."""
    return x.n > 0


def total(x: Moments) -> int:
    """Return the sum of the known values, which are whole, or true or false."""
    return int(x.total)


def mean(x: Moments) -> float | None:
    """Return the mean of the known values."""
    return number(x.total / x.n) if x.n else None


def rms(x: Moments) -> float | None:
    """Return the root mean square of the known values."""
    return number(math.sqrt(x.square / x.n)) if x.n else None


def largest(x: Moments) -> float | None:
    """Return the maximum of the known values."""
    return x.largest if x.n else None


def ratio(above: Moments, below: Moments) -> float | None:
    """Return the ratio of two RMS."""
    a, b = rms(above), rms(below)
    return a / b if a is not None and b else None


def where_both(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return two series (n,) where both are known, NaN elsewhere."""
    missing = np.where(np.isfinite(a) & np.isfinite(b), 0.0, np.nan)
    return a + missing, b + missing


def among(of: Bools, which: Bools) -> Floats:
    """Return 1 for those `of` the rows `which`, 0 for others of them, NaN for all other rows: its mean is a share."""
    return np.where(which, of, np.nan)


def median(x: Floats) -> float | None:
    """Return the median of the known values of a series (n,)."""
    known = x[np.isfinite(x)]
    return number(np.median(known)) if known.size else None
