"""Reasons why a run missed a criterion, and the end of a docking, in one sentence each: value, time, navigation then.

docking_lateral_at_contact_m: 0.042 (limit: at most 0.01) at 52.3 s; tracking then, 9 of 12 photodiodes lit
no contact: blind since 52.6 s (fault lighthouse-dark), 0 of 4 photodiodes lit, lost 0.50 m before the port
no contact: time ran out at 55.0 s, 1.22 m before the port, in phase approach; blind 25.1 s to 30.2 s, retreated twice
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Ints
from swarm.onboard.guidance.phase import Phase
from swarm.results.columns.guidance import PHASES
from swarm.results.table import TelemetryTable

NO_FAULT, DEAD = "none", "photodiode-dead"
"""What the column `fault` says of a craft with which nothing is wrong, and of one with dead photodiodes."""


WORTH_S = 0.5
"""A shorter time without a pose cost a docking nothing."""
MOST_TOLD = 3
"""Times without a pose that are told at most, the longest ones."""


class Docking(NamedTuple):
    """The end of one craft's docking. docked: the latch has closed; time_s: when, or when it was lost."""

    docked: bool
    time_s: float | None
    sentence: str


def navigation(rows: TelemetryTable, row: int) -> str:
    """Return in words how the craft of a row navigated then: by how many photodiodes, or since when without a pose."""
    tracking = rows.by_light
    if tracking[row]:
        how = "tracking" if rows.being("status", "tracking")[row] else "by single sweeps"
        return f"{how} then{_lit(rows, row)}"
    own = np.flatnonzero(rows.craft[: row + 1] == rows.craft[row])
    had = own[tracking[own]]
    if not len(had):
        return f"no pose until then{_lit(rows, row)}"
    since = own[np.searchsorted(own, had[-1]) + 1]
    return f"blind since {_time(rows, int(since))}{_fault(rows, int(since))}{_lit(rows, int(since))}"


def without_pose(rows: TelemetryTable, own: Ints) -> tuple[int, int] | None:
    """Return the first and the last of a craft's rows `own` in its longest time without a pose; None without any."""
    return max(_times(own, ~rows.by_light[own]), key=lambda span: span[1] - span[0], default=None)


def _times(own: Ints, so: Bools) -> list[tuple[int, int]]:
    """Return the first and the last of the rows `own` of each time in which it was `so`, in order."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], so, [False]]).astype(np.int8)))
    return [(int(own[first]), int(own[past - 1])) for first, past in zip(edge[::2], edge[1::2], strict=True)]


def docking(rows: TelemetryTable, own: Ints) -> Docking | None:
    """Return what became of the docking of the craft whose rows are `own`; None for one that does not dock."""
    if "docking_range_m" not in rows.columns or not np.isfinite(rows.column("docking_range_m")[own]).any():
        return None
    docked = np.flatnonzero(_in_phase(rows, own, Phase.DOCKED))
    if len(docked):
        row = int(own[docked[0]])
        # The rates of the contact are those before it.
        return Docking(True, _seconds(rows, row), f"docked at {_time(rows, row)}, {_offset(rows, _before(rows, own))}")
    touching = np.flatnonzero(rows.column("contact")[own] == 1)
    if len(touching):
        row = int(own[touching[0]])
        told = f"contact at {_time(rows, row)}, but no capture: {_offset(rows, _before(rows, own))} before it"
        return Docking(False, _seconds(rows, row), told)
    row = _decisive(rows, own)
    return Docking(False, _seconds(rows, row), f"no contact: {_why(rows, own, row)}")


def _decisive(rows: TelemetryTable, own: Ints) -> int:
    """Return the row that decided: where the pose was lost for good, or the craft gave up; else the last one."""
    tracking = rows.by_light[own]
    seen = np.flatnonzero(tracking)
    if not tracking[-1] and len(seen):
        return int(own[seen[-1] + 1])
    aborted = np.flatnonzero(_in_phase(rows, own, Phase.ABORTED))
    return int(own[aborted[0]] if len(aborted) else own[-1])


def _why(rows: TelemetryTable, own: Ints, row: int) -> str:
    distance = f"{rows.column('docking_range_m')[row]:.2f} m before the port"
    tracking = rows.by_light
    if not tracking[own].any():
        return f"it never had a pose{_lit(rows, row)}, {distance}"
    if not tracking[own[-1]]:
        return f"blind since {_time(rows, row)}{_fault(rows, row)}{_lit(rows, row)}, lost {distance}"
    phase = _phase(rows, row)
    if phase == Phase.ABORTED.name.lower():
        return f"it gave up after its last retreat, at {_time(rows, row)}, {distance}; {navigation(rows, row)}"
    doing = f", in phase {phase}" if phase else ""
    said = ", ".join(_losses(rows, own)) or navigation(rows, row)
    return f"time ran out at {_time(rows, row)}, {distance}{doing}; {said}"


def _losses(rows: TelemetryTable, own: Ints) -> list[str]:
    """Return what had taken a docking's time: blind times after its first pose, retreats, and waiting."""
    seconds, tracking = rows.column("time_s"), rows.by_light[own]
    # Each time lasts until the next row, in which it is over.
    period = float(np.median(np.diff(seconds[own]))) if len(own) > 1 else 0.0

    def until(last: int) -> float:
        return float(seconds[last]) + period

    since = own[int(np.argmax(tracking)) :]
    blind = [(a, b) for a, b in _times(since, ~rows.by_light[since]) if until(b) - seconds[a] >= WORTH_S]
    longest = sorted(sorted(blind, key=lambda span: span[0] - span[1])[:MOST_TOLD])
    out = [f"blind {seconds[a]:.1f} s to {until(b):.1f} s{_fault(rows, a)}" for a, b in longest]
    if more := len(blind) - len(longest):
        out[-1] += f" and {_often(more)} more"
    if retreats := _times(own, _in_phase(rows, own, Phase.RETREAT)):
        out.append(f"retreated {_often(len(retreats))}")
    waited = sum(until(b) - seconds[a] for a, b in _times(own, _in_phase(rows, own, Phase.WAIT)))
    if waited >= WORTH_S:
        out.append(f"waited {waited:.1f} s for its navigation before it left")
    return out


def _often(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _fault(rows: TelemetryTable, row: int) -> str:
    """Return in brackets what is wrong at a row by the scenario's faults."""
    what = _faults(rows, row)
    return f" ({'faults' if '+' in what else 'fault'} {what})" if what else ""


def _faults(rows: TelemetryTable, row: int) -> str:
    if "fault" not in rows.columns or not np.isfinite(code := rows.column("fault")[row]):
        return ""
    name = rows.names_of("fault")[int(code)]
    return "" if name == NO_FAULT else name


def _before(rows: TelemetryTable, own: Ints) -> int:
    """Return the craft's row before its first contact, its last one without."""
    touching = np.flatnonzero(rows.column("contact")[own] == 1)
    return int(own[max(touching[0] - 1, 0)] if len(touching) else own[-1])


def _offset(rows: TelemetryTable, row: int) -> str:
    lateral, angle, speed = (rows.column(f"docking_{name}")[row] for name in ("lateral_m", "angle_deg", "speed_m_s"))
    return f"{1000 * lateral:.1f} mm beside the axis, {angle:.2f}°, {speed:.3f} m/s"


def _in_phase(rows: TelemetryTable, own: Ints, phase: Phase) -> Bools:
    return rows.being("phase", phase.name.lower())[own]


def _phase(rows: TelemetryTable, row: int) -> str:
    return next((name for name in PHASES if rows.being("phase", name)[row]), "")


def _lit(rows: TelemetryTable, row: int) -> str:
    lit = rows.column("visible")[row] if "visible" in rows.columns else np.nan
    if not np.isfinite(lit):
        return ""
    own = rows.equipment.get(rows.names_of("craft")[rows.craft[row]])
    if own is not None and not own.photodiodes:
        return ""
    # How many of them still work, the telemetry does not say.
    of = "" if own is None or DEAD in _faults(rows, row) else f" of {own.photodiodes}"
    return f", {lit:.0f}{of} photodiodes lit"


def _seconds(rows: TelemetryTable, row: int) -> float:
    return float(rows.column("time_s")[row])


def _time(rows: TelemetryTable, row: int) -> str:
    return f"{_seconds(rows, row):.1f} s"
