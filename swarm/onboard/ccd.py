"""A craft's own pose in the lighthouse frame, from two cameras' images of a target's lights.

The main camera comes first; {C1} is its frame, {T} the target's body frame, b the craft's body, l the lighthouse frame.
Each period, for every craft that carries a pair of cameras:

    both cameras see three lights or more, not on one line:
        closed form (source 2, 2.1), `estimators.stereo.closed_form`; then, unless configured otherwise, the fit to all
        images of both cameras from there, `estimators.stereo.cameras`: its covariance is the smallest that the images
        allow
    the main camera alone sees four or more:
        the same fit to its images, from the filter's prediction, or from nothing if the first pose is certain
    else no pose, and the reason

The target's pose in the lighthouse frame is declared: the target keeps a station that the craft knows. With it the
target's pose in {C1}, r = C V + M, gives the craft's own pose in the lighthouse frame, which is what navigation
estimates:

    R_l_b = R_l_T C^T R_b_C1^T,     p = p_T - R_l_C1 (M + q),     q = R_b_C1^T p_b_C1,     R_l_C1 = R_l_T C^T

An error of (C, M), left and active, is one of the pose, d_l and dp, with the covariance transformed accordingly:

    d_l = -R_l_C1 d,     dp = -R_l_C1 dM - R_l_C1 [M + q]x d

The last term is the lever of the attitude over the distance to the target: from afar it is by far the largest part of
dp, and almost wholly correlated with d_l. The filter takes the full covariance, with R_l_C1 and the lever at their
predicted values: at the measured pose they would share the noise that they multiply, which costs 2 % of NEES at 30 m.
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
"""Least number of lights for one camera: three leave up to four poses."""
RESIDUAL_LIMIT_RAD = 1e-3
"""Largest residual of an accepted fit [rad]: 40 times the noise, a tenth of the angle between two lights 30 m away."""


class CcdState(IntEnum):
    """Result of one period's images; from TOO_FEW to UNDECIDED the values are those of
    `estimators.stereo.closed_form.Reason`.
    """

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
    """A craft's knowledge of its cameras and of its target, in SI units.

    craft: its index. cameras: as in the model. light_m: lights in the target's frame, (L, 3). target_rotation:
    R_l_T of the declared station, (3, 3). target_position: its position, (3,) [m]. focal_length_m: of both cameras.
    image_noise_m: assumed noise, 1 sigma per coordinate on the detector. closed_form: whether the closed form is used
    without the fit.
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
        """The pose of camera 2 in camera 1's frame."""
        (main, backup), (first, second) = self.cameras.rotation, self.cameras.position_m
        return Rig(main.T @ backup, main.T @ (second - first))

    @property
    def noise(self) -> float:
        """The assumed noise of x/f, y/f."""
        return self.image_noise_m / self.focal_length_m

    def seen_from(self, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
        """Return the target's C (3, 3) and M (3,) [m] for a craft at R_l_b (3, 3) and `position` (3,) [m]."""
        main = rotation @ self.cameras.rotation[0]
        pinhole = rotation @ self.cameras.position_m[0] + position
        return main.T @ self.target_rotation, main.T @ (self.target_position - pinhole)

    def own_pose(self, c: Floats, m: Floats) -> tuple[Floats, Floats]:
        """Return R_l_b (3, 3) and position (3,) [m] of a craft that sees the target at C, M."""
        main, lever = self._lever(c, m)
        return main @ self.cameras.rotation[0].T, self.target_position - main @ lever

    def own_covariance(self, c: Floats, m: Floats, covariance: Floats) -> Floats:
        """Return the covariance (6, 6) of the craft's own pose.

        Args:
            c: C, (3, 3).
            m: M, (3,) [m].
            covariance: covariance of the target's pose near C, M, (6, 6).
        """
        main, lever = self._lever(c, m)
        slope = np.zeros((6, 6))
        slope[:3, :3] = slope[3:, 3:] = -main
        slope[3:, :3] = -main @ rot.skew(lever)
        turned: Floats = slope @ covariance @ slope.T
        return (turned + turned.T) / 2

    def _lever(self, c: Floats, m: Floats) -> tuple[Floats, Floats]:
        """Return R_l_C1 and M + q."""
        return self.target_rotation @ c.T, m + self.cameras.rotation[0].T @ self.cameras.position_m[0]


class CcdFix(NamedTuple):
    """Poses of C craft from this period's images; NaN without a pose.

    state: codes of `CcdState`, (C,). lights: number of lights that the main and the backup camera saw, (C, 2). seen:
    which lights, pair by pair, (P, 2, L). rotation: R_l_b, (C, 3, 3). position: (C, 3) [m]. covariance: (C, 6, 6),
    lighthouse frame, at the epoch. adop_deg_per_rad, pdop_m_per_rad: dilution of precision of that pose, per radian of
    image noise x/f, (C,). residual_rad: RMS residual, (C,). nis: normalised innovation squared, set after the filter's
    update, (C,).
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
        """The mask of the craft with a pose, (C,)."""
        known: Bools = np.isin(self.state, (CcdState.STEREO, CcdState.CAMERA))
        return known


class CcdPose(NamedTuple):
    """The target's pose in {C1}, with the covariance for unit noise; state tells how it was found, or why not."""

    state: CcdState
    rotation: Floats
    position: Floats
    covariance: Floats
    residual_rad: float


def _none(state: CcdState) -> CcdPose:
    return CcdPose(state, np.full((3, 3), np.nan), np.full(3, np.nan), np.full((6, 6), np.nan), np.nan)


class CameraFix:
    """The cameras' pose sensor: the pairs of cameras of all craft, in the order of their images."""

    def __init__(self, pairs: Sequence[CcdCalibration]) -> None:
        self._pairs = tuple(pairs)

    def find(self, images: LightImages, tracks: Tracks) -> tuple[CcdFix, PoseFix]:
        """Return the cameras' results, and the poses for the filters; an image has one instant, so no rate enters."""
        found = fix(self._pairs, images, tracks.bank.rotation, tracks.bank.position)
        none = np.zeros_like(found.covariance)
        sensor = np.where(found.state == CcdState.STEREO, Sensor.STEREO, Sensor.CAMERA).astype(np.int64)
        pose = PoseFix(found.known, found.rotation, found.position, found.covariance, none, none, sensor)
        return found, pose


def fix(pairs: Sequence[CcdCalibration], images: LightImages, rotation: Floats, position: Floats) -> CcdFix:
    """Return the poses of C craft from their cameras.

    Args:
        pairs: calibrations, in the order of `images`.
        images: this period's images.
        rotation: R_l_b that the filter predicts, (C, 3, 3), NaN if none.
        position: position that the filter predicts, (C, 3) [m], NaN if none.
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
    """Return the target's pose by both cameras if they determine it, else by the main camera alone.

    Args:
        pair: calibration of the cameras.
        uv: images x/f, y/f of the lights, (2, L, 2).
        seen: lights that each camera saw, (2, L).
        predicted: predicted C (3, 3) and M (3,) [m]; None without a prediction.
    """
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
