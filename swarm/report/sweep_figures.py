"""The figures of any study: its figures of merit against the keys that it varied.

One key: a dot per run, and the means over the seeds with error bars. Two keys: a line per value of one of them, or a
map where both have many values. Error bars are one standard deviation of a run.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import Axes, Figure, value_map
from swarm.report.figures import BLUE, GREY, SERIES, Picture, legend, panels, picture
from swarm.report.page import plain
from swarm.report.rows import as_floats
from swarm.units import split_unit, written_unit


class Merit(NamedTuple):
    """A figure of merit: its column, a factor, its label and its unit."""

    column: str
    scale: float
    label: str
    unit: str

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


MERITS = (
    Merit("ekf_position_rms_m", 1000.0, "position error, RMS", "mm"),
    Merit("ekf_attitude_rms_deg", 1.0, "attitude error, RMS", "°"),
    Merit("position_over_bound", 1.0, "position error over the bound of craft pushed at random", ""),
    Merit("attitude_over_bound", 1.0, "attitude error over the bound of craft pushed at random", ""),
    Merit("nees_mean", 1.0, "NEES, mean", ""),
    Merit("tracking_share", 100.0, "time tracking", "%"),
    Merit("criteria_held", 100.0, "criteria held", "% of the runs"),
)
MOST_LINES = 7
"""A key of more values is not drawn as lines: two such keys are a map."""
MOST_TICKS = 9
WIDE = 20.0
"""Values that span more than this factor have a logarithmic axis."""


class Key(NamedTuple):
    """A key that was varied. points: its distinct values, numbers ascending. which: the point of every run, (runs,)."""

    name: str
    points: list[Any]
    which: Ints

    @classmethod
    def of(cls, name: str, values: Sequence[Any]) -> "Key":
        """Return a key with the values of all runs."""
        points = list(dict.fromkeys(values))
        if all(_is_number(point) for point in points):
            points.sort()
        return cls(name, points, np.array([points.index(value) for value in values], dtype=np.int64))

    @property
    def numeric(self) -> bool:
        """Its values are numbers."""
        return all(_is_number(point) for point in self.points)

    @property
    def place(self) -> Floats:
        """The places of the points on an axis: their values, words in a row."""
        return as_floats(self.points) if self.numeric else np.arange(len(self.points), dtype=np.float64)

    @property
    def label(self) -> str:
        """The name and the unit, for an axis."""
        name, unit = named(self.name)
        return f"{name} [{unit}]" if unit else name


def named(key: str) -> tuple[str, str]:
    """Return a key as words, and its unit."""
    return split_unit(key)[0].replace("_", " ").replace(".", " "), written_unit(key)


def known(columns: dict[str, list[Any]]) -> list[Merit]:
    """Return the figures of merit that a study has."""
    return [merit for merit in MERITS if any(value is not None for value in columns.get(merit.column, ()))]


def against_one(columns: dict[str, list[Any]], key: Key) -> Picture:
    """Return the figures of merit against one key.

    Args:
        columns: The finished runs.
        key: The key.
    """
    merits, repeated = known(columns), len(key.which) > len(key.points)

    def paint(figure: Figure) -> None:
        for axes, merit in zip(panels(figure, len(merits)), merits, strict=True):
            value = merit.scale * as_floats(columns[merit.column])
            axes.plot(key.place[key.which], value, "o", color=BLUE, alpha=0.3, markersize=4, markeredgewidth=0)
            if len(key.points) <= max(12, len(key.which) // 2):
                _means(axes, key, [value[key.which == k] for k in range(len(key.points))], BLUE)
            _finish(axes, key, merit)

    how = "a dot per run, and their means with one standard deviation of a run" if repeated else "a dot per run"
    rows = -(-len(merits) // 2)
    caption = f"Figures of merit against {named(key.name)[0]}: {how}."
    return picture(f"against-{_file(key)}", caption, paint, 0.4 + 2.6 * rows, 0.4 + 2.5 * len(merits))


def against_two(columns: dict[str, list[Any]], one: Key, other: Key) -> Picture:
    """Return the figures of merit against two keys: a line per value of the one with fewer values, or a map.

    Args:
        columns: The finished runs.
        one: A key.
        other: The other key.
    """
    # Words and few values make lines; the other key goes along the axis.
    key, lines = sorted((one, other), key=lambda k: (not k.numeric, -len(k.points)))
    mapped = len(lines.points) > MOST_LINES
    merits = known(columns)

    def paint(figure: Figure) -> None:
        all_axes = panels(figure, len(merits))
        for axes, merit in zip(all_axes, merits, strict=True):
            value = merit.scale * as_floats(columns[merit.column])
            if mapped:
                _map(axes, key, lines, value)
                axes.set_title(merit.title)
                continue
            for number, point in enumerate(lines.points):
                mine = lines.which == number
                cells = [value[mine & (key.which == k)] for k in range(len(key.points))]
                label = f"{named(lines.name)[0]} {plain(point)} {named(lines.name)[1]}".rstrip()
                _means(axes, key, cells, SERIES[number % len(SERIES)], label)
            _finish(axes, key, merit)
        legend(figure, all_axes[:1])

    what, by = named(key.name)[0], named(lines.name)[0]
    caption = (
        f"Figures of merit over {what} and {by}: means over the seeds."
        if mapped
        else f"Figures of merit against {what}, a line per value of {by}: means over the seeds, and one standard "
        "deviation of a run."
    )
    rows = -(-len(merits) // 2)
    return picture(
        f"against-{_file(key)}-and-{_file(lines)}", caption, paint, 0.7 + 2.6 * rows, 1.0 + 2.5 * len(merits)
    )


def _means(axes: Axes, key: Key, cells: Sequence[Floats], colour: str, label: str = "") -> None:
    """Draw the means of the points' runs, with one standard deviation of a run; points without a value are left out."""
    cells = [cell[np.isfinite(cell)] for cell in cells]
    filled = [k for k, cell in enumerate(cells) if cell.size]
    mean = [float(cells[k].mean()) for k in filled]
    spread = [float(cells[k].std(ddof=1)) if cells[k].size > 1 else 0.0 for k in filled]
    # Values that have no order are not joined.
    axes.errorbar(
        key.place[filled],
        mean,
        spread,
        color=colour,
        label=label or None,
        linestyle="-" if key.numeric else "none",
        marker="o",
        capsize=3,
        elinewidth=1.2,
    )


def _finish(axes: Axes, key: Key, merit: Merit) -> None:
    if merit.column == "nees_mean":
        axes.axhline(6, color=GREY, linewidth=1, linestyle=":")
    axes.set_title(merit.title)
    axes.set_xlabel(key.label)
    if key.numeric and key.place[0] > 0 and key.place[-1] / key.place[0] > WIDE:
        axes.set_xscale("log")
    if len(key.points) <= MOST_TICKS:
        axes.set_xticks(key.place, [plain(point) for point in key.points])
        axes.set_xticks([], minor=True)
    if not key.numeric:
        axes.set_xlim(-0.5, len(key.points) - 0.5)
    axes.set_ylim(bottom=0)
    if merit.unit.startswith("%"):
        axes.set_ylim(0, 104)


def _map(axes: Axes, key: Key, other: Key, value: Floats) -> None:
    """Draw the means over the seeds as a map, a cell per point."""
    mean = np.full((len(key.points), len(other.points)), np.nan)
    for k, j in np.ndindex(*mean.shape):
        cell = value[(key.which == k) & (other.which == j)]
        if np.isfinite(cell).any():
            mean[k, j] = np.nanmean(cell)
    value_map(axes, mean)
    for ticks, which in ((axes.set_xticks, key), (axes.set_yticks, other)):
        every = range(0, len(which.points), -(-len(which.points) // MOST_TICKS))
        ticks(list(every), [plain(which.points[k]) for k in every])
    axes.set_xlabel(key.label)
    axes.set_ylabel(other.label)


def _file(key: Key) -> str:
    return key.name.replace(".", "-").replace("[", "-").replace("]", "")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
