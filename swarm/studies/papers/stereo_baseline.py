"""Source 2, section 2.2: error against baseline and focal length, measured, with (16) to (24) drawn over it.

The marker lies 10 m ahead, facing the cameras, at a random small turn in every draw; the noise on the detector stays
1 um (3 sigma). Per baseline (toe-in as it is) and per focal length: the RMS error of a light triangulated by (7) and by
(16) to (19), and of the closed-form pose, beside what is propagated.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.stereo.closed_form import stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import triangulate
from swarm import figures
from swarm.studies.papers import stereo
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, rms, span, under

DISTANCE_M = 10.0
BASELINES_M = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5)
FOCALS_M = (0.012, 0.018, 0.028, 0.042, 0.06, 0.09, 0.135)
WITHIN = (0.95, 1.05)
SLOPE = (-1.05, -0.95)
FEWEST = 1000


class Setting(NamedTuple):
    """One baseline and focal length [m]; measured and propagated RMS errors of a light by (7) and by (16) to (19),
    (2, 3) [m], and of the closed-form pose, (2, 6) [rad, m].
    """

    baseline_m: float
    focal_m: float
    triangulated: Floats
    plane: Floats
    closed: Floats


def run(request: Request) -> Outcome:
    """Measure every setting."""
    request.refuse_below(FEWEST, "a standard deviation", "draws")
    draws, rng = request.sizes["draws"], request.rng()
    wanted = [(b, stereo.FOCAL_M) for b in BASELINES_M] + [(stereo.BASELINE_M, f) for f in FOCALS_M]
    settings = [_measure(baseline, focal, draws, rng) for baseline, focal in request.each(wanted, "setting")]
    baseline, focal = settings[: len(BASELINES_M)], settings[len(BASELINES_M) :]
    lines = [*_compare("Against the baseline", baseline, np.array(BASELINES_M))]
    lines += _compare("Against the focal length", focal, np.array(FOCALS_M))
    note = (
        f"At {DISTANCE_M:g} m between the docking points. The slopes are of log sigma_Z against log baseline or focal "
        "length, over the whole stretch: near the axis (24) gives sqrt(2) Z^2 sigma / (f b)."
    )
    return Outcome(lines, data(_columns(settings)), _draw(baseline, focal), (note,))


def _measure(baseline_m: float, focal_m: float, draws: int, rng: np.random.Generator) -> Setting:
    noise, rig = stereo.IMAGE_NOISE_M / focal_m, stereo.rig(baseline_m)
    poses = stereo.random_poses(np.full(draws, DISTANCE_M), rng, baseline_m)
    exact = stereo.images(poses, stereo.MARKER_M, rig)
    uv = exact + noise * rng.standard_normal(exact.shape)
    true, toed = poses.lights(stereo.MARKER_M), (baseline_m, stereo.TOE_IN_RAD)
    lights = triangulate(uv[:, 0], uv[:, 1], rig).point_m - true
    said = stereo.sigmas(triangulate(exact[:, 0], exact[:, 1], rig).covariance)
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], *toed).point_m - true
    plane_said = plane_point(exact[:, 0], exact[:, 1, :, 0], *toed).sigma_m(noise)
    closed, at_truth = (stereo_pose(seen, stereo.all_seen(uv), stereo.MARKER_M, rig) for seen in (uv, exact))
    error = stereo.errors(poses, closed.rotation, closed.position)
    return Setting(
        baseline_m,
        focal_m,
        np.stack([rms(lights), noise * rms(said)]),
        np.stack([rms(plane), rms(plane_said)]),
        np.stack([rms(error), noise * rms(stereo.sigmas(at_truth.covariance))]),
    )


def _compare(group: str, settings: list[Setting], against: Floats) -> list[Line]:
    sigma = np.array([s.triangulated[0, 2] for s in settings])
    lines = [Line("slope of sigma_Z", "", "falls", float(np.polyfit(np.log(against), np.log(sigma), 1)[0]), SLOPE)]
    for name, meaning in (("triangulated", "light, (7)"), ("plane", "light, (16) to (19)"), ("closed", "closed form")):
        ratio = [getattr(s, name)[0] / getattr(s, name)[1] for s in settings]
        lines.append(Line(f"measured / propagated: {meaning}", "", None, span(ratio), WITHIN))
    return under(group, *lines)


def _columns(settings: list[Setting]) -> Columns:
    columns: Columns = {
        "baseline_m": ([s.baseline_m for s in settings], "between the cameras"),
        "focal_length_m": ([s.focal_m for s in settings], "of both cameras"),
    }
    for k, kind in enumerate(("measured", "propagated")):
        for name, meaning in (("triangulated", "a light by (7)"), ("plane", "a light by (16) to (19)")):
            columns[f"{name}_{kind}_*_m"] = [getattr(s, name)[k] for s in settings], f"{meaning}: {kind} sigma, *"
        closed = np.array([s.closed[k] for s in settings])
        columns[f"closed_{kind}_*_deg"] = np.rad2deg(closed[:, :3]), f"closed form: {kind} sigma about *"
        columns[f"closed_{kind}_*_m"] = closed[:, 3:], f"closed form: {kind} sigma, *"
    return columns


def _draw(baseline: list[Setting], focal: list[Setting]) -> figures.Figure:
    page, axes = figures.page(2, 2, 5.0)
    sets = (
        (baseline, [s.baseline_m for s in baseline], "baseline, m"),
        (focal, [1e3 * s.focal_m for s in focal], "focal length, mm"),
    )
    for column, (settings, against, label) in zip(axes.T, sets, strict=True):
        lights, poses = column
        plane = 1e3 * np.array([s.plane for s in settings])
        position = 1e3 * np.array([np.linalg.norm(s.closed[:, 3:], axis=1) for s in settings])
        attitude = np.rad2deg([np.linalg.norm(s.closed[:, :3], axis=1) for s in settings])
        for place in column:
            place.set(xscale="log", yscale="log")
        for i, (axis, ink) in enumerate(zip("XYZ", figures.INKS, strict=True)):
            values = plane[:, :, i]
            figures.measured_and_said(lights, against, values[:, 0], values[:, 1], ink, f"$\\sigma_{axis}$", size=3.5)
        both = ((position, figures.BLUE, "position, mm"), (attitude, figures.VERMILLION, "attitude, deg"))
        for values, ink, name in both:
            figures.measured_and_said(poses, against, values[:, 0], values[:, 1], ink, name, size=3.5)
        lights.set_ylabel("a light, (16) to (24), mm")
        poses.set(xlabel=label, ylabel="closed-form pose")
        for place in column:
            place.set_xticks(against[::2], [f"{value:.3g}" for value in against[::2]])
            place.minorticks_off()
            figures.legend(place)
    page.suptitle(f"{DISTANCE_M:g} m, 1 um (3 sigma): RMS errors measured (dots) and propagated (lines)", size=9)
    return page
