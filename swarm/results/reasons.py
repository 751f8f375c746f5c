"""Reasons why a run missed a criterion, and the end of a docking, in one sentence each: value, time, navigation then.

docking_lateral_at_contact_m: 0.042 (limit: at most 0.01) at 52.3 s; tracking then, 9 of 12 photodiodes lit
no contact: blind since 52.6 s (fault lighthouse-dark), 0 of 4 photodiodes lit, lost 0.50 m before the port
no contact: time ran out at 55.0 s, 1.22 m before the port, in phase approach; blind 25.1 s to 30.2 s, retreated twice
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Ints
from swarm.onboard.guidance.phase import Phase
from swarm.onboard.settings import Status
from swarm.results.table import TelemetryTable

SINGLE = Status.SINGLE_SWEEPS.name.lower()
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
        if _word(rows, "status", row) == SINGLE:
            return f"by {_sweeps(rows, row)} then"
        return f"tracking then{_lit(rows, row)}"
    own = np.flatnonzero(rows.craft[: row + 1] == rows.craft[row])
    had = own[tracking[own]]
    if not len(had):
        return f"no pose until then{_lit(rows, row)}"
    since = own[np.searchsorted(own, had[-1]) + 1]
    return f"blind since {_time(rows, int(since))}{_fault(rows, int(since))}{_lit(rows, int(since))}"


def longest_time(own: Ints, so: Bools) -> tuple[int, int] | None:
    """Return the first and the last of a craft's rows `own` in the longest time in which it was `so`; None: never."""
    return max(_times(own, so), key=lambda span: span[1] - span[0], default=None)


def _times(own: Ints, so: Bools) -> list[tuple[int, int]]:
    """Return the first and the last of the rows `own` of each time in which it was `so`, in order."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], so, [False]]).astype(np.int8)))
    return [(int(own[first]), int(own[past - 1])) for first, past in zip(edge[::2], edge[1::2], strict=True)]


def docks(rows: TelemetryTable, own: Ints) -> bool:
    """Return whether the craft whose rows are `own` docks."""
    return "docking_range_m" in rows.columns and bool(np.isfinite(rows.column("docking_range_m")[own]).any())


def touching(rows: TelemetryTable, own: Ints) -> Ints:
    """Return in which of the rows `own` there is contact, counted among them."""
    return np.flatnonzero(rows.column("contact")[own] == 1)


def docking(rows: TelemetryTable, own: Ints) -> Docking | None:
    """Return what became of the docking of the craft whose rows are `own`; None for one that does not dock."""
    if not docks(rows, own):
        return None
    docked = np.flatnonzero(_in_phase(rows, own, Phase.DOCKED))
    if len(docked):
        row = int(own[docked[0]])
        # The rates of the contact are those before it.
        return Docking(True, _seconds(rows, row), f"docked at {_time(rows, row)}, {_offset(rows, _before(rows, own))}")
    touched = touching(rows, own)
    if len(touched):
        row = int(own[touched[0]])
        told = f"contact at {_time(rows, row)}, but no capture: {_offset(rows, _before(rows, own))} before it"
        return Docking(False, _seconds(rows, row), told)
    row, why = _without_contact(rows, own)
    return Docking(False, _seconds(rows, row), f"no contact: {why}")


def _without_contact(rows: TelemetryTable, own: Ints) -> tuple[int, str]:
    """Return why a docking had no contact, and the row that decided.

    That is where the pose was lost for good, or the craft gave up; else the last one.
    """

    def distance(row: int) -> str:
        return f"{rows.column('docking_range_m')[row]:.2f} m before the port"

    tracking = rows.by_light[own]
    seen, aborted = np.flatnonzero(tracking), np.flatnonzero(_in_phase(rows, own, Phase.ABORTED))
    if len(seen) and not tracking[-1]:
        row = int(own[seen[-1] + 1])
        return row, f"blind since {_time(rows, row)}{_fault(rows, row)}{_lit(rows, row)}, lost {distance(row)}"
    row = int(own[aborted[0]] if len(aborted) else own[-1])
    if not len(seen):
        return row, f"it never had a pose{_lit(rows, row)}, {distance(row)}"
    if len(aborted):
        gave_up = f"it gave up after its last retreat, at {_time(rows, row)}, {distance(row)}"
        return row, f"{gave_up}; {navigation(rows, row)}"
    phase = _word(rows, "phase", row)
    doing = f", in phase {phase}" if phase else ""
    said = ", ".join(_losses(rows, own, tracking)) or navigation(rows, row)
    return row, f"time ran out at {_time(rows, row)}, {distance(row)}{doing}; {said}"


def _losses(rows: TelemetryTable, own: Ints, tracking: Bools) -> list[str]:
    """Return what had taken a docking's time: blind times after its first pose, retreats, and waiting."""
    seconds = rows.column("time_s")
    # Each time lasts until the next row, in which it is over.
    period = float(np.median(np.diff(seconds[own]))) if len(own) > 1 else 0.0

    def until(last: int) -> float:
        return float(seconds[last]) + period

    first = int(np.argmax(tracking))
    blind = [(a, b) for a, b in _times(own[first:], ~tracking[first:]) if until(b) - seconds[a] >= WORTH_S]
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
    name = _word(rows, "fault", row)
    return "" if name == NO_FAULT else name


def _word(rows: TelemetryTable, column: str, row: int) -> str:
    """Return what a column of names says at a row; nothing where it is not known."""
    if column not in rows.columns or not np.isfinite(code := rows.column(column)[row]):
        return ""
    return rows.names_of(column)[int(code)]


def _before(rows: TelemetryTable, own: Ints) -> int:
    """Return the craft's row before its first contact, its last one without."""
    touched = touching(rows, own)
    return int(own[max(touched[0] - 1, 0)] if len(touched) else own[-1])


def _offset(rows: TelemetryTable, row: int) -> str:
    lateral, angle, speed = (rows.column(f"docking_{name}")[row] for name in ("lateral_m", "angle_deg", "speed_m_s"))
    return f"{1000 * lateral:.1f} mm beside the axis, {angle:.2f}°, {speed:.3f} m/s"


def _in_phase(rows: TelemetryTable, own: Ints, phase: Phase) -> Bools:
    return rows.being("phase", phase.name.lower())[own]


def _sweeps(rows: TelemetryTable, row: int) -> str:
    """Return how many single sweeps went into the filter; how many photodiodes both fans lit says nothing of them."""
    count = rows.column("rows")[row] if "rows" in rows.columns else np.nan
    if not np.isfinite(count):
        return "single sweeps"
    return f"{count:.0f} single sweep" + ("" if count == 1 else "s")


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
