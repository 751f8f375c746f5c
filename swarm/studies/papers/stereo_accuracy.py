"""Source 2, figure 3: the closed form's own accuracy, without any error in the images, at 15 361 poses.

What is left is rounding. A rounding error of an image coordinate, half an ulp of u, moves the triangulated depth by

    dZ = Z^2 / b  du,    |du| <= 2^-54 for 1/8 <= |u| < 1/4

some 1e-13 m at 30 m: no algorithm in double precision does better than that from images in double precision. (7) itself
adds the condition number of A, about Z / b (its normal equations that squared), unless the equations are scaled first
(`estimators.stereo.triangulation`); both are shown.
"""

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.stereo.closed_form import Reason, stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import Rig, triangulate
from estimators.stereo.vector_attitude import minimum_norm
from swarm import figures
from swarm.studies.papers import stereo
from swarm.studies.papers.experiment import Line, Outcome, Request, data, under

POSITION_M, ATTITUDE_DEG = 1e-12, 1e-10


def run(request: Request) -> Outcome:
    """Solve every pose from exact images."""
    poses = stereo.draw_poses(request.sizes["poses"], request.rng())
    rig = stereo.rig()
    uv = stereo.images(poses, stereo.MARKER_M, rig)
    request.progress(0.2, f"{len(uv)} poses")
    solved = stereo_pose(uv, stereo.all_seen(uv), stereo.MARKER_M, rig)
    error = stereo.errors(poses, solved.rotation, solved.position)
    error[:, :3] = np.rad2deg(error[:, :3])
    size = stereo.sizes(error)
    count, right = len(uv), int(np.count_nonzero(solved.reason == Reason.SOLVED))
    inside = int(np.all(stereo.in_field(uv), axis=(1, 2)).sum())
    lines = under(
        f"Pose, {count} poses",
        Line("poses solved", "", count, right, (count, count)),
        Line("all lights in both fields", "", None, inside),
        Line("largest position error", "m", POSITION_M, float(size[:, 1].max()), (None, POSITION_M)),
        Line("largest attitude error", "deg", ATTITUDE_DEG, float(size[:, 0].max()), (None, ATTITUDE_DEG)),
    )
    note = (
        f"Distance is between the docking points; the lights are {stereo.SET_BACK_M:g} m farther from the cameras, "
        f"up to {stereo.RANGE_M + stereo.SET_BACK_M:g} m."
    )
    table = data(
        {
            "distance_m": (poses.distance_m, "between the docking points"),
            "p*_m": (poses.position, "true position M, *"),
            "q*": (rot.quaternion_from_matrix(poses.rotation), "true attitude C, *"),
            "error_*_m": (error[:, 3:], "position error, *"),
            "error_*_deg": (error[:, :3], "attitude error about *"),
            "position_error_m": (size[:, 1], "length of the position error"),
            "attitude_error_deg": (size[:, 0], "angle of the attitude error"),
        }
    )
    return Outcome([*lines, *_lights(poses, uv, rig)], table, _draw(poses, size), (note,))


def _lights(poses: stereo.Poses, uv: Floats, rig: Rig) -> list[Line]:
    """Compare ways to triangulate single lights, and the attitude by (11), from exact images."""
    true = poses.lights(stereo.MARKER_M)
    lights = triangulate(uv[:, 0], uv[:, 1], rig).point_m
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], rig.baseline_m, stereo.TOE_IN_RAD).point_m
    a, b = _system(uv, rig)
    at = np.swapaxes(a, -1, -2)
    plain, normal = np.linalg.pinv(a) @ b[..., None], np.linalg.solve(at @ a, at @ b[..., None])
    marker = np.broadcast_to(stereo.MARKER_M, (len(uv), *stereo.MARKER_M.shape))
    measured, drawn = (np.swapaxes(v - v.mean(axis=-2, keepdims=True), -1, -2) for v in (lights, marker))
    free = minimum_norm(measured, drawn)
    skewed = np.linalg.norm(free @ np.swapaxes(free, -1, -2) - np.eye(3), axis=(1, 2)).max()
    # The equations in (p, q, Z), r1 = (u1 Z + p, v1 Z + q, Z), with each unknown scaled to a column of length 1.
    last = _system(uv[-1], rig)[0]
    turn = np.broadcast_to(np.eye(3), (*last.shape[:-2], 3, 3)).copy()
    turn[..., :2, 2] = uv[-1, 0]
    scaled = last @ turn
    scaled = scaled / np.linalg.norm(scaled, axis=-2, keepdims=True)
    lines = under(
        "Lights, largest error of a coordinate",
        Line("(7) as solved here", "m", None, _largest(lights - true)),
        Line("(16) to (19)", "m", None, _largest(plane - true)),
        Line("(7) by SVD, unscaled", "m", None, _largest(plain[..., 0] - true)),
        Line("(7) by its normal equations", "m", None, _largest(normal[..., 0] - true)),
        Line("condition number of A at 30 m", "", None, float(np.linalg.cond(last).max())),
        Line("... of the scaled equations", "", None, float(np.linalg.cond(scaled).max())),
    )
    return [*lines, *under("Attitude", Line("(11) from orthogonal, largest", "", None, float(skewed)))]


def _largest(error: Floats) -> float:
    return float(np.abs(error).max())


def _system(uv: Floats, rig: Rig) -> tuple[Floats, Floats]:
    """Return A (..., 4, 3) and B (..., 4) of (7), for images uv (..., 2 cameras, K, 2)."""
    first, second = uv[..., 0, :, :], uv[..., 1, :, :]
    a = np.zeros((*first.shape[:-1], 4, 3))
    a[..., 0, 0] = a[..., 1, 1] = 1.0
    a[..., :2, 2] = -first
    a[..., 2:, :] = rig.rotation.T[:2] - second[..., None] * rig.rotation.T[2]
    b = np.zeros(a.shape[:-1])
    b[..., 2:] = a[..., 2:, :] @ rig.origin_m
    return a, b


def _draw(poses: stereo.Poses, size: Floats) -> figures.Figure:
    page, axes = figures.page(2, 1, 4.6)
    for place, i, label, limit in (
        (axes[0, 0], 1, "position error, m", POSITION_M),
        (axes[1, 0], 0, "attitude error, deg", ATTITUDE_DEG),
    ):
        # A pose that rounds to its exact self has no place on a logarithmic axis.
        drawn = size[:, i] > 0
        place.semilogy(poses.distance_m[drawn], size[drawn, i], ".", ms=1.5, color=figures.BLUE, rasterized=True)
        place.axhline(limit, color=figures.VERMILLION, lw=1.0, label="source 2: no worse than")
        place.set_ylabel(label)
        place.set_xlim(0, stereo.RANGE_M)
    axes[0, 0].set_title(f"Closed form, exact images, {len(size)} poses")
    axes[1, 0].set_xlabel("distance of the docking points, m")
    figures.legend(axes[0, 0])
    return page
