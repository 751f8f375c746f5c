"""The smoothed estimate: the errors before and after, over time; in a replay what has changed."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import quaternion_multiply
from swarm.figures import Axes, Figure
from swarm.report.figures import BLUE, GREY, ORANGE, Picture, is_narrow, legend, panels, picture, thin
from swarm.report.findings import scatter_is_noise
from swarm.report.numbers import number
from swarm.report.page import Fact, Section, prose
from swarm.report.sections.errors import chosen, settle
from swarm.report.series import Series
from swarm.report.subject import Subject

_KINDS = (("position", "m", 1000.0, "position [mm]"), ("attitude", "deg", 1.0, "attitude [°]"))
"""Kind of error, unit of its columns, factor, and label."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where nothing was smoothed."""
    if not subject.series.has("smooth_px_m"):
        return None
    return Section("Smoothed", prose("run.txt.j2", "smoothed"), [_picture(subject.series)])


def facts(swarm: Mapping[str, Any]) -> list[Fact]:
    """Return the gain of the smoother, against the truth or, in a replay at rest, in scatter."""
    ratios = [swarm.get(f"smooth_to_ekf_{what}_ratio") for what in ("position", "attitude")]
    gains = [number(1 / ratio) for ratio in ratios if ratio]
    if len(gains) == 2:
        position, attitude = gains
        return [Fact("Smoothed", f"{position} times", f"below the filter's position error; attitude {attitude} times")]
    before, after = (swarm.get(f"{source}_position_scatter_mm") for source in ("ekf", "smooth"))
    if not before or not after or not scatter_is_noise(before, after):
        return []
    return [Fact("Scatter, smoothed", f"{number(after)} mm", f"of the filter's positions {number(before)} mm")]


def _picture(series: Series) -> Picture:
    craft, truth = chosen(series, "smooth_px_m"), series.has("smooth_position_error_m")

    def paint(figure: Figure) -> None:
        axes = panels(figure, 2 * len(craft), sharex=True)
        for place, (i, kind) in enumerate((i, kind) for i in craft for kind in _KINDS):
            _draw(axes[place], series, i, kind, truth)
        for last in axes[-1:] if is_narrow(figure) else axes[-2:]:
            last.set_xlabel("time [s]")
        legend(figure, axes[:1])

    caption = "Errors of the filter's estimate and of the smoothed one, over time."
    if not truth:
        caption = "Distance and angle from the filter's estimate to the smoothed one, over time."
    return picture("smoothed", caption, paint, 0.9 + 1.75 * len(craft), 0.9 + 3.2 * len(craft))


def _draw(axes: Axes, series: Series, craft: int, what: tuple[str, str, float, str], truth: bool) -> None:
    kind, unit, scale, label = what
    sigma = 3 * scale * series.of(f"smooth_{kind}_sigma_{unit}")[:, craft]
    if truth:
        before = scale * series.of(f"{kind}_error_{unit}")[:, craft]
        after = scale * series.of(f"smooth_{kind}_error_{unit}")[:, craft]
        lines = [(before, GREY, "filter"), (after, BLUE, "smoothed")]
    else:
        before = scale * _changes(series, craft)[kind]
        lines = [(before, BLUE, "from filter to smoothed")]
    for value, colour, name in lines:
        axes.plot(*thin(series.time_s, value, peaks=True), color=colour, linewidth=0.9, label=name)
    axes.plot(*thin(series.time_s, sigma), color=ORANGE, linewidth=1.4, label="3σ, smoothed")
    axes.set_title(f"{series.names[craft]}: {label}")
    settle(axes, before, sigma)


def _changes(series: Series, craft: int) -> dict[str, Floats]:
    """Return distance [m] and angle [deg] between the filter's and the smoothed estimate of one craft, (periods,)."""

    def stacked(prefix: str, names: tuple[str, ...]) -> Floats:
        return np.stack([series.of(f"{prefix}_{name}")[:, craft] for name in names], axis=1)

    place, turn = ("px_m", "py_m", "pz_m"), ("qw", "qx", "qy", "qz")
    distance = np.linalg.norm(stacked("smooth", place) - stacked("ekf", place), axis=1)
    back = stacked("ekf", turn) * np.array([1.0, -1.0, -1.0, -1.0])
    between = quaternion_multiply(stacked("smooth", turn), back)
    angle = 2 * np.arctan2(np.linalg.norm(between[:, 1:], axis=1), np.abs(between[:, 0]))
    return {"position": distance, "attitude": np.degrees(angle)}
