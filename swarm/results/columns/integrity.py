"""The telemetry columns of integrity: what a craft makes of its own pose."""

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period

COLUMNS = (
    Column(
        "dropped_photodiodes",
        "1",
        "photodiodes left out as false by the residual test; -1: the pose failed it and was not used",
        "whole",
    ),
    Column("pnp_position_protection_m", "m", "protection level of this period's pose: position"),
    Column("pnp_attitude_protection_deg", "deg", "protection level of this period's pose: attitude"),
    Column("position_protection_m", "m", "protection level of the filter's estimate: position"),
    Column("attitude_protection_deg", "deg", "protection level of the filter's estimate: attitude"),
    Column("alert", "", "a protection level is above its limit, or there is no estimate; null without limits", "yes"),
)
_PLOTS = {"position_protection_m": "protection level", "attitude_protection_deg": "protection level"}


def integrity(watched: bool) -> Group:
    """Return the group; watched: something goes wrong in the run, or may raise an alert, so that levels are plotted."""
    titles = _PLOTS if watched else {}
    columns = tuple(column._replace(plot=titles.get(column.name, "")) for column in COLUMNS)
    return Group(columns, _fill)


def _fill(period: Period, out: Floats) -> None:
    i = period.estimate.integrity
    out[:5] = i.dropped, i.pnp_position_m, i.pnp_attitude_deg, i.position_m, i.attitude_deg
    out[5] = i.alert if i.watched else np.nan
    # An infinite level is none at all.
    out[np.isinf(out)] = np.nan
