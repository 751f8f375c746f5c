"""Figures of a series, JSON-able: None where nothing is known."""

from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats


def number(value: float | np.floating[Any]) -> float | None:
    """Return the value, None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def _known(x: Floats) -> Floats:
    known = np.isfinite(x)
    return x if known.all() else x[known]


def mean(x: Floats) -> float | None:
    """Return the mean of the known values."""
    known = _known(x)
    return number(known.mean()) if known.size else None


def median(x: Floats) -> float | None:
    """Return the median of the known values."""
    known = _known(x)
    return number(np.median(known)) if known.size else None


def rms(x: Floats) -> float | None:
    """Return the root mean square of the known values."""
    known = _known(x)
    return number(np.sqrt(np.mean(known**2))) if known.size else None


def largest(x: Floats) -> float | None:
    """Return the maximum of the known values."""
    known = _known(x)
    return number(known.max()) if known.size else None


def share(of: Bools, among: Bools) -> float | None:
    """Return the share of the rows `among` that are `of`; None where there is no row."""
    return float(of[among].mean()) if among.any() else None


def ratio(above: Floats, below: Floats) -> float | None:
    """Return the ratio of two RMS, over the rows in which both are known."""
    both = np.isfinite(above) & np.isfinite(below)
    a, b = (rms(x if both.all() else x[both]) for x in (above, below))
    return a / b if a is not None and b else None
