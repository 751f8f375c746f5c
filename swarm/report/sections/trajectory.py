"""The paths of the craft, from above and from the side."""

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import Axes, Figure, strips
from swarm.report.figures import BLUE, GREY, legend, panels, picture
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import MOST_LINES, colour_of
from swarm.report.subject import Subject

MOST_POINTS, MOST_POINTS_OF_MANY = 1000, 60
"""Points of a path, and of one of many."""
STILL_SHARE = 0.01
"""A path shorter than this share of the scene is a place."""
VIEWS = (("from above", 2, 0, "z, away from the lighthouse [m]", "x, right [m]"),
         ("from the right", 2, 1, "z, away from the lighthouse [m]", "y, down [m]"))  # fmt: skip
"""Title, axis to the right and axis downwards, and their labels."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no place is known."""
    series = subject.series
    at = series.position("ekf" if series.replayed else "true")
    craft = np.flatnonzero(np.isfinite(at).all(axis=2).any(axis=0))
    if not len(craft):
        return None

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(VIEWS))
        for one, (title, right, down, label, below) in zip(axes, VIEWS, strict=True):
            _draw(one, series.names, at[..., [right, down]], craft)
            one.set_title(title)
            one.set_xlabel(label)
            one.set_ylabel(below)
        legend(figure, axes[:1])

    text = prose("run.txt.j2", "trajectory", replayed=series.replayed)
    caption = "The paths of the craft: a ring where each begins, a dot where it ends."
    return Section("Trajectory", text, [picture("trajectory", caption, paint, 3.9, 7.2)])


def _draw(axes: Axes, names: list[str], at: Floats, craft: Ints) -> None:
    axes.plot([0], [0], marker="<", color="black", markersize=8, linestyle="none", label="lighthouse")
    known = at[:, craft]
    if len(craft) > MOST_LINES:
        step = max(1, len(at) // MOST_POINTS_OF_MANY)
        strips(axes, np.swapaxes(known[::step], 0, 1), BLUE, "craft")
        ends = np.stack([_end(known[:, i]) for i in range(len(craft))])
        axes.plot(ends[:, 0], ends[:, 1], ".", color=BLUE, markersize=3, rasterized=True)
    else:
        scene_m = float(np.nanmax(np.abs(known)))
        step = max(1, len(at) // MOST_POINTS)
        for i in craft.tolist():
            path = at[np.isfinite(at[:, i]).all(axis=1), i]
            colour = colour_of(i)
            moved = float(np.ptp(path, axis=0).max()) > STILL_SHARE * scene_m
            axes.plot(*path[::step].T, color=colour, linewidth=1.4, label=None if not moved else names[i])
            if moved:
                axes.plot(*path[0], "o", color=colour, markerfacecolor="white", markersize=5)
            axes.plot(*path[-1], "o" if moved else "s", color=colour, markersize=4, linestyle="none",
                      label=None if moved else names[i])  # fmt: skip
    axes.axhline(0, color=GREY, linewidth=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()


def _end(path: Floats) -> Floats:
    known = path[np.isfinite(path).all(axis=1)]
    out: Floats = known[-1]
    return out
