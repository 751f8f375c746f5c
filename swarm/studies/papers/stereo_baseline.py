"""Source 2, section 2.2: error against baseline and focal length, measured, with (16) to (24) drawn over it.

The marker lies 10 m ahead, facing the cameras, at a random small turn in every draw; the noise on the detector stays
1 um (3 sigma). Per baseline (toe-in as it is) and per focal length: the RMS error of a light triangulated by (7) and by
(16) to (19), and of the closed-form pose, beside what is propagated.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats
from estimators.stereo.closed_form import stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import triangulate
from swarm import figures
from swarm.errors import SwarmError
from swarm.figures import Figure
from swarm.studies.papers import stereo
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of

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
    draws = request.sizes["draws"]
    if draws < FEWEST:
        raise SwarmError(f"--draws: {draws}: a standard deviation needs at least {FEWEST}")
    rng = np.random.default_rng(request.seed)
    wanted = [(b, stereo.FOCAL_M) for b in BASELINES_M] + [(stereo.BASELINE_M, f) for f in FOCALS_M]
    settings = []
    for i, (baseline_m, focal_m) in enumerate(wanted):
        settings.append(_measure(baseline_m, focal_m, draws, rng))
        request.progress((i + 1) / len(wanted), f"baseline {baseline_m:g} m, focal length {1e3 * focal_m:g} mm")
    baseline, focal = settings[: len(BASELINES_M)], settings[len(BASELINES_M) :]
    lines = [*_compare("Against the baseline", baseline, np.array(BASELINES_M))]
    lines += _compare("Against the focal length", focal, np.array(FOCALS_M))
    notes = (
        f"At {DISTANCE_M:g} m between the docking points. The slopes are of log sigma_Z against log baseline or focal "
        "length, over the whole stretch: near the axis (24) gives sqrt(2) Z^2 sigma / (f b).",
    )
    return Outcome(lines, _data(settings), _draw(baseline, focal), notes)


def _measure(baseline_m: float, focal_m: float, draws: int, rng: np.random.Generator) -> Setting:
    noise, rig = stereo.IMAGE_NOISE_M / focal_m, stereo.rig(baseline_m)
    poses = stereo.random_poses(np.full(draws, DISTANCE_M), rng, baseline_m)
    exact = stereo.images(poses, stereo.MARKER_M, rig)
    uv = exact + noise * rng.standard_normal(exact.shape)
    true = np.einsum("nij,kj->nki", poses.rotation, stereo.MARKER_M) + poses.position[:, None]
    toed = baseline_m, stereo.TOE_IN_RAD
    said = np.diagonal(triangulate(exact[:, 0], exact[:, 1], rig).covariance, axis1=-1, axis2=-2)
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], *toed).point_m - true
    seen = stereo.all_seen(uv)
    closed, at_truth = (stereo_pose(of, seen, stereo.MARKER_M, rig) for of in (uv, exact))
    return Setting(
        baseline_m,
        focal_m,
        np.stack([_rms(triangulate(uv[:, 0], uv[:, 1], rig).point_m - true), noise * _rms(np.sqrt(said))]),
        np.stack([_rms(plane), _rms(plane_point(exact[:, 0], exact[:, 1, :, 0], *toed).sigma_m(noise))]),
        np.stack([_rms(stereo.errors(poses, closed.rotation, closed.position)), noise * _rms(stereo.sigmas(at_truth))]),
    )


def _rms(values: Floats) -> Floats:
    """Over all but the last axis."""
    out: Floats = np.sqrt(np.mean(values.reshape(-1, values.shape[-1]) ** 2, axis=0))
    return out


def _compare(group: str, settings: list[Setting], against: Floats) -> list[Line]:
    sigma = np.array([s.triangulated[0, 2] for s in settings])
    slope = float(np.polyfit(np.log(against), np.log(sigma), 1)[0])
    lines = [Line("slope of sigma_Z", "", "falls", slope, SLOPE, group)]
    for name, meaning in (("triangulated", "light, (7)"), ("plane", "light, (16) to (19)"), ("closed", "closed form")):
        ratio = np.array([getattr(s, name)[0] / getattr(s, name)[1] for s in settings])
        lines.append(Line(f"measured / propagated: {meaning}", "", None, stereo.span(ratio), WITHIN, group))
    return lines


def _data(settings: list[Setting]) -> pa.Table:
    columns = [
        column("baseline_m", [s.baseline_m for s in settings], "m", "between the cameras"),
        column("focal_length_m", [s.focal_m for s in settings], "m", "of both cameras"),
    ]
    for k, kind in enumerate(("measured", "propagated")):
        for i, a in enumerate("xyz"):
            for name, meaning in (("triangulated", "a light by (7)"), ("plane", "a light by (16) to (19)")):
                values = [getattr(s, name)[k, i] for s in settings]
                columns.append(column(f"{name}_{kind}_{a}_m", values, "m", f"{meaning}: {kind} sigma, {a}"))
            turn = [np.rad2deg(s.closed[k, i]) for s in settings]
            columns.append(column(f"closed_{kind}_{a}_deg", turn, "deg", f"closed form: {kind} sigma about {a}"))
            values = [s.closed[k, 3 + i] for s in settings]
            columns.append(column(f"closed_{kind}_{a}_m", values, "m", f"closed form: {kind} sigma, {a}"))
    return table_of(columns)


def _draw(baseline: list[Setting], focal: list[Setting]) -> Figure:
    page, axes = figures.page(2, 2, 5.0)
    inks = (figures.BLUE, figures.ORANGE, figures.GREEN)
    sets = (
        (baseline, [s.baseline_m for s in baseline], "baseline, m"),
        (focal, [1e3 * s.focal_m for s in focal], "focal length, mm"),
    )
    for c, (settings, against, label) in enumerate(sets):
        place = axes[0, c]
        for i, (axis, ink) in enumerate(zip("XYZ", inks, strict=True)):
            values = 1e3 * np.array([s.plane[:, i] for s in settings])
            place.loglog(against, values[:, 0], "o", ms=3.5, color=ink, label=f"$\\sigma_{axis}$")
            place.loglog(against, values[:, 1], "-", lw=0.9, color=ink)
        place.set_ylabel("a light, (16) to (24), mm")
        place = axes[1, c]
        position = 1e3 * np.array([np.linalg.norm(s.closed[:, 3:], axis=1) for s in settings])
        attitude = np.rad2deg([np.linalg.norm(s.closed[:, :3], axis=1) for s in settings])
        both = ((position, figures.BLUE, "position, mm"), (attitude, figures.VERMILLION, "attitude, deg"))
        for values, ink, name in both:
            place.loglog(against, values[:, 0], "o", ms=3.5, color=ink, label=name)
            place.loglog(against, values[:, 1], "-", lw=0.9, color=ink)
        place.set_ylabel("closed-form pose")
        place.set_xlabel(label)
    for place, against in ((axes[r, c], sets[c][1]) for r in range(2) for c in range(2)):
        place.set_xticks(against[::2], [f"{value:.3g}" for value in against[::2]])
        place.minorticks_off()
        figures.legend(place)
    page.suptitle(f"{DISTANCE_M:g} m, 1 um (3 sigma): RMS errors measured (dots) and propagated (lines)", size=9)
    return page
