"""The columns that every run has: who and when, poses, errors, dilution, the decoder's counts and the rates."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix
from swarm.onboard.inspection import LIDAR_SENSOR
from swarm.onboard.navigation import Estimate
from swarm.onboard.settings import Coupling, Sensor, Status
from swarm.results.columns.column import Column, Group, fill_pose, pose_columns, rate_columns
from swarm.results.period import Period
from swarm.results.records import Errors, Truth
from swarm.results.rows import estimate_errors_into, pose_errors_into, quaternions_into

STATUS = tuple(status.name.lower() for status in Status)
"""Names of the status codes."""
STATUS_TEXT = tuple("by single sweeps" if status == Status.SINGLE_SWEEPS else status.name.lower() for status in Status)
"""The same as a recording shows them."""
COUPLINGS = tuple(coupling.name.lower() for coupling in Coupling)
"""Names of the codes of the coupling in force."""
SENSORS = tuple(
    "lidar" if code == LIDAR_SENSOR else "+".join(str(flag.name).lower() for flag in Sensor(code)) or "none"
    for code in range(LIDAR_SENSOR + 1)
)
"""Names of the sensor codes: whose pose the filter took in; both cameras are "stereo", the main one "camera"; "lidar":
that of a craft which somebody else observes."""


COLUMNS = (
    Column("time_s", "s", "the epoch: middle of the lighthouse period", required=True),
    Column("frame", "1", "number of the lighthouse period", "whole", required=True),
    Column("craft", "", "name of the craft", "name", required=True),
    Column("status", "", ", ".join(STATUS), "state", STATUS, required=True),
    Column("sensor", "", f"the filter took in: {', '.join(SENSORS)}", "state", SENSORS, required=True),
    Column("visible", "1", "photodiodes seen by both fans", "small", required=True),
    *pose_columns("true", "truth"),
    *pose_columns("pnp", "PnP solution of this period alone"),
    *pose_columns("ekf", "filter's estimate"),
    Column("adop_deg_per_rad", "deg/rad", "attitude dilution of precision, per radian of angle noise (22)"),
    Column("pdop_m_per_rad", "m/rad", "position dilution of precision, per radian of angle noise (22)"),
    Column("pnp_iterations", "1", "Levenberg-Marquardt iterations; null where PnP was not attempted", "small"),
    Column("residual_rad", "rad", "RMS of the PnP solution's angle residuals"),
    Column("pnp_position_error_m", "m", "distance of the PnP solution from the truth"),
    Column("pnp_attitude_error_deg", "deg", "angle of the PnP solution from the truth (25)"),
    Column("position_error_m", "m", "distance of the filter's estimate from the truth"),
    Column("attitude_error_deg", "deg", "angle of the filter's estimate from the truth (25)"),
    Column("position_sigma_m", "m", "root of the trace of the filter's position covariance"),
    Column("attitude_sigma_deg", "deg", "root of the trace of the filter's attitude covariance"),
    Column("nees", "1", "squared pose error normalised by the filter's covariance, 6 degrees of freedom"),
    Column(
        "nis",
        "1",
        "squared innovation normalised by its covariance: 6 degrees of freedom of a pose, or as many as `rows`; also "
        "where it was refused",
    ),
    Column("missed_sync", "1", "sync flashes of the period that were predicted instead of seen", "small"),
    Column("rejected_pulses", "1", "pulses of the period that belonged to nothing", "whole"),
    Column("contact", "", "touched something during the period", "yes"),
    *rate_columns("true", "truth"),
    *rate_columns("ekf", "filter's estimate"),
    Column(
        "coupling",
        "",
        "what the lighthouse's light went into the filter as: none, loose (a pose), tight (single sweeps)",
        "state",
        COUPLINGS,
        required=True,
    ),
    Column("rows", "1", "single sweep angles that went into the filter", "small", required=True),
)
_ROW = {column.name: row for row, column in enumerate(COLUMNS)}


def _rows(first: str, count: int) -> slice:
    return slice(_ROW[first], _ROW[first] + count)


_PNP_ERRORS, _ERRORS = _rows("pnp_position_error_m", 2), _rows("position_error_m", 5)


def core(craft: Sequence[str]) -> Group:
    """Return the group of a run with these craft."""
    names = tuple(craft)
    columns = tuple(column._replace(names=names) if column.name == "craft" else column for column in COLUMNS)
    return Group(columns, partial(_fill, np.arange(len(names)), _no_truth(len(names))))


def errors_in(block: Floats) -> Errors:
    """Return copies of the errors in a filled block of the group, (columns, C)."""
    return Errors(*block[_PNP_ERRORS].copy(), *block[_ERRORS].copy())


def _nearest(place: Floats, turn: Floats, estimate: Estimate) -> tuple[Floats, Floats]:
    """Return the true positions (C, 3) [m] and quaternions (C, 4); of symmetric targets, those nearest to what is
    estimated.
    """
    place, turn = place.copy(), turn.copy()
    for i, group in estimate.symmetry.items():
        true, estimated = matrix_from_quaternion(turn[i]), estimate.rotation[i]
        if np.isfinite(true).all() and np.isfinite(estimated).all():
            rotation, place[i] = group.nearest(true, place[i], estimated)
            turn[i] = quaternion_from_matrix(rotation)
    return place, turn


def _fill(craft: Ints, no_truth: Truth, period: Period, out: Floats) -> None:
    truth, estimate = no_truth if period.truth is None else period.truth, period.estimate
    pnp, flat = estimate.pnp, np.ascontiguousarray
    place, turn = flat(truth.position), flat(truth.quaternion)
    fill_pose(place, turn, out[_rows("true_px_m", 7)])
    position, quaternion = _pose(pnp.rotation, pnp.position, out[_rows("pnp_px_m", 7)])
    pose_errors_into(place, turn, position, quaternion, out[_PNP_ERRORS])
    position, quaternion = _pose(estimate.rotation, estimate.position, out[_rows("ekf_px_m", 7)])
    covariance = flat(estimate.covariance)
    if estimate.symmetry:
        place, turn = _nearest(place, turn, estimate)
    estimate_errors_into(place, turn, position, quaternion, covariance, out[_ERRORS])
    out[_rows("true_vx_m_s", 3)], out[_rows("true_wx_rad_s", 3)] = truth.velocity.T, truth.angular_rate.T
    out[_rows("ekf_vx_m_s", 3)], out[_rows("ekf_wx_rad_s", 3)] = estimate.velocity.T, estimate.angular_rate.T
    for name, value in (
        ("time_s", period.time_s),
        ("frame", period.frame),
        ("craft", craft),
        ("status", estimate.status),
        ("sensor", estimate.sensor),
        ("visible", estimate.visible),
        ("adop_deg_per_rad", estimate.dilution.adop_deg_per_rad),
        ("pdop_m_per_rad", estimate.dilution.pdop_m_per_rad),
        ("pnp_iterations", np.where(pnp.iterations == 0, np.nan, pnp.iterations)),
        ("residual_rad", pnp.residual_rad),
        ("nis", estimate.nis),
        ("coupling", estimate.coupling),
        ("rows", estimate.rows),
        ("missed_sync", estimate.missed_sync),
        ("rejected_pulses", estimate.rejected),
        ("contact", np.nan if period.truth is None else truth.contact),
    ):
        out[_ROW[name]] = value


def _pose(rotation: Floats, position: Floats, out: Floats) -> tuple[Floats, Floats]:
    """Return positions (C, 3) [m] and quaternions (C, 4), and write them into the rows of `pose_columns`."""
    position, quaternion = np.ascontiguousarray(position), np.empty((len(position), 4))
    quaternions_into(np.ascontiguousarray(rotation), quaternion)
    fill_pose(position, quaternion, out)
    return position, quaternion


def _no_truth(craft: int) -> Truth:
    vector, quaternion = np.full((craft, 3), np.nan), np.full((craft, 4), np.nan)
    return Truth(vector, quaternion, vector, vector, np.zeros(craft, dtype=np.bool_))
