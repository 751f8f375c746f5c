"""From two cameras' images of a target's lights to the craft's own pose in the lighthouse frame.

Main camera first; {C1} is its frame, {T} the target's body frame, b the craft's body, l the lighthouse frame. Each
period, for every craft that carries a pair of cameras:

    both cameras see three lights or more, not on one line:
        closed form (source 2, 2.1), `estimators.stereo.closed_form`; then, unless told otherwise, the fit to all images
        of both cameras from there, `estimators.stereo.cameras`: its covariance is the smallest that the images allow
    the main camera alone sees four or more:
        the same fit to its images, from the filter's prediction, or from nothing where the first pose is certain
    else no pose, and the reason

The target's pose in the lighthouse frame is declared: it keeps a station that the craft knows. With it the target's
pose in {C1}, r = C V + M, is the craft's own pose in the lighthouse frame, the one thing that navigation knows:

    R_l_b = R_l_T C^T R_b_C1^T,     p = p_T - R_l_C1 (M + q),     q = R_b_C1^T p_b_C1,     R_l_C1 = R_l_T C^T

and an error of (C, M), left and active, is one of the pose, d_l and dp, with the covariance turned accordingly:

    d_l = -R_l_C1 d,     dp = -R_l_C1 dM - R_l_C1 [M + q]x d

The last term is the lever of the attitude over the distance to the target: by far the largest part of dp from afar,
and almost wholly correlated with d_l. The filter is given all of it, with R_l_C1 and the lever where it predicts them:
at the measured pose they would share the noise that they multiply, which costs 2 % of NEES at 30 m.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.dop import factors
from estimators.stereo.cameras import CameraPose, first_pose, refine_cameras
from estimators.stereo.closed_form import FEWEST_COMMON, Reason, stereo_pose
from estimators.stereo.triangulation import Rig
from swarm.hardware import Cameras
from swarm.messages import LightImages
from swarm.onboard.acquisition import DECISIVE
from swarm.onboard.settings import Sensor
from swarm.onboard.tracks import PoseFix, Tracks

FEWEST_ALONE = 4
"""Lights that one camera needs: three leave up to four poses."""
RESIDUAL_LIMIT_RAD = 1e-3
"""A fit worse than this is not a pose: 40 times the noise, a tenth of the angle between two lights 30 m away."""


class CcdState(IntEnum):
    """What became of one period's images; from TOO_FEW on as `estimators.stereo.closed_form.Reason`."""

    STEREO = 0
    TOO_FEW = 1
    NOT_FINITE = 2
    COLLINEAR = 3
    BEHIND = 4
    UNDECIDED = 5
    CAMERA = 6
    ABSENT = 7
    """The craft carries no cameras."""


@dataclass(frozen=True)
class CcdCalibration:
    """What a craft knows of its cameras and of its target, in SI units.

    craft: its index. cameras: as drawn. light_m: (L, 3) in the target's frame. target_rotation (3, 3) R_l_T and
    target_position (3,) [m]: the declared station. image_noise_m: believed, 1 sigma per coordinate on the detector.
    closed_form: take the closed form as it is.
    """

    craft: int
    cameras: Cameras
    light_m: Floats
    target_rotation: Floats
    target_position: Floats
    focal_length_m: float
    image_noise_m: float
    closed_form: bool

    @property
    def rig(self) -> Rig:
        """Where camera 2 is in camera 1's frame."""
        (main, backup), (first, second) = self.cameras.rotation, self.cameras.position_m
        return Rig(main.T @ backup, main.T @ (second - first))

    @property
    def noise(self) -> float:
        """Believed noise of x/f, y/f."""
        return self.image_noise_m / self.focal_length_m

    def seen_from(self, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
        """The target's C (3, 3) and M (3,) for a craft at R_l_b (3, 3), `position` (3,)."""
        main = rotation @ self.cameras.rotation[0]
        pinhole = rotation @ self.cameras.position_m[0] + position
        return main.T @ self.target_rotation, main.T @ (self.target_position - pinhole)

    def own_pose(self, c: Floats, m: Floats) -> tuple[Floats, Floats]:
        """R_l_b (3, 3) and position (3,) of a craft that sees the target at C, M."""
        main, lever = self._lever(c, m)
        return main @ self.cameras.rotation[0].T, self.target_position - main @ lever

    def own_covariance(self, c: Floats, m: Floats, covariance: Floats) -> Floats:
        """The covariance (6, 6) of the own pose, from that of the target's pose near C, M."""
        main, lever = self._lever(c, m)
        slope = np.zeros((6, 6))
        slope[:3, :3] = slope[3:, 3:] = -main
        slope[3:, :3] = -main @ rot.skew(lever)
        turned: Floats = slope @ covariance @ slope.T
        return (turned + turned.T) / 2

    def _lever(self, c: Floats, m: Floats) -> tuple[Floats, Floats]:
        """R_l_C1 and M + q."""
        return self.target_rotation @ c.T, m + self.cameras.rotation[0].T @ self.cameras.position_m[0]


class CcdFix(NamedTuple):
    """What C craft found in this period's images; NaN where there is no pose.

    state: (C,) of `CcdState`. lights: (C, 2), how many the main and the backup camera saw. seen: (P, 2, L), which, pair
    by pair. rotation (C, 3, 3) R_l_b, position (C, 3) [m], covariance (C, 6, 6): lighthouse frame, at the epoch.
    adop_deg_per_rad, pdop_m_per_rad: (C,), of that pose, per radian of image noise x/f. residual_rad: (C,), RMS. nis:
    (C,), filled in by the filter.
    """

    state: Ints
    lights: Ints
    seen: Bools
    rotation: Floats
    position: Floats
    covariance: Floats
    adop_deg_per_rad: Floats
    pdop_m_per_rad: Floats
    residual_rad: Floats
    nis: Floats

    @property
    def known(self) -> Bools:
        """(C,), where there is a pose."""
        known: Bools = np.isin(self.state, (CcdState.STEREO, CcdState.CAMERA))
        return known


class CcdPose(NamedTuple):
    """The target in {C1}, with the covariance for unit noise; state says how it was found, or why not."""

    state: CcdState
    rotation: Floats
    position: Floats
    covariance: Floats
    residual_rad: float


def _none(state: CcdState) -> CcdPose:
    return CcdPose(state, np.full((3, 3), np.nan), np.full(3, np.nan), np.full((6, 6), np.nan), np.nan)


class CameraFix:
    """The cameras' pose sensor: the pairs of cameras of a swarm, in the order of their images."""

    def __init__(self, pairs: Sequence[CcdCalibration]) -> None:
        self._pairs = tuple(pairs)

    def find(self, images: LightImages, tracks: Tracks) -> tuple[CcdFix, PoseFix]:
        """Return what the cameras found, and the poses for the filters; an image has one instant: no rate enters."""
        found = fix(self._pairs, images, tracks.bank.rotation, tracks.bank.position)
        none = np.zeros_like(found.covariance)
        sensor = np.where(found.state == CcdState.STEREO, Sensor.STEREO, Sensor.CAMERA).astype(np.int64)
        pose = PoseFix(found.known, found.rotation, found.position, found.covariance, none, none, sensor)
        return found, pose


def fix(pairs: Sequence[CcdCalibration], images: LightImages, rotation: Floats, position: Floats) -> CcdFix:
    """Return the poses of C craft by their cameras.

    Args:
        pairs: in the order of `images`.
        images: what the cameras saw.
        rotation: (C, 3, 3), the filter's prediction, NaN where none.
        position: (C, 3) [m], likewise.
    """
    craft = len(position)
    out = CcdFix(
        np.full(craft, CcdState.ABSENT, dtype=np.int64),
        np.zeros((craft, 2), dtype=np.int64),
        images.seen,
        np.full((craft, 3, 3), np.nan),
        np.full((craft, 3), np.nan),
        np.full((craft, 6, 6), np.nan),
        *np.full((4, craft), np.nan),
    )
    for p, pair in enumerate(pairs):
        i, lights = pair.craft, len(pair.light_m)
        uv = images.image_m[p, :, :lights] / pair.focal_length_m
        seen = images.seen[p, :, :lights]
        predicted = pair.seen_from(rotation[i], position[i]) if np.isfinite(position[i]).all() else None
        found = target_pose(pair, uv, seen, predicted)
        out.state[i], out.lights[i] = found.state, np.count_nonzero(seen, axis=1)
        if out.known[i]:
            out.rotation[i], out.position[i] = pair.own_pose(found.rotation, found.position)
            near = (found.rotation, found.position) if predicted is None else predicted
            unit = pair.own_covariance(*near, found.covariance)
            out.covariance[i] = pair.noise**2 * unit
            out.adop_deg_per_rad[i], out.pdop_m_per_rad[i] = factors(unit)
            out.residual_rad[i] = found.residual_rad
    return out


def target_pose(pair: CcdCalibration, uv: Floats, seen: Bools, predicted: tuple[Floats, Floats] | None) -> CcdPose:
    """The target by the images uv (2, L, 2), seen (2, L): stereo while it can, else by the main camera alone."""
    if np.count_nonzero(seen.all(axis=0)) >= FEWEST_COMMON:
        found = _stereo(pair, uv, seen)
        if found.state == CcdState.STEREO:
            return found
    return _main_alone(pair, uv, seen, predicted)


def _stereo(pair: CcdCalibration, uv: Floats, seen: Bools) -> CcdPose:
    closed = stereo_pose(uv[None], seen[None], pair.light_m, pair.rig)
    if closed.reason[0] != Reason.SOLVED:
        return _none(CcdState(closed.reason[0]))
    if pair.closed_form:
        pose = CcdPose(
            CcdState.STEREO, closed.rotation[0], closed.position[0], closed.covariance[0], float(closed.residual_rad[0])
        )
        return pose if pose.residual_rad < RESIDUAL_LIMIT_RAD else _none(CcdState.UNDECIDED)
    return _fitted(
        refine_cameras(uv[None], seen[None], pair.light_m, pair.rig, closed.rotation, closed.position), CcdState.STEREO
    )


def _main_alone(pair: CcdCalibration, uv: Floats, seen: Bools, predicted: tuple[Floats, Floats] | None) -> CcdPose:
    alone = np.stack([seen[0], np.zeros_like(seen[0])])
    if np.count_nonzero(alone) < FEWEST_ALONE:
        return _none(CcdState.TOO_FEW)
    if predicted is None:
        candidates = first_pose(uv[0], seen[0], pair.light_m)
        # Twice the log likelihood ratio of the first pose to the second, as in `swarm.onboard.acquisition`.
        costs = [*candidates.cost, np.inf, np.inf]
        if not costs[1] - costs[0] >= DECISIVE * pair.noise**2:
            return _none(CcdState.UNDECIDED)
        predicted = candidates.rotation[0], candidates.position[0]
    start = predicted[0][None], predicted[1][None]
    return _fitted(refine_cameras(uv[None], alone[None], pair.light_m, pair.rig, *start), CcdState.CAMERA)


def _fitted(fit: CameraPose, state: CcdState) -> CcdPose:
    if fit.reason[0] != Reason.SOLVED:
        return _none(CcdState(fit.reason[0]))
    if not fit.pose.residual_rad[0] < RESIDUAL_LIMIT_RAD:
        return _none(CcdState.UNDECIDED)
    return CcdPose(
        state, fit.pose.rotation[0], fit.pose.position[0], fit.dilution.covariance[0], float(fit.pose.residual_rad[0])
    )
