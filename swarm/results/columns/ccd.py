"""The telemetry columns of a run with cameras: what the CCD sensor alone found, beside the truth.

Rows without such a pose, and of craft without cameras, are null.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import angle_between, matrix_from_quaternion, quaternion_from_matrix
from swarm.onboard.ccd import CcdFix, CcdState
from swarm.results.columns.column import Column, Group, pose_columns
from swarm.results.period import Period
from swarm.results.records import Truth

CCD_STATES = tuple(state.name.lower().replace("_", " ") for state in CcdState if state is not CcdState.ABSENT)
"""Names of the states; `ABSENT`, no cameras on board, is null."""

COLUMNS = (
    Column("ccd", "", f"what became of the period's images: {', '.join(CCD_STATES)}", "state", CCD_STATES),
    Column("ccd_main_lights", "1", "lights that the main camera saw", "small"),
    Column("ccd_backup_lights", "1", "lights that the backup camera saw", "small"),
    *pose_columns("ccd", "pose by the cameras alone"),
    Column(
        "ccd_adop_deg_per_rad", "deg/rad", "attitude dilution of precision of that pose, per radian of image noise x/f"
    ),
    Column("ccd_pdop_m_per_rad", "m/rad", "position dilution of precision of that pose, per radian of image noise x/f"),
    Column("ccd_residual_rad", "rad", "RMS of its image residuals, x/f and y/f"),
    Column("ccd_position_error_m", "m", "distance of that pose from the truth"),
    Column("ccd_attitude_error_deg", "deg", "angle of that pose from the truth (25)"),
    Column("ccd_nis", "1", "squared innovation of that pose normalised by its covariance, 6 degrees of freedom"),
)


def errors(fix: CcdFix, truth: Truth) -> Floats:
    """Return distance [m] and angle [deg] of the cameras' poses from the truth, (C, 2); NaN without a pose."""
    known = np.all(np.isfinite(fix.position), axis=1)
    distance = np.linalg.norm(fix.position - truth.position, axis=1)
    angle = np.full(len(known), np.nan)
    true_rotation = matrix_from_quaternion(truth.quaternion[known])
    angle[known] = np.degrees(angle_between(fix.rotation[known], true_rotation))
    return np.stack([distance, angle], axis=1)


def _fill(period: Period, out: Floats) -> None:
    fix, truth = period.estimate.ccd, period.truth
    if fix is None or truth is None:
        out[:] = np.nan
        return
    absent = fix.state == CcdState.ABSENT
    parts = (
        np.where(absent, np.nan, fix.state)[:, None],
        np.where(absent[:, None], np.nan, fix.lights),
        fix.position,
        quaternion_from_matrix(fix.rotation),
        fix.adop_deg_per_rad[:, None],
        fix.pdop_m_per_rad[:, None],
        fix.residual_rad[:, None],
        errors(fix, truth),
        fix.nis[:, None],
    )
    out[:] = np.concatenate(parts, axis=1).T


CCD = Group(COLUMNS, _fill, "with cameras")
