"""The picture of a layout: how its error is distributed over the poses beside the others', and where it sits.

Left: the share of poses whose error is at most e, a line predicted, points by Monte Carlo; a curve ends where the rest
of the poses cannot be solved. Right: the hull in two oblique parallel projections, from the front and from the back.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from estimators.arrays import Floats
from swarm.placement.judgement import Judged
from swarm.placement.prediction import Task
from swarm.world.hull import Hull, Mount

INKS = {"designed": "#0b6e4f", "even": "#c1440e", "shipped": "#3d5a80"}
VIEWS = {"front": (0.55, 0.35, 0.76), "back": (-0.55, 0.35, -0.76)}
"""From the craft towards the viewer, body frame."""


def draw(task: Task, judged: Sequence[Judged], tried: Callable[[Floats], Floats]) -> Figure:
    """The picture of judged layouts, the design first."""
    figure = Figure(figsize=(13, 5), layout="constrained")
    curves, front, back = figure.subplots(1, 3, width_ratios=(1.3, 1, 1))
    _curves(curves, task, judged)
    for axes, (side, towards) in zip((front, back), VIEWS.items(), strict=True):
        _hull(axes, task.hull, judged[0].mount, np.array(towards))
        axes.set_title(f"the design, from the {side}")
    return figure


def _curves(axes: Axes, task: Task, judged: Sequence[Judged]) -> None:
    finite = np.concatenate([j.predicted.error[np.isfinite(j.predicted.error)] for j in judged])
    for each in judged:
        kind = each.name.partition(" ")[0]
        error = np.sort(each.predicted.error)
        share = 100 * np.arange(1, len(error) + 1) / len(error)
        solved = np.isfinite(error)
        if each.measured is None:
            axes.plot(error[solved], share[solved], color=INKS[kind], lw=0.5, alpha=0.4)
            continue
        label = f"{each.name} ({len(each.mount.point_m)}), {100 * each.predicted.unsolvable:.1f} % unsolvable"
        axes.plot(error[solved], share[solved], color=INKS[kind], lw=2, label=label)
        measured = np.sort(each.measured.error)
        at = (np.linspace(0.04, 0.98, 24) * len(measured)).astype(np.int64)
        known = at[np.isfinite(measured[at])]
        axes.plot(measured[known], 100 * (known + 1) / len(measured), "o", color=INKS[kind], ms=4, mfc="white")
    axes.axhline(100 * task.share, color="0.4", lw=0.8, ls="--")
    axes.set_xscale("log")
    axes.set_xlim(0.8 * np.quantile(finite, 0.001), 1.3 * np.quantile(finite, 0.995))
    axes.set_ylim(0, 100)
    axes.set_xlabel(
        f"error e of the pose (1: {np.degrees(task.mix.attitude_rad):g}° or {1e3 * task.mix.position_m:g} mm, 1 sigma)"
    )
    axes.set_ylabel("poses with at most this error, %")
    axes.set_title("predicted (lines) and by Monte Carlo (points)")
    axes.legend(loc="lower right", fontsize=8, frameon=False)


def _hull(axes: Axes, hull: Hull, mount: Mount, towards: Floats) -> None:
    """The surface's triangles that face the viewer, the farthest first, and the photodiodes that nothing hides."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(towards, right)])
    corner = np.concatenate([part.mesh.vertex[part.mesh.face] for part in hull.visuals])
    colour = np.concatenate([np.tile(part.rgba[:3], (len(part.mesh.face), 1)) for part in hull.visuals])
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    facing = normal @ towards > 0
    order = np.argsort((corner.mean(axis=1) @ towards)[facing])
    # Light from beside the viewer's head tells the faces apart.
    light = towards + 0.5 * right + 0.4 * screen[1]
    shade = 0.5 + 0.5 * np.clip(normal @ (light / np.linalg.norm(light)), 0, 1)
    shaded = (colour * shade[:, None])[facing][order]
    axes.add_collection(
        PolyCollection((corner @ screen.T)[facing][order], facecolors=shaded, edgecolors=shaded, lw=0.6)
    )
    lifted = mount.point_m + 1e-4 * mount.normal
    seen = (mount.normal @ towards > 0) & hull.clear(lifted, towards)
    flat = mount.point_m @ screen.T
    axes.plot(*flat[seen].T, "o", color="#b01e28", ms=7, mec="white")
    for number in np.flatnonzero(seen):
        axes.annotate(str(number), flat[number], xytext=(5, 5), textcoords="offset points", fontsize=8)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set_axis_off()
