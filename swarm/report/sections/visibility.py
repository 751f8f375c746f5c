"""Photodiodes lit over time, and what the craft know of their pose."""

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, count_map
from swarm.report.figures import Picture, is_narrow, legend, picture, thin
from swarm.report.page import Section
from swarm.report.series import Series
from swarm.report.subject import Subject
from swarm.results.columns.core import STATUS, STATUS_TEXT

STATUS_COLOURS = {
    "tracking": "#9cc4e4",
    "single_sweeps": "#a5c96a",
    "coasting": "#e6a23c",
    "ambiguous": "#7b5ea7",
    "searching": "#c0392b",
}
LABELS = dict(zip(STATUS, STATUS_TEXT, strict=True))
MOST_NAMED = 16


def section(subject: Subject) -> Section | None:
    """Return the section; None where nobody carries a photodiode."""
    if not len(subject.series.lit):
        return None
    left_out = [name for i, name in enumerate(subject.series.names) if i not in subject.series.lit]
    text = []
    if left_out:
        named = ", ".join(left_out[:4]) + (f" and {len(left_out) - 4} more" if len(left_out) > 4 else "")
        text.append(f"Left out, because they do not use the lighthouse: {named}.")
    return Section("Visibility", text, [_picture(subject.series)])


def _picture(series: Series) -> Picture:
    visible = series.of("visible")[:, series.lit]
    names = [series.names[i] for i in series.lit.tolist()]

    def paint(figure: Figure) -> None:
        rows_in = 0.8 + 0.24 * min(len(names), MOST_NAMED)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(rows_in, 0.9))
        extent = (*series.edges_s, len(names) - 0.5, -0.5)
        count_map(above, visible, extent, "photodiodes lit")
        if len(names) <= MOST_NAMED:
            above.set_yticks(range(len(names)), names)
        else:
            above.set_ylabel("craft, by number")
        _status(below, series)
        below.set_ylabel("craft [%]")
        below.set_xlabel("time [s]")
        legend(figure, [below], 2 if is_narrow(figure) else 5)

    caption = "Photodiodes lit by both fans, per craft; below, what the craft know of their pose."
    height_in = 2.8 + 0.24 * min(len(names), MOST_NAMED)
    return picture("visibility", caption, paint, height_in, height_in + 0.2)


def _status(axes: Axes, series: Series) -> None:
    """Draw the shares of the craft by status, on top of each other."""
    bottom: Floats | float = 0.0
    for name, colour in STATUS_COLOURS.items():
        being = series.being("status", name)[:, series.lit]
        time_s, share = thin(series.time_s, 100 * np.mean(being, axis=1))
        if being.any():
            axes.fill_between(time_s, bottom, bottom + share, linewidth=0, label=LABELS[name], color=colour)
        bottom = bottom + share
    axes.set_ylim(0, 100)
