"""The picture of a placement: its errors over the poses beside the others', and where the stations stand.

Left: the share of poses whose position error is at most so much, dashed with the station lost that is missed most; a
curve ends where the rest of the poses is undecided. Right: the poses, coloured by their position error, and the
stations with the edges of their fields, in two parallel projections along the world's axes.
"""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from swarm.figures import BLUE, GREEN, GREY, VERMILLION, Axes, Figure, legend, page, plain_log_x, value_points
from swarm.studies.design.poses import Poses
from swarm.studies.placement.candidates import Stand
from swarm.studies.placement.judgement import Judged
from swarm.studies.placement.task import Task

INKS = (GREEN, VERMILLION, BLUE)
TICKS = [m * 10.0**k for k in range(-4, 5) for m in (1, 3)]
ARROW = 0.15
"""Length of the lines of a station, of the picture's larger side."""
SHOWN = 800
"""Poses that are drawn."""


def draw(task: Task, judged: Sequence[Judged], poses: Poses, stands: Sequence[Stand]) -> Figure:
    """Draw a placement.

    Args:
        task: the task.
        judged: the placement, then others.
        poses: the poses at which they were judged.
        stands: the new stations.
    """
    figure, axes = page(1, 3, 4.0, 12.0)
    _curves(axes[0, 0], task, judged)
    up = int(np.argmax(np.abs(task.site.up)))
    across, along = (i for i in range(3) if i != up)
    _plan(axes[0, 1], task, judged[0], poses, (across, along))
    axes[0, 1].set_title("seen along the axis that is up", fontsize=9)
    _plan(axes[0, 2], task, judged[0], poses, (across, up))
    axes[0, 2].set_title(f"seen along {'xyz'[along]}", fontsize=9)
    if task.site.up.sum() < 0:
        axes[0, 2].invert_yaxis()
    return figure


def _curves(axes: Axes, task: Task, judged: Sequence[Judged]) -> None:
    finite = [np.empty(0)]
    for each, ink in zip(judged, INKS, strict=False):
        for error, style, label in (
            (each.position_m, "-", f"{each.name}: {100 * each.decided:.1f} % decided"),
            (each.lost_position_m, "--", None),
        ):
            if error is None:
                continue
            ordered = 1e3 * np.sort(error)
            share = 100 * np.arange(1, len(error) + 1) / len(error)
            known = np.isfinite(ordered)
            axes.plot(ordered[known], share[known], color=ink, lw=1.5, ls=style, label=label)
            finite.append(ordered[known])
    axes.axhline(100 * task.share, color=GREY, lw=0.8, ls=":")
    plain_log_x(axes, TICKS)
    every = np.concatenate(finite)
    axes.set_xlim(0.8 * np.quantile(every, 0.001), 1.3 * np.quantile(every, 0.99))
    axes.set_ylim(0, 101)
    axes.set_xlabel("position error of a pose, 1 sigma [mm]")
    axes.set_ylabel("poses with at most this error, %")
    axes.set_title("error over the poses, one period\ndashed: with the worst station lost", fontsize=9)
    legend(axes)


def _plan(axes: Axes, task: Task, judged: Judged, poses: Poses, which: tuple[int, int]) -> None:
    """Draw poses and stations in the plane of two of the world's axes."""
    shown = slice(None, None, max(1, len(poses.position) // SHOWN))
    place = poses.position[shown][:, which]
    error = 1e3 * judged.position_m[shown]
    known = np.isfinite(error)
    axes.plot(*place[~known].T, "x", color=VERMILLION, ms=3)
    value_points(axes, place[known], error[known], "position error [mm]")
    every = np.concatenate([place, np.array([station.position for station in judged.stations])[:, which]])
    length = ARROW * max(float(np.ptp(every, axis=0).max()), 0.1)
    half = np.radians(task.table.field_deg) / 2
    for i, station in enumerate(judged.stations):
        start = station.position[list(which)]
        right, _, ahead = station.rotation.T
        for angle, width in ((-half, 0.6), (0.0, 1.4), (half, 0.6)):
            end = start + length * (np.cos(angle) * ahead + np.sin(angle) * right)[list(which)]
            axes.plot(*np.stack([start, end]).T, color=GREY if i < len(task.fixed) else BLUE, lw=width)
        axes.plot(*start, "s", color=GREY if i < len(task.fixed) else BLUE, ms=6)
        axes.annotate(str(i), (float(start[0]), float(start[1])), xytext=(5, 5), textcoords="offset points", fontsize=8)
    for corners in _outlines(task, which):
        axes.plot(*corners.T, color=GREY, lw=0.8)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'xyz'[which[0]]} [m]")
    axes.set_ylabel(f"{'xyz'[which[1]]} [m]")


def _outlines(task: Task, which: tuple[int, int]) -> list[Floats]:
    """Return the outlines (n, 2) of the surfaces that stations may stand on, in the plane of two axes."""
    out = []
    for surface in task.site.surfaces:
        if surface.radius_m:
            turn = np.linspace(0, 2 * np.pi, 73)
            circle = np.column_stack([np.cos(turn), np.sin(turn)])
            out.append(surface.corner[list(which)] + surface.radius_m * circle)
        else:
            corner, (u, v) = surface.corner, surface.sides
            ring = np.array([corner, corner + u, corner + u + v, corner + v, corner])
            out.append(ring[:, which])
    return out
