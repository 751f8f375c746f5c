"""Pose of a target from two cameras in closed form: source 2, section 2.1, with its covariance.

The target carries lights at V_i in its own frame {T}; r_i = C V_i + M in the main camera's frame {C1}. Lights that both
cameras see are triangulated (7), `estimators.stereo.triangulation`; then, over the n of them,

    U = C V,  u_i = r_i - mean(r),  v_i = V_i - mean(V)                                    (9)
    C: the rotation with the smallest sum |u_i - C v_i|^2 (10) to (13), `estimators.stereo.vector_attitude`
    M = mean(r_i) - C mean(V_i)

Vectors are taken from the mean, so that C and M together are the least-squares pose of equally trusted points. To first
order, with C_true = Exp([d]x) C, M_true = M + dM and J_i = (-[C V_i]x, I), an error of the points gives

    (d, dM) = N^-1 sum J_i^T dr_i,   N = sum J_i^T J_i,   covariance = N^-1 (sum J_i^T S_i J_i) N^-1

S_i the covariance of r_i for unit noise of the image coordinates u = x/f, v = y/f. Triangulated depths are far worse
than the directions (Z / baseline times), and equal trust lets them into the attitude: see docs/stereo.md, and
`estimators.stereo.cameras` for the solution that weighs the images themselves.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.projection import checked, spans_plane
from estimators.linear import invert_spd_into
from estimators.stereo.triangulation import Rig, checked_rig, triangulate_into
from estimators.stereo.vector_attitude import attitude_into

FEWEST_COMMON = 3
"""Lights that both cameras must see: three that are not on one line have one pose, for their places are measured."""


class Reason(IntEnum):
    """The reason why there is no pose; SOLVED where there is one."""

    SOLVED = 0
    TOO_FEW = 1
    """Fewer than three lights are seen by both cameras (four by one camera alone)."""
    NOT_FINITE = 2
    """An image coordinate of a light that is seen, or its place on the target, is not a number."""
    COLLINEAR = 3
    """The lights seen are on one line, or two at one place: a turn about it would not be seen."""
    BEHIND = 4
    """The rays to one light do not meet in front of both cameras."""
    UNDECIDED = 5
    """No pose fits the images, or more than one does (`estimators.stereo.cameras`)."""


class StereoPose(NamedTuple):
    """Poses of N targets in the main camera's frame; NaN where `reason` is not SOLVED.

    rotation: (N, 3, 3) C. position: (N, 3) M [m]. covariance: (N, 6, 6) of (attitude, position), left error, for unit
    noise of u and v. reason: (N,) of `Reason`. used: (N,) lights that both cameras see. residual_rad: (N,) RMS of the
    differences between the images and those of the solved pose, over 4 n coordinates u, v.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    reason: Ints
    used: Ints
    residual_rad: Floats


@kernel
def _add_covariance(arm: Floats, slope: Floats, normal: Floats, spread: Floats) -> None:
    """Add J^T J to `normal` and J^T S J to `spread` (6, 6), lower triangles; S = slope slope^T.

    J = (-[arm]x, I), so that J^T s = (arm x s, s) for every column s.
    """
    moved = np.empty((6, 4))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        normal[k, k] += arm[i] * arm[i] + arm[j] * arm[j]
        normal[3 + k, 3 + k] += 1.0
        normal[max(i, k), min(i, k)] -= arm[i] * arm[k]
        normal[3 + i, j] += arm[k]
        normal[3 + j, i] -= arm[k]
        for n in range(4):
            moved[3 + k, n] = slope[k, n]
            moved[k, n] = arm[i] * slope[j, n] - arm[j] * slope[i, n]
    for a in range(6):
        for b in range(a + 1):
            for n in range(4):
                spread[a, b] += moved[a, n] * moved[b, n]


@kernel
def _mirror(a: Floats) -> None:
    """Copy the lower triangle to the upper."""
    for i in range(a.shape[0]):
        for j in range(i):
            a[j, i] = a[i, j]


@kernel
def _misfit(uv: Floats, x: float, y: float, z: float) -> float:
    return float((x / z - uv[0]) ** 2 + (y / z - uv[1]) ** 2)


@kernel
def _solve_one(
    uv: Floats,
    seen: Bools,
    point: Floats,
    rig_rotation: Floats,
    origin: Floats,
    rotation: Floats,
    position: Floats,
    covariance: Floats,
) -> tuple[int, int, float]:
    """One target: uv (2, K, 2), seen (2, K), point (K, 3); writes the pose, returns reason, used, residual."""
    lights = point.shape[0]
    both = seen[0] & seen[1]
    used, finite = 0, True
    for i in range(lights):
        if both[i]:
            used += 1
            for k in range(2):
                finite = finite and np.isfinite(uv[0, i, k]) and np.isfinite(uv[1, i, k])
            for k in range(3):
                finite = finite and np.isfinite(point[i, k])
    if used < 3:
        return 1, used, np.nan
    if not finite:
        return 2, used, np.nan
    if not spans_plane(both, point):
        return 3, used, np.nan

    r, slope = np.empty((lights, 3)), np.empty((lights, 3, 4))
    mean_r, mean_v = np.zeros(3), np.zeros(3)
    for i in range(lights):
        if both[i]:
            if not triangulate_into(uv[0, i], uv[1, i], rig_rotation, origin, r[i], slope[i]):
                return 4, used, np.nan
            for k in range(3):
                mean_r[k] += r[i, k] / used
                mean_v[k] += point[i, k] / used
    h = np.zeros((3, 3))
    for i in range(lights):
        if both[i]:
            for a in range(3):
                for b in range(3):
                    h[a, b] += (r[i, a] - mean_r[a]) * (point[i, b] - mean_v[b])
    if not attitude_into(h, rotation):
        return 3, used, np.nan
    for a in range(3):
        position[a] = mean_r[a]
        for b in range(3):
            position[a] -= rotation[a, b] * mean_v[b]

    normal, spread, inverse, product = np.zeros((6, 6)), np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    arm, far, cost = np.empty(3), np.empty(3), 0.0
    for i in range(lights):
        if not both[i]:
            continue
        for a in range(3):
            arm[a] = rotation[a, 0] * point[i, 0] + rotation[a, 1] * point[i, 1] + rotation[a, 2] * point[i, 2]
        _add_covariance(arm, slope[i], normal, spread)
        for a in range(3):
            far[a] = 0.0
            for b in range(3):
                far[a] += rig_rotation[b, a] * (arm[b] + position[b] - origin[b])
        if not (arm[2] + position[2] > 0 and far[2] > 0):
            return 4, used, np.nan
        cost += _misfit(uv[0, i], arm[0] + position[0], arm[1] + position[1], arm[2] + position[2])
        cost += _misfit(uv[1, i], far[0], far[1], far[2])
    _mirror(normal)
    _mirror(spread)
    if not invert_spd_into(normal, inverse):
        return 3, used, np.nan
    for a in range(6):
        for b in range(6):
            product[a, b] = 0.0
            for k in range(6):
                product[a, b] += inverse[a, k] * spread[k, b]
    for a in range(6):
        for b in range(6):
            covariance[a, b] = 0.0
            for k in range(6):
                covariance[a, b] += product[a, k] * inverse[k, b]
    return 0, used, np.sqrt(cost / (4 * used))


@kernel
def _solve_all(
    uv: Floats,
    seen: Bools,
    point: Floats,
    rig_rotation: Floats,
    origin: Floats,
    rotation: Floats,
    position: Floats,
    covariance: Floats,
    reason: Ints,
    used: Ints,
    residual: Floats,
) -> None:
    for n in range(uv.shape[0]):
        reason[n], used[n], residual[n] = _solve_one(
            uv[n], seen[n], point[n], rig_rotation, origin, rotation[n], position[n], covariance[n]
        )
        if reason[n] != 0:
            rotation[n] = np.nan
            position[n] = np.nan
            covariance[n] = np.nan


def checked_images(uv: Floats, seen: Bools, point_m: Floats) -> tuple[Floats, Bools, Floats]:
    """Return uv (N, 2, K, 2), seen (N, 2, K) and point_m (N, K, 3) as the kernels want them.

    Args:
        uv: (N, 2, K, 2).
        seen: (N, 2, K).
        point_m: (N, K, 3) [m], or (K, 3) for every target.

    Raises:
        ValueError: a shape does not fit `seen`; the message names the argument.
    """
    seen = np.ascontiguousarray(seen, dtype=np.bool_)
    if seen.ndim != 3 or seen.shape[1] != 2:
        raise ValueError(f"seen has shape {seen.shape}, expected (targets, 2, lights)")
    targets, _, lights = seen.shape
    point_m = np.asarray(point_m, dtype=np.float64)
    if point_m.ndim == 2:
        point_m = np.broadcast_to(point_m, (targets, *point_m.shape))
    return checked("uv", uv, (*seen.shape, 2)), seen, checked("point_m", point_m, (targets, lights, 3))


def stereo_pose(uv: Floats, seen: Bools, point_m: Floats, rig: Rig) -> StereoPose:
    """Closed-form poses of N targets from what two cameras see of their K lights.

    Args:
        uv: (N, 2, K, 2), images divided by the focal length, main camera first; ignored, NaN allowed, where not seen.
        seen: (N, 2, K), which camera sees which light.
        point_m: (N, K, 3) or (K, 3) [m], the lights in the target's frame.
        rig: the cameras' places.

    Raises:
        ValueError: an array's shape does not fit `seen`, or the rig is none.
    """
    uv, seen, point_m = checked_images(uv, seen, point_m)
    rotation, origin = checked_rig(rig)
    count = len(seen)
    out = StereoPose(
        np.empty((count, 3, 3)),
        np.empty((count, 3)),
        np.empty((count, 6, 6)),
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty(count),
    )
    _solve_all(uv, seen, point_m, rotation, origin, *out)
    return out
