"""Source 2, figure 3: the closed form's own accuracy, without any error in the images, at 15 361 poses.

What is left is rounding. A rounding error of an image coordinate, half an ulp of u, moves the triangulated depth by

    dZ = Z^2 / b  du,    |du| <= 2^-54 for 1/8 <= |u| < 1/4

some 1e-13 m at 30 m: no algorithm in double precision does better than that from images in double precision. (7) itself
adds the condition number of A, about Z / b (its normal equations that squared), unless the equations are scaled first
(`estimators.stereo.triangulation`); both are shown.
"""

import numpy as np
import pyarrow as pa

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.stereo.closed_form import Reason, stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import Rig, triangulate
from estimators.stereo.vector_attitude import minimum_norm
from swarm import figures
from swarm.figures import Figure
from swarm.studies.papers import stereo
from swarm.studies.papers.results import Line, Outcome, Request, column, table_of
from swarm.studies.papers.stereo import Poses

POSITION_M, ATTITUDE_DEG = 1e-12, 1e-10


def run(request: Request) -> Outcome:
    """Solve every pose from exact images."""
    poses = stereo.draw_poses(request.sizes["poses"], np.random.default_rng(request.seed))
    rig = stereo.rig()
    uv = stereo.images(poses, stereo.MARKER_M, rig)
    request.progress(0.2, f"{len(uv)} poses")
    solved = stereo_pose(uv, stereo.all_seen(uv), stereo.MARKER_M, rig)
    error = stereo.errors(poses, solved.rotation, solved.position)
    error[:, :3] = np.rad2deg(error[:, :3])
    size = np.stack([np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)], axis=1)

    lights = triangulate(uv[:, 0], uv[:, 1], rig).point_m
    plane = plane_point(uv[:, 0], uv[:, 1, :, 0], rig.baseline_m, stereo.TOE_IN_RAD).point_m
    plain = _lstsq(uv, rig)
    normal = _normal_equations(uv, rig)
    true = np.einsum("nij,kj->nki", poses.rotation, stereo.MARKER_M) + poses.position[:, None]
    free = minimum_norm(*(np.swapaxes(v - v.mean(axis=-2, keepdims=True), -1, -2) for v in (lights, _marker(poses))))
    skewed = np.linalg.norm(free @ np.swapaxes(free, -1, -2) - np.eye(3), axis=(1, 2)).max()

    worst = [float(np.abs(p - true).max()) for p in (lights, plane, plain, normal)]
    condition = float(_condition(uv[-1], rig))
    solved_count = int(np.count_nonzero(solved.reason == Reason.SOLVED))
    pose, points = f"Pose, {len(uv)} poses", "Lights, largest error of a coordinate"
    comparison = [
        Line("poses solved", "", len(uv), solved_count, (len(uv), len(uv)), pose),
        Line("all lights in both fields", "", None, int(np.all(stereo.in_field(uv), axis=(1, 2)).sum()), None, pose),
        Line("largest position error", "m", POSITION_M, float(size[:, 1].max()), (None, POSITION_M), pose),
        Line("largest attitude error", "deg", ATTITUDE_DEG, float(size[:, 0].max()), (None, ATTITUDE_DEG), pose),
        Line("(7) as solved here", "m", None, worst[0], None, points),
        Line("(16) to (19)", "m", None, worst[1], None, points),
        Line("(7) by SVD, unscaled", "m", None, worst[2], None, points),
        Line("(7) by its normal equations", "m", None, worst[3], None, points),
        Line("condition number of A at 30 m", "", None, condition, None, points),
        Line("... of the scaled equations", "", None, float(_scaled_condition(uv[-1], rig)), None, points),
        Line("(11) from orthogonal, largest", "", None, float(skewed), None, "Attitude"),
    ]
    notes = (
        f"Distance is between the docking points; the lights are {stereo.SET_BACK_M:g} m farther from the cameras, "
        f"up to {stereo.RANGE_M + stereo.SET_BACK_M:g} m.",
    )
    return Outcome(comparison, _data(poses, error, size), _draw(poses, size), notes)


def _marker(poses: Poses) -> Floats:
    return np.broadcast_to(stereo.MARKER_M, (len(poses.distance_m), *stereo.MARKER_M.shape))


def _system(uv: Floats, rig: Rig) -> tuple[Floats, Floats]:
    """A (..., 4, 3) and B (..., 4) of (7), for images uv (..., 2 cameras, K, 2)."""
    first, second = uv[..., 0, :, :], uv[..., 1, :, :]
    a = np.zeros((*first.shape[:-1], 4, 3))
    a[..., 0, 0] = a[..., 1, 1] = 1.0
    a[..., :2, 2] = -first
    a[..., 2:, :] = rig.rotation.T[:2] - second[..., None] * rig.rotation.T[2]
    b = np.zeros(a.shape[:-1])
    b[..., 2:] = a[..., 2:, :] @ rig.origin_m
    return a, b


def _lstsq(uv: Floats, rig: Rig) -> Floats:
    a, b = _system(uv, rig)
    out: Floats = np.asarray(np.linalg.pinv(a) @ b[..., None], dtype=np.float64)[..., 0]
    return out


def _normal_equations(uv: Floats, rig: Rig) -> Floats:
    a, b = _system(uv, rig)
    at = np.swapaxes(a, -1, -2)
    out: Floats = np.asarray(np.linalg.solve(at @ a, at @ b[..., None]), dtype=np.float64)[..., 0]
    return out


def _condition(uv: Floats, rig: Rig) -> Floats:
    out: Floats = np.linalg.cond(_system(uv, rig)[0]).max()
    return out


def _scaled_condition(uv: Floats, rig: Rig) -> Floats:
    """Of the equations in (p, q, Z), r1 = (u1 Z + p, v1 Z + q, Z), each unknown scaled to a column of length 1."""
    a = _system(uv, rig)[0]
    turn = np.broadcast_to(np.eye(3), (*a.shape[:-2], 3, 3)).copy()
    turn[..., :2, 2] = uv[..., 0, :, :]
    scaled = a @ turn
    out: Floats = np.linalg.cond(scaled / np.linalg.norm(scaled, axis=-2, keepdims=True)).max()
    return out


def _data(poses: Poses, error: Floats, size: Floats) -> pa.Table:
    quaternion = rot.quaternion_from_matrix(poses.rotation)
    columns = [column("distance_m", poses.distance_m, "m", "between the docking points")]
    columns += [column(f"p{a}_m", poses.position[:, i], "m", f"true position M, {a}") for i, a in enumerate("xyz")]
    columns += [column(f"q{a}", quaternion[:, i], "1", f"true attitude C, {a}") for i, a in enumerate("wxyz")]
    columns += [column(f"error_{a}_m", error[:, 3 + i], "m", f"position error, {a}") for i, a in enumerate("xyz")]
    columns += [column(f"error_{a}_deg", error[:, i], "deg", f"attitude error about {a}") for i, a in enumerate("xyz")]
    columns.append(column("position_error_m", size[:, 1], "m", "length of the position error"))
    columns.append(column("attitude_error_deg", size[:, 0], "deg", "angle of the attitude error"))
    return table_of(columns)


def _draw(poses: Poses, size: Floats) -> Figure:
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
