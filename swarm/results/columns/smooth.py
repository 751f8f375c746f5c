"""The columns that `swarm smooth` adds: the craft's states, given all that the filter learned before and after."""

from swarm.results.columns.column import Column, pose_columns, rate_columns

ONLY = "after `swarm smooth`"
"""The runs that have these columns, for the reference."""
ERRORS = (
    Column("smooth_position_error_m", "m", "distance of the smoothed estimate from the truth"),
    Column("smooth_attitude_error_deg", "deg", "angle of the smoothed estimate from the truth (25)"),
    Column("smooth_position_sigma_m", "m", "root of the trace of the smoothed position covariance"),
    Column("smooth_attitude_sigma_deg", "deg", "root of the trace of the smoothed attitude covariance"),
    Column("smooth_nees", "1", "squared pose error normalised by the smoothed covariance, 6 degrees of freedom"),
)
COLUMNS = (*pose_columns("smooth", "smoothed estimate"), *rate_columns("smooth", "smoothed estimate"), *ERRORS)
