"""The paths of the craft, from above and from the side, with the lighthouse or the stations that stand there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import Axes, Figure, strips
from swarm.report.figures import BLUE, GREY, legend, panels, picture
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import MOST_LINES, colour_of
from swarm.report.subject import Subject
from swarm.results.replayed import read_replayed

MOST_POINTS, MOST_POINTS_OF_MANY = 1000, 60
"""Points of a path, and of one of many."""
STILL_SHARE = 0.01
"""A path shorter than this share of the scene is a place."""


class View(NamedTuple):
    """One view: its title, the axes to the right and down (or up), and their labels."""

    title: str
    right: int
    other: int
    label: str
    beside: str
    down: bool = True


LIGHTHOUSE = (View("from above", 2, 0, "z, away from the lighthouse [m]", "x, right [m]"),
              View("from the right", 2, 1, "z, away from the lighthouse [m]", "y, down [m]"))  # fmt: skip
"""Views of the lighthouse's frame."""
WORLD = {
    "-y": (View("from above", 2, 0, "z [m]", "x [m]"), View("from the side", 2, 1, "z [m]", "y, down [m]")),
    "z": (
        View("from above", 0, 1, "x [m]", "y [m]", down=False),
        View("from the side", 0, 2, "x [m]", "z, up [m]", down=False),
    ),
}
"""Views of a world in which stations stand, by its axis that points up."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no place is known."""
    series = subject.series
    at = series.position("ekf" if series.replayed else "true")
    craft = np.flatnonzero(np.isfinite(at).all(axis=2).any(axis=0))
    if not len(craft):
        return None

    stations, up = _stations(subject)
    views = LIGHTHOUSE if stations is None else WORLD[up]

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(views))
        for one, view in zip(axes, views, strict=True):
            plane = [view.right, view.other]
            _light(one, None if stations is None else stations[:, plane])
            _draw(one, series.names, at[..., plane], craft)
            one.set_title(view.title)
            one.set_xlabel(view.label)
            one.set_ylabel(view.beside)
            if view.down:
                one.invert_yaxis()
        legend(figure, axes[:1])

    text = prose("run.txt.j2", "trajectory", replayed=series.replayed, stations=stations is not None)
    caption = "The paths of the craft: a ring where each begins, a dot where it ends."
    return Section("Trajectory", text, [picture("trajectory", caption, paint, 3.9, 7.2)])


def _stations(subject: Subject) -> tuple[Floats | None, str]:
    """Return the places of the stations that stand in the world (S, 3) [m], and its axis that points up.

    None where there is the one lighthouse, or one station, at the origin.
    """
    if (replayed := read_replayed(subject.run.folder)) is not None:
        places = np.array([station.position for station in replayed.stations]).reshape(-1, 3)
        return (places if len(places) else None), replayed.up if replayed.up in WORLD else "-y"
    tables = subject.scenario.get("station") or ()
    if not tables:
        return None, "-y"
    try:
        standing = [table.get("position_m", (0.0, 0.0, 0.0)) for table in tables if not table.get("craft")]
        places = np.array(standing, dtype=np.float64).reshape(-1, 3)
        up = subject.scenario.get("recording", {}).get("up", "-y")
    except (AttributeError, TypeError, ValueError):
        # The scenario was edited after the flight.
        return np.empty((0, 3)), "-y"
    return places, up if up in WORLD else "-y"


def _light(axes: Axes, stations: Floats | None) -> None:
    """Draw the lighthouse at the origin, or stations at places (S, 2) [m]."""
    if stations is None:
        axes.plot([0], [0], marker="<", color="black", markersize=8, linestyle="none", label="lighthouse")
        axes.axhline(0, color=GREY, linewidth=0.6)
    elif len(stations):
        axes.plot(*stations.T, marker="d", color="black", markersize=7, linestyle="none", label="station")


def _draw(axes: Axes, names: Sequence[str], at: Floats, craft: Ints) -> None:
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
    axes.set_aspect("equal", adjustable="datalim")


def _end(path: Floats) -> Floats:
    known = path[np.isfinite(path).all(axis=1)]
    out: Floats = known[-1]
    return out
