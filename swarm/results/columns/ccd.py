"""The telemetry columns of a run with cameras: what the CCD sensor alone found, beside the truth; null without a pose.

`telemetry.schema(ccd=True)` has them after all others; rows of craft without cameras are null.
"""

from typing import Protocol

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import angle_between, matrix_from_quaternion, quaternion_from_matrix

CCD_STATES = ("stereo", "too few", "not finite", "collinear", "behind", "undecided", "camera")
"""Names of the states 0 to 6; 7, no cameras on board, is null."""

FLOATS = (
    *((f"ccd_p{a}_m", "m", f"pose by the cameras alone: position, {a}") for a in "xyz"),
    *((f"ccd_q{a}", "1", f"pose by the cameras alone: attitude quaternion, {a} (w >= 0)") for a in "wxyz"),
    ("ccd_adop_deg_per_rad", "deg/rad", "attitude dilution of precision of that pose, per radian of image noise x/f"),
    ("ccd_pdop_m_per_rad", "m/rad", "position dilution of precision of that pose, per radian of image noise x/f"),
    ("ccd_residual_rad", "rad", "RMS of its image residuals, x/f and y/f"),
    ("ccd_position_error_m", "m", "distance of that pose from the truth"),
    ("ccd_attitude_error_deg", "deg", "angle of that pose from the truth (25)"),
    ("ccd_nis", "1", "squared innovation of that pose normalised by its covariance, 6 degrees of freedom"),
)
"""Name, unit and meaning of the columns of numbers."""
COUNTS = (
    ("ccd_main_lights", "1", "lights that the main camera saw"),
    ("ccd_backup_lights", "1", "lights that the backup camera saw"),
)


class CcdFix(Protocol):
    """What is read of `swarm.onboard.ccd.CcdFix`."""

    @property
    def state(self) -> Ints: ...  # noqa: D102
    @property
    def lights(self) -> Ints: ...  # noqa: D102
    @property
    def seen(self) -> Bools: ...  # noqa: D102
    @property
    def rotation(self) -> Floats: ...  # noqa: D102
    @property
    def position(self) -> Floats: ...  # noqa: D102
    @property
    def adop_deg_per_rad(self) -> Floats: ...  # noqa: D102
    @property
    def pdop_m_per_rad(self) -> Floats: ...  # noqa: D102
    @property
    def residual_rad(self) -> Floats: ...  # noqa: D102
    @property
    def nis(self) -> Floats: ...  # noqa: D102


def errors(fix: CcdFix, true_position: Floats, true_quaternion: Floats) -> Floats:
    """Distance [m] and angle [deg] from the truth, (C, 2); NaN without a pose."""
    known = np.all(np.isfinite(fix.position), axis=1)
    distance = np.linalg.norm(fix.position - true_position, axis=1)
    angle = np.full(len(known), np.nan)
    true_rotation = matrix_from_quaternion(true_quaternion[known])
    angle[known] = np.degrees(angle_between(fix.rotation[known], true_rotation))
    return np.stack([distance, angle], axis=1)


def floats(fix: CcdFix, true_position: Floats, true_quaternion: Floats) -> Floats:
    """The columns of numbers, (C, len(FLOATS)); true_position (C, 3) [m], true_quaternion (C, 4)."""
    error = errors(fix, true_position, true_quaternion)
    single = (fix.adop_deg_per_rad, fix.pdop_m_per_rad, fix.residual_rad, *error.T, fix.nis)
    return np.concatenate([fix.position, quaternion_from_matrix(fix.rotation), np.stack(single, axis=1)], axis=1)
