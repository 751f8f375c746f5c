"""The figure of a comparison: errors over time, and the share of them below each size, a line per run.

The error is the root mean square over the craft that navigate. A run without truth, such as a replay, has the standard
deviation that its filter believes instead, dashed.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, decade_ticks, plain_log_x, plain_log_y
from swarm.report.figures import SERIES, Picture, legend, panels, picture, thin
from swarm.report.sections.errors import WIDE
from swarm.report.subject import Subject

QUANTITIES = (("position", "m", "mm", 1000.0), ("attitude", "deg", "°", 1.0))
CAPTION = (
    "Root mean square over the craft of the error of the filter's estimate, over time, and the share of the periods in"
    " which it is below a size. Dashed: what the filter believes, in a run without truth."
)


def comparison_picture(subjects: Sequence[Subject], labels: Sequence[str]) -> Picture:
    """Return the figure of runs.

    Args:
        subjects: The runs, each with at least one period.
        labels: The name of each in the legend.
    """

    def paint(figure: Figure) -> None:
        axes = panels(figure, 4)
        for place, (what, unit, shown, scale) in enumerate(QUANTITIES):
            over_time, below = axes[place], axes[2 + place]
            drawn = []
            for i, (subject, label) in enumerate(zip(subjects, labels, strict=True)):
                values, known = errors(subject, what, unit)
                values = scale * values
                style: dict[str, Any] = {"color": SERIES[i % len(SERIES)], "linestyle": "-" if known else "--"}
                time_s = subject.series.time_s
                shown_as = label if known else f"{label}, believed"
                over_time.plot(*thin(time_s - time_s[0], values), label=shown_as, linewidth=1.1, **style)
                drawn.append(values)
                _shares(below, values, style)
            _settle(over_time, np.concatenate(drawn))
            over_time.set_title(f"{what} error [{shown}]")
            over_time.set_xlabel("time since the start [s]")
            below.set_title(f"periods below this {what} error [%]")
            _plain_log(below, np.concatenate(drawn))
            below.set_xlabel(f"{what} error [{shown}]")
        legend(figure, axes[:1])

    return picture("comparison", CAPTION, paint, 6.4, 12.0)


def errors(subject: Subject, what: str, unit: str) -> tuple[Floats, bool]:
    """Return the root mean square over the craft of an error per period, (periods,), and whether truth is known.

    Args:
        subject: The run.
        what: "position" or "attitude".
        unit: Unit in the column's name.
    """
    series = subject.series
    names = [f"{what}_error_{unit}", f"{what}_sigma_{unit}"]
    known = series.has(names[0])
    data = series.of(names[0] if known else names[1])[:, series.navigating]
    there = np.isfinite(data)
    count = there.sum(axis=1)
    square = np.where(there, data, 0.0) ** 2
    return np.where(count > 0, np.sqrt(square.sum(axis=1) / np.maximum(count, 1)), np.nan), known


def _shares(axes: Axes, values: Floats, style: dict[str, Any]) -> None:
    known = np.sort(values[np.isfinite(values)])
    if known.size:
        chosen = np.unique(np.linspace(0, known.size - 1, min(known.size, 400)).round().astype(np.int64))
        axes.plot(known[chosen], 100 * (chosen + 1) / known.size, linewidth=1.4, **style)


def _plain_log(axes: Axes, values: Floats) -> None:
    """Make the axis of sizes logarithmic, with plain numbers."""
    known = values[np.isfinite(values) & (values > 0)]
    if known.size:
        plain_log_x(axes, decade_ticks(float(known.min()), float(known.max())))


def _settle(axes: Axes, values: Floats) -> None:
    """Choose the height of a plot: logarithmic where the runs, or the times of one, are far apart."""
    known = values[np.isfinite(values) & (values > 0)]
    if not known.size:
        return
    low, middle, high = np.quantile(known, [0.01, 0.5, 0.995])
    if high > WIDE * middle or middle > WIDE * low:
        axes.set_ylim(0.7 * float(low), 1.6 * float(known.max()))
        plain_log_y(axes)
    else:
        axes.set_ylim(0, 1.1 * float(known.max()))
