"""The telemetry columns of guided craft: what each is doing, where it should be, how it stands to its port.

All values are of the truth at the epoch; rows of craft that are not guided, or do not dock, are null.
"""

import numpy as np

from estimators.arrays import Floats
from swarm.onboard.guidance.phase import Phase
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period

PHASES = tuple(phase.name.lower() for phase in Phase if phase is not Phase.NONE)
"""Names of the phases; `NONE`, not guided, is null."""

COLUMNS = (
    Column("phase", "", f"what its guidance does: {', '.join(PHASES)}", "state", PHASES, "phase"),
    *(Column(f"reference_p{a}_m", "m", f"where its guidance wants it: position, {a}") for a in "xyz"),
    Column(
        "reference_error_m", "m", "distance of the truth from where its guidance wants it", plot="off its reference"
    ),
    Column("gave_way", "", "flew otherwise than it wanted, to keep clear of another craft", "yes"),
)
DOCKING_COLUMNS = (
    Column("docking_range_m", "m", "its port before the target's, along the target's axis", plot="range of the ports"),
    Column("docking_lateral_m", "m", "its port beside the target's axis", plot="lateral offset of the ports"),
    Column("docking_angle_deg", "deg", "angle between the axes of the two ports"),
    Column("docking_speed_m_s", "m/s", "closing speed of the two ports, along the target's axis", plot="closing speed"),
)


def _fill(period: Period, out: Floats) -> None:
    guided, truth = period.guided, period.truth
    out[:] = np.nan
    if guided is None or truth is None:
        return
    out[0], out[1:4], out[5] = guided.phase, guided.reference_m.T, guided.gave_way
    out[4] = np.linalg.norm(truth.position - guided.reference_m, axis=1)
    out[:, guided.phase == Phase.NONE] = np.nan


def _fill_docking(period: Period, out: Floats) -> None:
    out[:] = np.nan
    for craft, at in period.guided.docking if period.guided is not None else ():
        out[:, craft] = at.range_m, at.lateral_m, np.degrees(at.angle_rad), at.speed_m_s


GUIDANCE = Group(COLUMNS, _fill, "with guided craft")
DOCKING = Group(DOCKING_COLUMNS, _fill_docking, "where a craft docks")
