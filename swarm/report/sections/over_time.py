"""Common parts of figures over time: lines of a few craft or the spread of many, and marks of faults."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import Axes
from swarm.report.figures import BLUE, RED, SERIES, thin
from swarm.report.series import Series
from swarm.report.subject import Strike

MOST_LINES = 10
"""Up to so many craft have a line each."""
MOST_NUMBERED = 14
"""Up to so many faults have their numbers above the axes."""


def lines(axes: Axes, series: Series, data: Floats, craft: Ints, peaks: bool = False) -> None:
    """Draw a line per craft if they are few, else the median and the middle 90 % over them.

    Args:
        axes: Where to draw.
        series: The run.
        data: Values (periods, all craft).
        craft: Indices of the craft that are drawn.
        peaks: In a long series keep the largest of neighbouring values instead of their mean.
    """
    if len(craft) <= MOST_LINES:
        for i in craft.tolist():
            x, y = thin(series.time_s, data[:, i], peaks)
            axes.plot(x, y, color=colour_of(i), linewidth=1.1, label=series.names[i])
        return
    data = data[:, craft]
    known = np.isfinite(data).any(axis=1)
    low, middle, high = np.full((3, len(data)), np.nan)
    low[known], middle[known], high[known] = np.nanquantile(data[known], [0.05, 0.5, 0.95], axis=1)
    axes.fill_between(series.time_s, low, high, color=BLUE, alpha=0.2, linewidth=0, label="middle 90 % of the craft")
    axes.plot(series.time_s, middle, color=BLUE, linewidth=1.2, label="median craft")


def colour_of(craft: int) -> str:
    """Return the colour of a craft, the same in all figures."""
    return SERIES[craft % len(SERIES)]


def mark(axes: Axes, strikes: Sequence[Strike], craft: int | None = None) -> None:
    """Mark the beginning of faults by their numbers in the table of faults; of one craft, shade their time too.

    Args:
        axes: Where to draw.
        strikes: The faults.
        craft: Mark only those of this craft; None: all.
    """
    mine = [strike for strike in strikes if craft is None or strike.strikes(craft)]
    for strike in mine:
        if craft is not None:  # those of all craft lie on top of each other
            axes.axvspan(strike.from_s, strike.to_s, color=RED, alpha=0.09, linewidth=0)
        axes.axvline(strike.from_s, color=RED, alpha=0.5, linewidth=0.8)
    if len(mine) <= MOST_NUMBERED:
        for strike in mine:
            axes.annotate(
                str(strike.number),
                (strike.from_s, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(2, -9),
                textcoords="offset points",
                fontsize=8,
                color=RED,
                annotation_clip=True,
            )
