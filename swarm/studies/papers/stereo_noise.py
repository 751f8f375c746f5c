"""Source 2, figure 5: image noise of 1 um (3 sigma), measured against the propagated errors (16) to (24), by distance.

Per metre of distance, over its poses and several draws of noise at each, the RMS error of

    every light       triangulated by (7), and by (16) to (19)
    the target's pose in closed form, and by the fit to the images of both cameras and of the main one alone

is set against the RMS of what is propagated at the true poses: the covariance of (7), (24), that of the closed form,
and the dilution of precision with the image-noise Jacobian.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats
from estimators.lighthouse.dop import factors
from estimators.stereo.cameras import refine_cameras
from estimators.stereo.closed_form import stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import Rig, triangulate
from swarm import figures
from swarm.errors import SwarmError
from swarm.figures import Figure
from swarm.studies.papers import stereo
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of
from swarm.studies.papers.stereo import Poses

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


class Metre(NamedTuple):
    """One metre: for every way of solving, measured and propagated RMS errors, (2, 3) or (2, 6)."""

    points: dict[str, Floats]
    poses: dict[str, Floats]


def run(request: Request) -> Outcome:
    """Draw the noise, solve, and compare, metre by metre."""
    per_metre, draws = request.sizes["poses"], request.sizes["draws"]
    if per_metre * draws < FEWEST:
        raise SwarmError(f"--poses {per_metre} --draws {draws}: a standard deviation needs {FEWEST} samples per metre")
    rng = np.random.default_rng(request.seed)
    poses = stereo.draw_poses(per_metre, rng)
    metre = np.minimum(poses.distance_m.astype(np.int64), stereo.RANGE_M - 1)
    rows: list[Metre] = []
    for m in range(stereo.RANGE_M):
        rows.append(_measure(Poses(*(part[metre == m] for part in poses)), draws, stereo.rig(), rng))
        request.progress((m + 1) / stereo.RANGE_M, f"{m + 1} m")
    return Outcome(_compare(rows), _data(rows), _draw(rows), _notes(rows))


def _measure(poses: Poses, draws: int, rig: Rig, rng: np.random.Generator) -> Metre:
    exact = stereo.images(poses, stereo.MARKER_M, rig)
    every = poses.repeat(draws)
    uv = np.repeat(exact, draws, axis=0)
    uv += NOISE * rng.standard_normal(uv.shape)
    true = np.einsum("nij,kj->nki", every.rotation, stereo.MARKER_M) + every.position[:, None]

    baseline = rig.baseline_m, stereo.TOE_IN_RAD
    lights = triangulate(uv[:, 0], uv[:, 1], rig).point_m - true
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], *baseline).point_m - true
    said = NOISE * np.sqrt(np.diagonal(triangulate(exact[:, 0], exact[:, 1], rig).covariance, axis1=-1, axis2=-2))
    plane_said = plane_point(exact[:, 0], exact[:, 1, :, 0], *baseline).sigma_m(NOISE)
    points = {
        "triangulated": np.stack([_rms(lights), _rms(said)]),
        "plane": np.stack([_rms(plane), _rms(plane_said)]),
    }

    seen, alone = stereo.all_seen(uv), stereo.all_seen(uv)
    alone[:, 1] = False
    few = slice(0, len(exact))
    closed = stereo_pose(uv, seen, stereo.MARKER_M, rig)
    at_truth = stereo_pose(exact, seen[few], stereo.MARKER_M, rig)
    solved = {"closed": (closed.rotation, closed.position, at_truth.covariance)}
    for name, which in (("both", seen), ("main", alone)):
        fit = refine_cameras(uv, which, stereo.MARKER_M, rig, every.rotation, every.position).pose
        start = poses.rotation, poses.position
        precision = refine_cameras(exact, which[few], stereo.MARKER_M, rig, *start).dilution
        solved[name] = fit.rotation, fit.position, precision.covariance
    found = {}
    for name, (rotation, position, covariance) in solved.items():
        sigma = NOISE * np.sqrt(np.diagonal(covariance, axis1=-1, axis2=-2))
        found[name] = np.stack([_rms(stereo.errors(every, rotation, position)), _rms(sigma)])
    return Metre(points, found)


def _rms(values: Floats) -> Floats:
    """Over all but the last axis."""
    out: Floats = np.sqrt(np.mean(values.reshape(-1, values.shape[-1]) ** 2, axis=0))
    return out


def _points(rows: list[Metre], name: str) -> Floats:
    """(30, 2, 3) [m]."""
    return np.stack([row.points[name] for row in rows])


def _poses(rows: list[Metre], name: str) -> Floats:
    """(30, 2, 6) [rad, m]."""
    return np.stack([row.poses[name] for row in rows])


def _compare(rows: list[Metre]) -> list[Line]:
    lines = []
    for name, meaning in POINTS.items():
        ratio = _points(rows, name)[:, 0] / _points(rows, name)[:, 1]
        group = f"Measured / propagated, all metres: {meaning}"
        lines += [Line(f"sigma_{a}", "", None, stereo.span(ratio[:, i]), WITHIN, group) for i, a in enumerate("XYZ")]
    for name, meaning in POSES.items():
        ratio = _poses(rows, name)[:, 0] / _poses(rows, name)[:, 1]
        group = f"Measured / propagated, all metres: {meaning}"
        lines.append(Line("attitude, every axis", "", None, stereo.span(ratio[:, :3]), WITHIN, group))
        lines.append(Line("position, every axis", "", None, stereo.span(ratio[:, 3:]), WITHIN, group))
    for name, meaning in POSES.items():
        last = _poses(rows, name)[-1, 0]
        group = f"RMS error from 29 m to 30 m: {meaning}"
        attitude = "poor, grows" if name == "closed" else None
        lines.append(Line("attitude", "deg", attitude, float(np.rad2deg(np.linalg.norm(last[:3]))), None, group))
        lines.append(Line("position of the target", "mm", None, float(1e3 * np.linalg.norm(last[3:])), None, group))
    return lines


def _notes(rows: list[Metre]) -> tuple[str, ...]:
    ratio = (_poses(rows, "closed")[:, 0] / _poses(rows, "both")[:, 0])[[0, -1]]
    gain = np.linalg.norm(ratio[:, :3], axis=1) / np.sqrt(3)
    return (
        f"The closed form's attitude is {gain[0]:.0f} times as uncertain as that of the fit at 0 m to 1 m, "
        f"{gain[1]:.0f} times at 29 m to 30 m: it trusts depths as it trusts directions, and the "
        "marker's tilt then hangs on depths. The raised light shows it sideways, which the fit to the images uses.",
    )


def _data(rows: list[Metre]) -> pa.Table:
    columns = [column("distance_m", np.arange(stereo.RANGE_M), "m", "where the metre begins")]
    kinds = ("measured", "propagated")
    for name, meaning in POINTS.items():
        values = _points(rows, name)
        for k, kind in enumerate(kinds):
            for i, a in enumerate("xyz"):
                columns.append(column(f"{name}_{kind}_{a}_m", values[:, k, i], "m", f"{meaning}: {kind} sigma, {a}"))
    for name, meaning in POSES.items():
        values = _poses(rows, name)
        for k, kind in enumerate(kinds):
            for i, a in enumerate("xyz"):
                turn = np.rad2deg(values[:, k, i])
                columns.append(column(f"{name}_{kind}_{a}_deg", turn, "deg", f"{meaning}: {kind} sigma about {a}"))
                columns.append(
                    column(f"{name}_{kind}_{a}_m", values[:, k, 3 + i], "m", f"{meaning}: {kind} sigma, {a}")
                )
            both = np.zeros((len(values), 6, 6))
            both[:, np.arange(6), np.arange(6)] = (values[:, k] / NOISE) ** 2
            for factor, unit, of in zip(("adop", "pdop"), ("deg_per_rad", "m_per_rad"), factors(both), strict=True):
                said = f"{meaning}: {factor.upper()} of the {kind} sigmas"
                columns.append(column(f"{name}_{kind}_{factor}_{unit}", of, unit.replace("_per_", "/"), said))
    return table_of(columns)


def _draw(rows: list[Metre]) -> Figure:
    page, axes = figures.page(2, 2, 5.4)
    places = [axes[r, c] for r in range(2) for c in range(2)]
    middle = np.arange(stereo.RANGE_M) + 0.5
    inks = (figures.BLUE, figures.ORANGE, figures.GREEN)

    def line(place: int, values: Floats, ink: str, label: str) -> None:
        places[place].semilogy(middle, values[:, 0], "o", ms=2.5, color=ink, label=label)
        places[place].semilogy(middle, values[:, 1], "-", lw=0.9, color=ink)

    for i, (axis, ink) in enumerate(zip("XYZ", inks, strict=True)):
        line(0, 1e3 * _points(rows, "triangulated")[:, :, i], ink, f"$\\sigma_{axis}$, (7)")
        line(1, 1e3 * _points(rows, "plane")[:, :, i], ink, f"$\\sigma_{axis}$, (16) to (19)")
    for name, ink in zip(POSES, inks, strict=True):
        values = _poses(rows, name)
        line(2, 1e3 * np.linalg.norm(values[:, :, 3:], axis=2), ink, POSES[name])
        line(3, np.rad2deg(np.linalg.norm(values[:, :, :3], axis=2)), ink, POSES[name])
    labels = ("a light, mm", "a light, mm", "position of the target, mm", "attitude, deg")
    for place, label in zip(places, labels, strict=True):
        place.set_ylabel(label)
        place.set_xlim(0, stereo.RANGE_M)
        figures.legend(place)
    page.suptitle("1 um (3 sigma): RMS errors measured (dots) and propagated (lines)", size=9)
    for place in axes[1]:
        place.set_xlabel("distance of the docking points, m")
    return page
