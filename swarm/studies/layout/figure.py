"""The picture of a layout: how its error is distributed over the poses beside the others', and where it sits.

Left: the share of poses whose error is at most e, a line predicted, points by Monte Carlo; a curve ends where the rest
of the poses cannot be solved. Right: the hull in two oblique parallel projections, from the front and from the back.
"""

from collections.abc import Callable, Sequence

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import BLUE, GREEN, GREY, VERMILLION, Axes, Figure, legend, page, plain_log_x, polygons
from swarm.studies.layout.judgement import Judged
from swarm.studies.layout.prediction import Task
from swarm.world.hull import Hull, Mount

INKS = {"designed": GREEN, "even": VERMILLION, "shipped": BLUE}
VIEWS = {"front": (0.55, 0.35, 0.76), "back": (-0.55, 0.35, -0.76)}
"""From the craft towards the viewer, body frame."""
FINEST = 1 / 15
"""Triangles are drawn in pieces smaller than this share of the hull: sorted by distance, they hide what is hidden."""
CLUSTER = 0.06
"""Photodiodes nearer to each other than this share of the layout's width are numbered together."""
TICKS = [m * 10.0**k for k in range(-4, 4) for m in (1, 2, 5)]


def draw(task: Task, judged: Sequence[Judged], tried: Callable[[Floats], Floats]) -> Figure:
    """Draw judged layouts.

    Args:
        task: What the layouts are for.
        judged: The layouts, the design first.
        tried: Function that picks an error's values at the poses that were measured.
    """
    figure, axes = page(1, 3, 3.9, 11.0)
    _curves(axes[0, 0], task, judged)
    for each, (side, towards) in zip(axes[0, 1:], VIEWS.items(), strict=True):
        _hull(each, task.hull, judged[0].mount, np.array(towards))
        each.set_title(f"the design, from the {side}", fontsize=9)
    return figure


def _curves(axes: Axes, task: Task, judged: Sequence[Judged]) -> None:
    finite = np.concatenate([each.predicted.error[np.isfinite(each.predicted.error)] for each in judged])
    for each in judged:
        ink = INKS[each.name.partition(" ")[0]]
        error = np.sort(each.predicted.error)
        share = 100 * np.arange(1, len(error) + 1) / len(error)
        solved = np.isfinite(error)
        if each.measured is None:
            axes.plot(error[solved], share[solved], color=ink, lw=0.4, alpha=0.4)
            continue
        label = f"{each.name}, {len(each.mount.point_m)}:\n{100 * each.predicted.unsolvable:.1f} % unsolvable"
        axes.plot(error[solved], share[solved], color=ink, lw=1.6, label=label)
        measured = np.sort(each.measured.error)
        at = (np.linspace(0.04, 0.98, 24) * len(measured)).astype(np.int64)
        known = at[np.isfinite(measured[at])]
        axes.plot(measured[known], 100 * (known + 1) / len(measured), "o", color=ink, ms=3, mfc="white")
    axes.axhline(100 * task.share, color=GREY, lw=0.8, ls="--")
    plain_log_x(axes, TICKS)
    axes.set_xlim(0.8 * np.quantile(finite, 0.001), 1.3 * np.quantile(finite, 0.995))
    axes.set_ylim(0, 100)
    one = f"{np.degrees(task.mix.attitude_rad):g}° or {1e3 * task.mix.position_m:g} mm, 1 sigma"
    axes.set_xlabel(f"error e of a pose\n1 is {one}")
    axes.set_ylabel("poses with at most this error, %")
    axes.set_title("error over the poses\nlines predicted, points Monte Carlo,\nthin: other even spreads", fontsize=9)
    legend(axes, place="lower right")


def _hull(axes: Axes, hull: Hull, mount: Mount, towards: Floats) -> None:
    """Draw the hull's triangles that face the viewer, the farthest first, and the photodiodes that nothing hides."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(towards, right)])
    corner, colour = _pieces(hull)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    facing = normal @ towards > 0
    order = np.argsort((corner.mean(axis=1) @ towards)[facing])
    # Light from beside the viewer's head tells the faces apart.
    light = towards + 0.5 * right + 0.4 * screen[1]
    shade = 0.5 + 0.5 * np.clip(normal @ (light / np.linalg.norm(light)), 0, 1)
    shaded = (colour * shade[:, None])[facing][order]
    drawn = (corner @ screen.T)[facing][order]
    polygons(axes, drawn, shaded)
    seen = (mount.normal @ towards > 0) & hull.clear(mount.point_m, towards)
    flat = mount.point_m @ screen.T
    axes.plot(*flat[seen].T, "o", color="#b01e28", ms=5, mec="white")
    for together in _clusters(flat, np.flatnonzero(seen), CLUSTER * float(np.ptp(flat, axis=0).max())):
        told = ", ".join(str(number) for number in together)
        axes.annotate(told, flat[together[0]], xytext=(4, 3), textcoords="offset points", fontsize=7)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set_axis_off()


def _clusters(point: Floats, which: Ints, near: float) -> list[list[int]]:
    """Return the points (N, 2) among `which` in groups, those nearer than `near` to the first of a group together."""
    out: list[list[int]] = []
    for number in which.tolist():
        group = next((g for g in out if float(np.linalg.norm(point[g[0]] - point[number])) < near), None)
        if group is None:
            out.append([number])
        else:
            group.append(number)
    return out


def _pieces(hull: Hull) -> tuple[Floats, Floats]:
    """Return the surface's triangles (N, 3, 3), halved until they are small, and their colours (N, 3)."""
    corner = np.concatenate([part.mesh.vertex[part.mesh.face] for part in hull.visuals])
    colour = np.concatenate([np.tile(part.rgba[:3], (len(part.mesh.face), 1)) for part in hull.visuals])
    largest = FINEST * float(np.ptp(corner.reshape(-1, 3), axis=0).max())
    while True:
        edge = np.linalg.norm(np.roll(corner, -1, axis=1) - corner, axis=2)
        big = edge.max(axis=1) > largest
        if not big.any():
            return corner, colour
        # Across the longest edge: the triangle is turned until that is the first.
        turn = (np.argmax(edge[big], axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corner[big], turn[:, :, None], axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        halves = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        corner = np.concatenate([corner[~big], halves])
        colour = np.concatenate([colour[~big], np.tile(colour[big], (2, 1))])
