"""The telemetry columns of the actuators: their true work up to the end of the period."""

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period

LEAST_DELTA_V_M_S = 1e-12
"""Below this, an ideal force has made good no more than rounding: it is zero."""

COLUMNS = (
    Column("delta_v_m_s", "m/s", "impulse of the craft's thrusters, or its ideal force, over its mass", plot="delta-v"),
    Column("thrusters_open", "1", "thrusters that were open in the period", "whole", plot="thrusters open"),
    Column("wheel_momentum_nms", "N m s", "momentum of the craft's reaction wheels together", plot="wheel momentum"),
)


def _fill(period: Period, out: Floats) -> None:
    work = period.work
    if work is None:
        out[:] = np.nan
        return
    for row, value in zip(out, (work.delta_v_m_s, work.thrusters_open, work.wheel_momentum_nms), strict=False):
        row[:] = value
    out[0, out[0] < LEAST_DELTA_V_M_S] = 0.0


ACTUATION = Group(COLUMNS, _fill, "with thrusters or wheels")
IDEAL = Group(COLUMNS[:1], _fill, "in a simulation")
"""The group of a run in which no craft has thrusters or wheels."""
