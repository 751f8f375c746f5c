"""The filter's consistency: NEES over time."""

import numpy as np
from scipy.special import gammaincinv

from estimators.arrays import Floats
from swarm.figures import Figure, plain_log_y
from swarm.report.figures import BLUE, GREY, ORANGE, Picture, legend, picture
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import mark
from swarm.report.subject import Subject
from swarm.results.summary.chi_square import DOF

MOST_DOTS = 20_000


def section(subject: Subject) -> Section | None:
    """Return the section, for a run with a truth."""
    series = subject.series
    if not np.isfinite(series.of("nees")[:, series.navigating]).any():
        return None
    return Section("Consistency", prose("run.txt.j2", "consistency"), [_picture(subject)])


def _picture(subject: Subject) -> Picture:
    series = subject.series
    nees = series.of("nees")[:, series.navigating]
    # As chi2.ppf, whose module takes a second to import.
    low, high = 2 * gammaincinv(DOF / 2, np.array([0.025, 0.975]))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        mark(axes, subject.strikes)
        axes.axhspan(low, high, color=GREY, alpha=0.14, linewidth=0, label="95 % of a craft's values")
        time, value = (part.ravel() for part in np.broadcast_arrays(series.time_s[:, None], nees))
        every = -(-len(value) // MOST_DOTS)
        axes.plot(
            time[::every], value[::every], ".", color=BLUE, alpha=0.25, markersize=3, markeredgewidth=0, rasterized=True
        )
        axes.plot(*running_mean(series.time_s, nees), color=ORANGE, label="mean over the craft and one second")
        axes.axhline(DOF, color=GREY, linewidth=1, linestyle=":")
        plain_log_y(axes)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("NEES")
        legend(figure)

    return picture("nees", "NEES over time: a dot per craft and period, thinned in a large swarm.", paint)


def running_mean(time_s: Floats, data: Floats, over_s: float = 1.0) -> tuple[Floats, Floats]:
    """Return the mean over the craft and over windows of time.

    Args:
        time_s: Times (n,) [s].
        data: Values (n, craft), NaN where missing.
        over_s: Length of a window [s].
    """
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else over_s
    step = step if step > 0 else over_s
    window = np.ones(max(1, min(round(over_s / step), len(time_s))))
    known = np.isfinite(data)
    total = np.convolve(np.where(known, data, 0.0).sum(axis=1), window, "valid")
    count = np.convolve(known.sum(axis=1).astype(np.float64), window, "valid")
    centre = np.convolve(time_s, window / len(window), "valid")
    return centre, np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
