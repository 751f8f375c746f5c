"""The words that experiments share: what one is, what it is asked for, what it finds, and the columns of its data."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from estimators.arrays import Floats
from swarm.errors import SwarmError
from swarm.figures import Figure
from swarm.results.parquet import Table, column, table_of
from swarm.units import written_unit

Value = float | tuple[float, float] | str | None
"""One figure, the smallest and the largest of several, words, or nothing."""
Limits = tuple[float | None, float | None]
"""Both ends of a range; None: open."""
T = TypeVar("T")


class Line(NamedTuple):
    """One line of the comparison.

    target: range in which ours must lie; None: the line is only to be looked at. group: a heading that lines share.
    """

    quantity: str
    unit: str
    paper: Value
    ours: Value
    target: Limits | None = None
    group: str = ""

    @property
    def met(self) -> bool | None:
        """The answer to whether all of ours lies in the target; None without a target."""
        if self.target is None:
            return None
        low, high = self.target
        return all(
            isinstance(value, int | float)
            and math.isfinite(value)
            and (low is None or value >= low)
            and (high is None or value <= high)
            for value in (self.ours if isinstance(self.ours, tuple) else (self.ours,))
        )


def under(group: str, *lines: Line) -> list[Line]:
    """Return the lines under one heading."""
    return [line._replace(group=group) for line in lines]


class Grid(NamedTuple):
    """A table of results beside the comparison: each row has a name and a figure per column."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, tuple[Value, ...]]]


Columns = dict[str, tuple[Any, str]]
"""Values and meaning of data columns by name; see `data`."""


class Outcome(NamedTuple):
    """The findings of an experiment. notes: sentences printed below the comparison. grids: printed above it."""

    comparison: list[Line]
    data: Table
    figure: Figure
    notes: tuple[str, ...] = ()
    grids: tuple[Grid, ...] = ()


class Request(NamedTuple):
    """The order of an experiment. progress: is told the share that is done, and what is being done. folder: of the
    shapes that it scans; None: its own.
    """

    seed: int
    sizes: Mapping[str, int]
    progress: Callable[[float, str], None]
    folder: Path | None = None

    def rng(self) -> np.random.Generator:
        """Return the generator of the experiment's random draws."""
        return np.random.default_rng(self.seed)

    def each(self, items: Sequence[T], name: str, part: tuple[int, int] = (0, 1)) -> Iterator[T]:
        """Yield the items, and tell the progress after each, as "`name` 3 of 10".

        Args:
            items: What to go through.
            name: Name of one of them, for the message.
            part: Number of the part of the experiment that they are, from 0, and number of parts.
        """
        for i, item in enumerate(items, start=1):
            yield item
            self.progress((part[0] + i / len(items)) / part[1], f"{name} {i} of {len(items)}")

    def refuse_below(self, fewest: int, purpose: str, *names: str) -> None:
        """Raise SwarmError where the product of these sizes is too small.

        Args:
            fewest: Least product.
            purpose: What needs so many, for the message.
            *names: Names of the sizes.
        """
        if math.prod(self.sizes[name] for name in names) < fewest:
            asked = " and ".join(f"--{name}: {self.sizes[name]}" for name in names)
            raise SwarmError(f"{asked}: {purpose} needs at least {fewest}")


def data(columns: Columns) -> Table:
    """Return the table of an experiment's data; NaN becomes null, and every column tells its unit and meaning.

    Args:
        columns: Values and meaning by the column's name, whose suffix is the unit. With a `*` in both, values (n, 3) or
            (n, 4) become one column per component, x to z or w to z.
    """
    made = []
    for name, (values, meaning) in columns.items():
        parts = {"": values}
        if "*" in name:
            values = np.asarray(values)
            letters = "xyz" if values.shape[1] == 3 else "wxyz"
            parts = {letter: values[:, i] for i, letter in enumerate(letters)}
        for letter, part in parts.items():
            made.append(column(name.replace("*", letter), part, _unit(name, part), meaning.replace("*", letter)))
    return table_of(made)


def _unit(name: str, values: Any) -> str:
    over, _, under = name.rpartition("_per_")
    unit = f"{written_unit(over)}/{under}" if over else written_unit(name)
    return unit or ("" if np.asarray(values).dtype.kind in "USb" else "1")


def span(values: Any) -> tuple[float, float]:
    """Return the smallest and the largest of some values."""
    values = np.asarray(values)
    return float(values.min()), float(values.max())


def rms(values: Floats) -> Floats:
    """Return the root mean square of values (..., n) over all but the last axis, (n,)."""
    out: Floats = np.sqrt(np.mean(values.reshape(-1, values.shape[-1]) ** 2, axis=0))
    return out


def quantiles(values: Floats) -> dict[str, float]:
    """Return mean, median, 95 % quantile and largest of errors, by name; NaN values do not count."""
    known = values[np.isfinite(values)]
    if not len(known):
        return dict.fromkeys(("mean", "median", "95 %", "largest"), float("nan"))
    return {
        "mean": float(known.mean()),
        "median": float(np.median(known)),
        "95 %": float(np.quantile(known, 0.95)),
        "largest": float(known.max()),
    }
