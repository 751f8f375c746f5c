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
        out = no_moments(1)
        add_moments(np.zeros(len(x), dtype=np.int64), x, out)
        return cls(*out[0].tolist())


Series = dict[str, tuple[Callable[..., Any], *tuple[Floats, ...]]]
"""Figures by name: a function of moments, and the series (rows,), NaN where unknown, of which it takes them."""


def no_moments(parts: int) -> Floats:
    """Return the moments (parts, 4) of parts without a value."""
    return np.tile([0.0, 0.0, 0.0, -np.inf], (parts, 1))


def together(moments: Floats) -> Floats:
    """Return the moments (4,) of parts (parts, 4) as one."""
    return np.append(moments[:, :3].sum(axis=0), moments[:, 3].max(initial=-np.inf))


@kernel
def add_moments(part: Ints, value: Floats, moments: Floats) -> None:
    """Add the known values of a series to the moments of their parts.

    Args:
        part: Part of each row, (rows,).
        value: The series, (rows,), NaN where unknown.
        moments: Number, sum, sum of squares and maximum of each part's values, (parts, 4).
    """
    for i in range(len(value)):
        x = value[i]
        if np.isfinite(x):
            of = moments[part[i]]
            of[0] += 1.0
            of[1] += x
            of[2] += x * x
            of[3] = max(of[3], x)


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
