"""Source 2, figure 4: light 1 is 1 mm from where the craft believes it to be; the images are exact.

The closed form trusts every light alike, wherever it is: its error is a constant of the marker, turned by the attitude,
and does not depend on the distance. The fit to the images (`estimators.stereo.cameras`), which trusts directions more
than depths, does not have this property; it is shown beside, at every 16th pose.
"""

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats
from estimators.stereo.cameras import refine_cameras
from estimators.stereo.closed_form import stereo_pose
from swarm import figures
from swarm.figures import Figure
from swarm.studies.papers import stereo
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of
from swarm.studies.papers.stereo import Poses

MISPLACED_M = 1e-3
AXES = ("x, outward", "y, along the circle", "z, out of its plane")
WITHIN = 0.05
EVERY = 16


def run(request: Request) -> Outcome:
    """Move light 1 along each of the marker's axes, and solve every pose with the marker as drawn."""
    poses = stereo.draw_poses(request.sizes["poses"], np.random.default_rng(request.seed))
    few = Poses(*(part[::EVERY] for part in poses))
    rig, lines = stereo.rig(), list[Line]()
    largest: list[Floats] = []
    fitted: list[Floats] = []
    for axis, name in enumerate(AXES):
        true = stereo.MARKER_M.copy()
        true[0, axis] += MISPLACED_M
        uv = stereo.images(poses, true, rig)
        closed = stereo_pose(uv, stereo.all_seen(uv), stereo.MARKER_M, rig)
        largest.append(_by_metre(poses, stereo.errors(poses, closed.rotation, closed.position)))
        uv = stereo.images(few, true, rig)
        fit = refine_cameras(uv, stereo.all_seen(uv), stereo.MARKER_M, rig, few.rotation, few.position).pose
        fitted.append(_by_metre(few, stereo.errors(few, fit.rotation, fit.position)))
        request.progress((axis + 1) / len(AXES), f"light 1 moved along {name}")
        group = f"Light 1 off by 1 mm along {name}"
        position, attitude = largest[-1][:, 1], largest[-1][:, 0]
        lines += [
            Line("largest position error per metre", "mm", "constant", stereo.span(1e3 * position), None, group),
            Line("... (largest - smallest) / mean", "", 0.0, stereo.spread(position), (None, WITHIN), group),
            Line("largest attitude error per metre", "deg", "constant", stereo.span(np.rad2deg(attitude)), None, group),
            Line("... (largest - smallest) / mean", "", 0.0, stereo.spread(attitude), (None, WITHIN), group),
            Line("fit to the images: position", "mm", None, stereo.span(1e3 * fitted[-1][:, 1]), None, group),
            Line("fit to the images: attitude", "deg", None, stereo.span(np.rad2deg(fitted[-1][:, 0])), None, group),
        ]
    notes = (
        "The largest error per metre is over the poses of that metre; the closed form's is the same at every single "
        "pose, whatever its distance and attitude.",
    )
    return Outcome(lines, _data(largest, fitted), _draw(largest, fitted), notes)


def _by_metre(poses: Poses, error: Floats) -> Floats:
    """Largest angle [rad] and distance [m] per metre, (30, 2)."""
    size = np.stack([np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)], axis=1)
    return stereo.by_metre(poses.distance_m, size, "max")


def _data(largest: list[Floats], fitted: list[Floats]) -> pa.Table:
    columns = [column("distance_m", np.arange(stereo.RANGE_M), "m", "where the metre begins")]
    for kind, meaning, sets in (("closed", "closed form", largest), ("fit", "fit to the images", fitted)):
        for axis, values in zip("xyz", sets, strict=True):
            of = f"{meaning}, light 1 moved along {axis}: largest"
            columns.append(column(f"{kind}_{axis}_position_m", values[:, 1], "m", f"{of} position error of the metre"))
            angle = np.rad2deg(values[:, 0])
            columns.append(column(f"{kind}_{axis}_attitude_deg", angle, "deg", f"{of} attitude error of the metre"))
    return table_of(columns)


def _draw(largest: list[Floats], fitted: list[Floats]) -> Figure:
    page, axes = figures.page(2, 1, 4.6)
    middle = np.arange(stereo.RANGE_M) + 0.5
    inks = (figures.BLUE, figures.ORANGE, figures.GREEN)
    for place, i, label, scale in (
        (axes[0, 0], 1, "largest position error, mm", 1e3),
        (axes[1, 0], 0, "largest attitude error, deg", 180 / np.pi),
    ):
        for name, ink, closed, fit in zip(AXES, inks, largest, fitted, strict=True):
            place.semilogy(middle, scale * closed[:, i], "o-", ms=3, color=ink, label=f"{name}: closed form")
            place.semilogy(middle, scale * fit[:, i], ":", lw=1.2, color=ink, label="fit to the images")
        place.set_ylabel(label)
        place.set_xlim(0, stereo.RANGE_M)
    axes[0, 0].set_title("Light 1 misplaced by 1 mm: largest error of each metre of distance")
    axes[1, 0].set_xlabel("distance of the docking points, m")
    figures.legend(axes[0, 0], columns=3)
    axes[0, 0].set_ylim(top=30 * axes[0, 0].get_ylim()[1])
    return page
