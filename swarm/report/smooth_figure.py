"""The figure of a run that was smoothed: the errors before and after, over time; in a replay what has changed."""

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import quaternion_multiply
from swarm.figures import Figure
from swarm.report.figures import BLUE, GREY, ORANGE, Picture, picture, thin
from swarm.report.run_figures import Series, chosen_of, settle

_KINDS = (("position", "m", 1000.0, "position [mm]"), ("attitude", "deg", 1.0, "attitude [°]"))
"""Kind of error, unit of its columns, factor, and label."""


def is_smoothed(series: Series) -> bool:
    """Return whether the run has smoothed estimates."""
    return series.has("smooth_px_m") and bool(np.isfinite(series.of("smooth_px_m")).any())


def smoothed(series: Series) -> Picture:
    """Draw the errors of filter and smoother of some craft over time."""
    chosen, truth = chosen_of(series), bool(np.isfinite(series.of("smooth_position_error_m")).any())

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(chosen), 2, sharex=True, squeeze=False)
        for row, craft in zip(grid, chosen, strict=True):
            for axes, (kind, unit, scale, label) in zip(row, _KINDS, strict=True):
                lines: list[tuple[Floats, str, str]]
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
                axes.plot(*thin(series.time_s, sigma), color=ORANGE, linewidth=1.4, label="3 sigma, smoothed")
                axes.set_title(f"{series.names[craft]}: {label}")
                settle(axes, before, sigma)
        grid[0][0].legend(loc="upper right", ncols=3, fontsize=8)
        for axes in grid[-1]:
            axes.set_xlabel("time [s]")

    caption = "Errors of the filter's estimate and of the smoothed one, over time."
    if not truth:
        caption = "Distance and angle from the filter's estimate to the smoothed one, over time."
    return picture("smoothed", caption, paint, 0.6 + 1.75 * len(chosen))


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
