"""Source 2, figure 4: light 1 is 1 mm from where the craft believes it to be; the images are exact.

The closed form trusts every light alike, wherever it is: its error is a constant of the marker, turned by the attitude,
and does not depend on the distance. The fit to the images (`estimators.stereo.cameras`), which trusts directions more
than depths, does not have this property; it is shown beside, at every 16th pose.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.stereo.cameras import refine_cameras
from estimators.stereo.closed_form import stereo_pose
from swarm import figures
from swarm.studies.papers import stereo
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, span, under

MISPLACED_M = 1e-3
AXES = ("x, outward", "y, along the circle", "z, out of its plane")
WITHIN = 0.05
EVERY = 16


def run(request: Request) -> Outcome:
    """Move light 1 along each of the marker's axes, and solve every pose with the marker as drawn."""
    poses = stereo.draw_poses(request.sizes["poses"], request.rng())
    few = poses.rows(slice(None, None, EVERY))
    rig, lines = stereo.rig(), list[Line]()
    largest: list[Floats] = []
    fitted: list[Floats] = []
    columns: Columns = {"distance_m": (np.arange(stereo.RANGE_M), "where the metre begins")}
    for axis in request.each(range(len(AXES)), "axis"):
        true = stereo.MARKER_M.copy()
        true[0, axis] += MISPLACED_M
        uv = stereo.images(poses, true, rig)
        closed = stereo_pose(uv, stereo.all_seen(uv), stereo.MARKER_M, rig)
        largest.append(_by_metre(poses, closed.rotation, closed.position))
        uv = stereo.images(few, true, rig)
        fit = refine_cameras(uv, stereo.all_seen(uv), stereo.MARKER_M, rig, few.rotation, few.position).pose
        fitted.append(_by_metre(few, fit.rotation, fit.position))
        lines += _compare(AXES[axis], largest[-1], fitted[-1])
    for kind, meaning, sets in (("closed", "closed form", largest), ("fit", "fit to the images", fitted)):
        for letter, values in zip("xyz", sets, strict=True):
            which = f"{meaning}, light 1 moved along {letter}: largest"
            columns[f"{kind}_{letter}_position_m"] = values[:, 1], f"{which} position error of the metre"
            columns[f"{kind}_{letter}_attitude_deg"] = np.rad2deg(values[:, 0]), f"{which} attitude error of the metre"
    note = (
        "The largest error per metre is over the poses of that metre; the closed form's is the same at every single "
        "pose, whatever its distance and attitude."
    )
    return Outcome(lines, data(columns), _draw(largest, fitted), (note,))


def _by_metre(poses: stereo.Poses, rotation: Floats, position: Floats) -> Floats:
    """Return the largest angle [rad] and distance [m] per metre, (30, 2)."""
    return stereo.largest_by_metre(poses.distance_m, stereo.sizes(stereo.errors(poses, rotation, position)))


def _compare(axis: str, closed: Floats, fitted: Floats) -> list[Line]:
    position, attitude = 1e3 * closed[:, 1], np.rad2deg(closed[:, 0])
    spread = [float(np.ptp(closed[:, i]) / closed[:, i].mean()) for i in (0, 1)]
    return under(
        f"Light 1 off by 1 mm along {axis}",
        Line("largest position error per metre", "mm", "constant", span(position)),
        Line("... (largest - smallest) / mean", "", 0.0, spread[1], (None, WITHIN)),
        Line("largest attitude error per metre", "deg", "constant", span(attitude)),
        Line("... (largest - smallest) / mean", "", 0.0, spread[0], (None, WITHIN)),
        Line("fit to the images: position", "mm", None, span(1e3 * fitted[:, 1])),
        Line("fit to the images: attitude", "deg", None, span(np.rad2deg(fitted[:, 0]))),
    )


def _draw(largest: list[Floats], fitted: list[Floats]) -> figures.Figure:
    page, axes = figures.page(2, 1, 4.6)
    middle = np.arange(stereo.RANGE_M) + 0.5
    for place, i, label, scale in (
        (axes[0, 0], 1, "largest position error, mm", 1e3),
        (axes[1, 0], 0, "largest attitude error, deg", 180 / np.pi),
    ):
        for name, ink, closed, fit in zip(AXES, figures.INKS, largest, fitted, strict=True):
            place.semilogy(middle, scale * closed[:, i], "o-", ms=3, color=ink, label=f"{name}: closed form")
            place.semilogy(middle, scale * fit[:, i], ":", lw=1.2, color=ink, label="fit to the images")
        place.set_ylabel(label)
        place.set_xlim(0, stereo.RANGE_M)
    axes[0, 0].set_title("Light 1 misplaced by 1 mm: largest error of each metre of distance")
    axes[1, 0].set_xlabel("distance of the docking points, m")
    figures.legend(axes[0, 0], columns=3)
    axes[0, 0].set_ylim(top=30 * axes[0, 0].get_ylim()[1])
    return page
