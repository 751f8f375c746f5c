"""Pose of a target from the images of one camera or two, by the Levenberg-Marquardt of `estimators.lighthouse.pnp`.

Source 2, section 1: one pinhole camera, r_i = C V_i + M, u = x/f = X/Z, v = y/f = Y/Z (1), solved by iteration over all
lights. It is the lighthouse's problem with u, v measured instead of cot theta: the same `refine_projections`, weight 1.

A second camera joins in without another solver. Its image is turned to be parallel to the main camera's, which for a
pinhole is exact whatever the light's distance,

    (u', v', 1) ~ C_12 (u2, v2, 1),       weight 1 / sigma(u'), 1 / sigma(v') for unit noise of (u2, v2)

and it then sees the target displaced by -M_12: X' / Z' of C V_i + M - M_12. To `refine_projections` that is a light
that has moved by v tau, so that the images of camera 2 enter with tau = 1 and v = -M_12. The correlation that the turn
makes between u' and v' is left out: below 2 % for cameras turned by 4 deg and a half field of 12 deg.

The covariance is that of `estimators.lighthouse.dop` with the image-noise Jacobian; all poses are of the target in
{C1}.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.dop import Dilution, image_dilution
from estimators.lighthouse.pnp import FEWEST_LIT, PoseSolution, refine_projections
from estimators.lighthouse.pnp_start import StartCandidates, cold_starts_projections
from estimators.lighthouse.projection import spans_plane
from estimators.stereo.closed_form import Reason, checked_images
from estimators.stereo.triangulation import Rig, checked_rig


class CameraPose(NamedTuple):
    """Poses of N targets in the main camera's frame, and their precision; NaN where `reason` is not SOLVED.

    pose: residual_rad and cost are in units of u, v. dilution: for unit noise of u, v. reason: (N,).
    """

    pose: PoseSolution
    dilution: Dilution
    reason: Ints


class _OneView(NamedTuple):
    """The images of both cameras as `refine_projections` takes them, 2 K lights per target."""

    uv: Floats
    weight: Floats
    seen: Bools
    point_m: Floats
    offset_s: Floats
    velocity: Floats


def _one_view(uv: Floats, seen: Bools, point_m: Floats, rig: Rig) -> _OneView:
    rotation, origin = checked_rig(rig)
    targets, _, lights = seen.shape
    ray = np.concatenate([uv[:, 1], np.ones((targets, lights, 1))], axis=-1) @ rotation.T
    # A ray that would be behind the main camera has no place in its image plane.
    depth = np.where(ray[..., 2:] > 0, ray[..., 2:], np.nan)
    turned = ray[..., :2] / depth
    slope = (rotation[:2, :2] - turned[..., None] * rotation[2, :2]) / depth[..., None]
    weight = np.stack([np.ones_like(turned), 1 / np.sqrt(np.sum(slope**2, axis=-1))], axis=1)
    offset = np.zeros((targets, 2, lights, 2))
    offset[:, 1] = 1.0
    flat = (targets, 2 * lights, 2)
    return _OneView(
        np.stack([uv[:, 0], turned], axis=1).reshape(flat),
        weight.reshape(flat),
        seen.reshape(targets, -1),
        np.concatenate([point_m, point_m], axis=1),
        offset.reshape(flat),
        np.tile(-origin, (targets, 1)),
    )


def refine_cameras(
    uv: Floats, seen: Bools, point_m: Floats, rig: Rig, rotation: Floats, position: Floats
) -> CameraPose:
    """Solve the poses of N targets that fit all images best, from a start near the answer; one camera serves as well.

    Args:
        uv: (N, 2, K, 2), images divided by the focal length, main camera first; ignored, NaN allowed, where not seen.
        seen: (N, 2, K), which camera sees which light; four images at least, of lights that are not on one line.
        point_m: (N, K, 3) or (K, 3) [m], the lights in the target's frame.
        rig: the cameras' places.
        rotation: (N, 3, 3), start C.
        position: (N, 3) [m], start M.

    Raises:
        ValueError: an array's shape does not fit `seen`, or the rig is none.
    """
    uv, seen, point_m = checked_images(uv, seen, point_m)
    view = _one_view(uv, seen, point_m, rig)
    still = np.zeros((len(seen), 3))
    pose = refine_projections(
        view.uv, view.weight, view.seen, view.point_m, rotation, position, view.offset_s, still, view.velocity
    )
    dilution = image_dilution(
        pose.rotation,
        pose.position,
        view.seen,
        view.point_m,
        view.weight,
        view.offset_s,
        view.velocity,
        pose.solved,
    )
    determined = pose.solved & np.isfinite(dilution.pdop_m_per_rad)
    reason = np.empty(len(seen), dtype=np.int64)
    _why_not_all(uv, seen, point_m, reason)
    undecided = (reason == Reason.SOLVED) & ~determined
    return CameraPose(pose, dilution, np.where(undecided, Reason.UNDECIDED, reason))


def first_pose(uv: Floats, seen: Bools, point_m: Floats) -> StartCandidates:
    """Return every pose that one target may have by the main camera alone, best first; see `cold_starts`.

    Args:
        uv: (K, 2), divided by the focal length; costs are in its units squared.
        seen: (K,).
        point_m: (K, 3) [m].
    """
    one, still = uv[None], np.zeros((1, 3))
    at_rest = np.zeros_like(one), still, still
    return cold_starts_projections(one, np.ones_like(one), seen[None], point_m[None], *at_rest)[0]


@kernel
def _why_not_all(uv: Floats, seen: Bools, point: Floats, reason: Ints) -> None:
    """Write what is wrong with the images (N, 2, K, 2) of each target, before anything is solved."""
    for n in range(len(seen)):
        any_seen = seen[n, 0] | seen[n, 1]
        count, finite = 0, True
        for i in range(len(any_seen)):
            for camera in range(2):
                if seen[n, camera, i]:
                    count += 1
                    finite = finite and np.isfinite(uv[n, camera, i, 0] + uv[n, camera, i, 1])
            if any_seen[i]:
                finite = finite and np.isfinite(point[n, i, 0] + point[n, i, 1] + point[n, i, 2])
        reason[n] = 0
        if count < FEWEST_LIT:
            reason[n] = 1
        elif not finite:
            reason[n] = 2
        elif not spans_plane(any_seen, point[n]):
            reason[n] = 3
