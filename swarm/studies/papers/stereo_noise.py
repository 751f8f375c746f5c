"""Source 2, figure 5: image noise of 1 um (3 sigma), measured against the propagated errors (16) to (24), by distance.

Per metre of distance, over its poses and several draws of noise at each, the RMS error of

    every light       triangulated by (7), and by (16) to (19)
    the target's pose in closed form, and by the fit to the images of both cameras and of the main one alone

is set against the RMS of what is propagated at the true poses: the covariance of (7), (24), that of the closed form,
and the dilution of precision with the image-noise Jacobian.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.dop import factors
from estimators.stereo.cameras import refine_cameras
from estimators.stereo.closed_form import stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import Rig, triangulate
from swarm import figures
from swarm.studies.papers import stereo
from swarm.studies.papers.experiment import Columns, Line, Outcome, Request, data, rms, span, under

NOISE = stereo.IMAGE_NOISE_M / stereo.FOCAL_M
WITHIN = (0.95, 1.05)
FEWEST = 1000
"""Samples per metre, for a standard deviation that is known to 2 %."""
POINTS = {"triangulated": "lights by (7)", "plane": "lights by (16) to (19)"}
POSES = {
    "closed": "closed form",
    "both": "fit to both cameras' images",
    "main": "fit to the main camera's images",
}
KINDS = ("measured", "propagated")

Table = dict[str, Floats]
"""Measured and propagated RMS errors by the way of solving: (30, 2, 3) [m] of lights, (30, 2, 6) [rad, m] of poses."""


def run(request: Request) -> Outcome:
    """Draw the noise, solve, and compare, metre by metre."""
    request.refuse_below(FEWEST, "a standard deviation", "poses", "draws")
    rng = request.rng()
    poses = stereo.draw_poses(request.sizes["poses"], rng)
    metre = np.minimum(poses.distance_m.astype(np.int64), stereo.RANGE_M - 1)
    rows = [
        _measure(poses.rows(metre == m), request.sizes["draws"], stereo.rig(), rng)
        for m in request.each(range(stereo.RANGE_M), "metre")
    ]
    table = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    ratio = (table["closed"][:, 0] / table["both"][:, 0])[[0, -1]]
    gain = np.linalg.norm(ratio[:, :3], axis=1) / np.sqrt(3)
    note = (
        f"The closed form's attitude is {gain[0]:.0f} times as uncertain as that of the fit at 0 m to 1 m, "
        f"{gain[1]:.0f} times at 29 m to 30 m: it trusts depths as it trusts directions, and the "
        "marker's tilt then hangs on depths. The raised light shows it sideways, which the fit to the images uses."
    )
    return Outcome(_compare(table), data(_columns(table)), _draw(table), (note,))


def _measure(poses: stereo.Poses, draws: int, rig: Rig, rng: np.random.Generator) -> Table:
    """Return the measured and propagated errors of one metre, (2, 3) or (2, 6) by way of solving."""
    exact = stereo.images(poses, stereo.MARKER_M, rig)
    every = poses.repeat(draws)
    uv = np.repeat(exact, draws, axis=0)
    uv += NOISE * rng.standard_normal(uv.shape)
    true = every.lights(stereo.MARKER_M)

    toed = rig.baseline_m, stereo.TOE_IN_RAD
    lights = triangulate(uv[:, 0], uv[:, 1], rig).point_m - true
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], *toed).point_m - true
    said = NOISE * stereo.sigmas(triangulate(exact[:, 0], exact[:, 1], rig).covariance)
    plane_said = plane_point(exact[:, 0], exact[:, 1, :, 0], *toed).sigma_m(NOISE)
    found = {"triangulated": np.stack([rms(lights), rms(said)]), "plane": np.stack([rms(plane), rms(plane_said)])}

    seen, alone = stereo.all_seen(uv), stereo.all_seen(uv)
    alone[:, 1] = False
    closed = stereo_pose(uv, seen, stereo.MARKER_M, rig)
    at_truth = stereo_pose(exact, seen[: len(exact)], stereo.MARKER_M, rig)
    solved = {"closed": (closed.rotation, closed.position, at_truth.covariance)}
    for name, which in (("both", seen), ("main", alone)):
        fit = refine_cameras(uv, which, stereo.MARKER_M, rig, every.rotation, every.position).pose
        first = which[: len(exact)]
        precision = refine_cameras(exact, first, stereo.MARKER_M, rig, poses.rotation, poses.position).dilution
        solved[name] = fit.rotation, fit.position, precision.covariance
    for name, (rotation, position, covariance) in solved.items():
        error = stereo.errors(every, rotation, position)
        found[name] = np.stack([rms(error), rms(NOISE * stereo.sigmas(covariance))])
    return found


def _compare(table: Table) -> list[Line]:
    lines = []
    for name, meaning in {**POINTS, **POSES}.items():
        ratio = table[name][:, 0] / table[name][:, 1]
        if name in POINTS:
            own = [Line(f"sigma_{a}", "", None, span(ratio[:, i]), WITHIN) for i, a in enumerate("XYZ")]
        else:
            parts = (("attitude", ratio[:, :3]), ("position", ratio[:, 3:]))
            own = [Line(f"{what}, every axis", "", None, span(part), WITHIN) for what, part in parts]
        lines += under(f"Measured / propagated, all metres: {meaning}", *own)
    for name, meaning in POSES.items():
        last = table[name][-1, 0]
        poor = "poor, grows" if name == "closed" else None
        lines += under(
            f"RMS error from 29 m to 30 m: {meaning}",
            Line("attitude", "deg", poor, float(np.rad2deg(np.linalg.norm(last[:3])))),
            Line("position of the target", "mm", None, float(1e3 * np.linalg.norm(last[3:]))),
        )
    return lines


def _columns(table: Table) -> Columns:
    columns: Columns = {"distance_m": (np.arange(stereo.RANGE_M), "where the metre begins")}
    for name, meaning in {**POINTS, **POSES}.items():
        for k, kind in enumerate(KINDS):
            values = table[name][:, k]
            columns[f"{name}_{kind}_*_m"] = values[:, -3:], f"{meaning}: {kind} sigma, *"
            if name in POINTS:
                continue
            columns[f"{name}_{kind}_*_deg"] = np.rad2deg(values[:, :3]), f"{meaning}: {kind} sigma about *"
            both = np.zeros((len(values), 6, 6))
            both[:, np.arange(6), np.arange(6)] = (values / NOISE) ** 2
            for factor, unit, size in zip(("adop", "pdop"), ("deg", "m"), factors(both), strict=True):
                columns[f"{name}_{kind}_{factor}_{unit}_per_rad"] = (
                    size,
                    f"{meaning}: {factor.upper()} of the {kind} sigmas",
                )
    return columns


def _draw(table: Table) -> figures.Figure:
    page, axes = figures.page(2, 2, 5.4)
    middle = np.arange(stereo.RANGE_M) + 0.5
    places = list(axes.ravel())
    labels = ("a light, mm", "a light, mm", "position of the target, mm", "attitude, deg")
    for place, label in zip(places, labels, strict=True):
        place.set(yscale="log", ylabel=label, xlim=(0, stereo.RANGE_M))

    def line(place: int, values: Floats, ink: str, label: str) -> None:
        figures.measured_and_said(places[place], middle, values[:, 0], values[:, 1], ink, label)

    for i, (axis, ink) in enumerate(zip("XYZ", figures.INKS, strict=True)):
        line(0, 1e3 * table["triangulated"][:, :, i], ink, f"$\\sigma_{axis}$, (7)")
        line(1, 1e3 * table["plane"][:, :, i], ink, f"$\\sigma_{axis}$, (16) to (19)")
    for (name, meaning), ink in zip(POSES.items(), figures.INKS, strict=True):
        line(2, 1e3 * np.linalg.norm(table[name][:, :, 3:], axis=2), ink, meaning)
        line(3, np.rad2deg(np.linalg.norm(table[name][:, :, :3], axis=2)), ink, meaning)
    for place in places:
        figures.legend(place)
    page.suptitle("1 um (3 sigma): RMS errors measured (dots) and propagated (lines)", size=9)
    for place in axes[1]:
        place.set_xlabel("distance of the docking points, m")
    return page
