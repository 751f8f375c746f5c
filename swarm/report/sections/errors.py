"""The errors of the filter's estimate against its own 3 sigma, over time."""

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, plain_log_y
from swarm.report.figures import BLUE, ORANGE, Picture, is_narrow, legend, panels, picture, thin
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import mark
from swarm.report.series import Series
from swarm.report.subject import Subject

MOST_CRAFT = 4
WIDE = 15.0
"""Errors so many times the usual ones, as after a time in the dark, are drawn on a logarithmic axis."""
QUANTITIES = (
    ("position_error_m", "position_sigma_m", 1000.0, "position [mm]"),
    ("attitude_error_deg", "attitude_sigma_deg", 1.0, "attitude [°]"),
)
"""Columns of error and sigma, factor, and label."""


def section(subject: Subject) -> Section | None:
    """Return the section, for a run with a truth."""
    craft = chosen(subject.series)
    if not craft:
        return None
    text = prose("run.txt.j2", "error")
    count = len(subject.series.navigating)
    if count > MOST_CRAFT:
        text += prose("run.txt.j2", "which", craft=count)
    if any(strike.strikes(i) for strike in subject.strikes for i in craft):
        text += prose("run.txt.j2", "marks")
    return Section("Error against what the filter believes", text, [_picture(subject, craft)])


def chosen(series: Series, column: str = "position_error_m") -> list[int]:
    """Return the craft with values in a column: all if few, else evenly from the best to the worst by RMS error."""
    error = series.of("position_error_m")
    known = np.isfinite(error)
    told = np.asarray(np.isfinite(series.of(column)).any(axis=0))
    craft = [i for i in series.navigating.tolist() if told[i]]
    if len(craft) <= MOST_CRAFT:
        return craft
    square = np.where(known, error, 0.0) ** 2
    rms = np.sqrt(square.sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    order = sorted(craft, key=lambda i: float(rms[i]))
    return [order[int(i)] for i in np.linspace(0, len(order) - 1, MOST_CRAFT).round()]


def _picture(subject: Subject, craft: list[int]) -> Picture:
    def paint(figure: Figure) -> None:
        axes = panels(figure, 2 * len(craft), sharex=True)
        for place, (i, quantity) in enumerate((i, quantity) for i in craft for quantity in QUANTITIES):
            _draw(axes[place], subject, i, quantity)
        for last in axes[-1:] if is_narrow(figure) else axes[-2:]:
            last.set_xlabel("time [s]")
        legend(figure, axes[:1])

    caption = "Error of the filter's estimate and its 3 sigma, over time."
    return picture("error", caption, paint, 0.9 + 1.75 * len(craft), 0.9 + 3.2 * len(craft))


def _draw(axes: Axes, subject: Subject, i: int, quantity: tuple[str, str, float, str]) -> None:
    error, sigma, scale, label = quantity
    series = subject.series
    wrong, believed = scale * series.of(error)[:, i], 3 * scale * series.of(sigma)[:, i]
    mark(axes, subject.strikes, i)
    axes.plot(*thin(series.time_s, wrong, peaks=True), color=BLUE, linewidth=0.9, label="error")
    axes.plot(*thin(series.time_s, believed), color=ORANGE, linewidth=1.4, label="3σ that the filter believes")
    axes.set_title(f"{series.names[i]}: {label}")
    settle(axes, wrong, believed)


def settle(axes: Axes, wrong: Floats, believed: Floats) -> None:
    """Choose the height of a plot of errors and 3 sigma.

    Args:
        axes: The plot.
        wrong: Errors (n,).
        believed: The 3 sigma (n,).
    """
    # The start, when a craft has only just found itself, must not flatten the rest.
    top, middle = max(_quantile(believed, 0.97), _quantile(wrong, 0.999)), _quantile(believed, 0.5)
    if top > WIDE * middle > 0:
        axes.set_ylim(max(_quantile(wrong, 0.02), 1e-4 * top), 1.5 * top)
        plain_log_y(axes)
    elif top > 0:
        axes.set_ylim(0, 1.15 * top)


def _quantile(values: Floats, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if known.size else 0.0
