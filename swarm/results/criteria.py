"""Judgement of a run by the criteria of its scenario, on its telemetry.

A criterion's value is a statistic of one column over the rows of its craft and its time, or one of the named measures:

    contacts         rows in contact: craft times periods
    tracking_share   share of the rows in which the craft tracks, or navigates by single sweeps
    longest_blind_s  the longest time that a craft went without a pose or single sweeps, once it had had one
    separation_m     the least distance between the bodies' origins of any two of its craft, at the epochs

`last` and `at_contact` are one value per craft, its last one and the last one before its first contact: each of them
must lie within the limits, and the one farthest out, or least far in, is reported. What has no value is not held; a
criterion about a time after the end of the run, which a shorter run of a scenario has, is not judged.

A criterion that is missed says why in a sentence: when its value was reached, and how the craft navigated then.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.results.reasons import docking, docks, longest_time, navigation, touching
from swarm.results.table import TelemetryTable
from swarm.scenario import Criterion
from swarm.scenario.criteria import NAMED
from swarm.units import written_unit

PAIRS_AT_A_TIME = 1_000_000
"""Distances between craft that are held in memory at a time."""


class Verdict(NamedTuple):
    """One criterion judged. value: None where there is none; craft: the craft with that value, if it is one craft's;
    about: the craft that the criterion names, none for all. held: None where it is not judged, its time being after the
    end of the run. time_s: when the value was reached, if it is that of one row; why: the reason, where it is missed,
    without the value and the limits.
    """

    name: str
    value: float | None
    craft: str | None
    min: float | None
    max: float | None
    held: bool | None
    about: tuple[str, ...]
    time_s: float | None = None
    why: str | None = None


class _Found(NamedTuple):
    """A criterion's value.

    who: the craft whose value it is. row: the row of that value, or the one that says most about it; exact: it is that
    of the value. span: finds the first and the last row of the time that it is about, which only a reason tells.
    """

    value: float | None
    who: str | None = None
    row: int | None = None
    exact: bool = True
    span: Callable[[], tuple[int, int] | None] = lambda: None


def check_measures(criteria: Sequence[Criterion], schema: pa.Schema, scenario: str) -> None:
    """Refuse criteria about what a run does not measure.

    Args:
        criteria: The criteria.
        schema: The run's columns.
        scenario: Name of the scenario, for the message.

    Raises:
        SwarmError: A criterion is about neither a named measure nor a column of numbers.
    """

    def counts(kind: pa.DataType) -> bool:
        return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind))

    known = [*NAMED, *(field.name for field in schema if counts(field.type))]
    for i, criterion in enumerate(criteria):
        if criterion.measure not in known:
            raise SwarmError(
                f"scenario {scenario}: criteria[{i}].measure = {criterion.measure!r}: this run measures no such "
                f"number{did_you_mean(criterion.measure, known)}"
            )


def judge(
    criteria: Sequence[Criterion], rows: TelemetryTable, closing_m_s: Mapping[str, float] | None = None
) -> list[Verdict]:
    """Return the verdict on every criterion.

    Args:
        criteria: The criteria.
        rows: The run's telemetry.
        closing_m_s: The commanded speed at contact of each craft that docks, for the reasons.
    """
    return [_commanded(_judge(criterion, rows), criterion, closing_m_s or {}) for criterion in criteria]


def _commanded(verdict: Verdict, c: Criterion, closing_m_s: Mapping[str, float]) -> Verdict:
    """Add the commanded speed to the reason of a missed contact speed."""
    if verdict.why is None or verdict.value is None or (c.measure, c.statistic) != ("docking_speed_m_s", "at_contact"):
        return verdict
    speed = closing_m_s.get(verdict.craft or "")
    return verdict if speed is None else verdict._replace(why=f"{verdict.why}, commanded {speed:g} m/s")


def summary_of(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """Return the entries of summary.json, none without criteria."""
    if not verdicts:
        return {}
    return {
        "criteria_held": all(verdict.held is not False for verdict in verdicts),
        "criteria": [verdict._asdict() for verdict in verdicts],
    }


def _chosen(rows: TelemetryTable, criterion: Criterion) -> Ints:
    """Return the rows that the criterion is about, in their order."""
    time_s = rows.column("time_s")
    mine = (time_s >= criterion.from_s) & (time_s <= (np.inf if criterion.to_s is None else criterion.to_s))
    if criterion.craft:
        names = rows.names_of("craft")
        mine &= np.isin(rows.craft, [i for i, name in enumerate(names) if name in criterion.craft])
    return np.flatnonzero(mine)


def _by_craft(rows: TelemetryTable, chosen: Ints) -> Iterator[tuple[str, Ints]]:
    """Yield the chosen rows of each craft among them, in their order."""
    craft = rows.craft[chosen]
    order = np.argsort(craft, kind="stable")
    codes, first = np.unique(craft[order], return_index=True)
    for code, own in zip(codes.tolist(), np.split(chosen[order], first[1:]), strict=True):
        yield rows.names_of("craft")[code], own


def _judge(criterion: Criterion, rows: TelemetryTable) -> Verdict:
    c, mine = criterion, _chosen(rows, criterion)
    if c.from_s > float(rows.column("time_s").max(initial=0.0)):
        return Verdict(c.label, None, None, c.min, c.max, None, c.craft)
    found = _found(c, rows, mine)
    held = _margin(c, found.value) >= 0
    time_s = float(rows.column("time_s")[found.row]) if found.row is not None and found.exact else None
    why = None if held else _why(c, rows, mine, found)
    who = found.who if c.statistic in ("last", "at_contact") and c.measure not in NAMED else None
    return Verdict(c.label, found.value, who, c.min, c.max, held, c.craft, time_s, why)


def _found(c: Criterion, rows: TelemetryTable, mine: Ints) -> _Found:
    if c.measure in NAMED:
        return _NAMED[c.measure](rows, mine)
    if c.statistic in ("last", "at_contact"):
        single = [(name, *_single(c, rows, own)) for name, own in _by_craft(rows, mine)]
        # Craft to which the column means nothing have no value; who only never touched anything has missed.
        means = [_Found(v, name, row) for name, v, row in single if c.craft or v is not None]
        return min(means, key=lambda found: _margin(c, found.value)) if means else _Found(None)
    column = rows.column(c.measure)
    known = mine[np.isfinite(column[mine])]
    if not len(known):
        return _Found(None)
    value = float(_OVER_ALL[c.statistic](column[known]))
    pick = {"max": np.argmax, "min": np.argmin}.get(c.statistic)
    at = int(np.argmax(np.abs(column[known]))) if pick is None else int(pick(column[known]))
    return _Found(value, None, int(known[at]), exact=pick is not None)


def _why(c: Criterion, rows: TelemetryTable, mine: Ints, found: _Found) -> str:
    """Return why a criterion is missed."""
    own = mine if found.row is None else mine[rows.craft[mine] == rows.craft[found.row]]
    if found.who is not None:
        own = mine[rows.craft[mine] == rows.names_of("craft").index(found.who)]
    elif found.row is None and c.measure.startswith("docking_"):
        own = next((each for _, each in _by_craft(rows, mine) if docks(rows, each)), own)
    about_docking = c.measure.startswith("docking_") or c.statistic == "at_contact"
    if about_docking and len(own) and (end := docking(rows, own)) is not None and not end.docked:
        return end.sentence
    if (span := found.span()) is not None:
        first, last = (float(rows.column("time_s")[row]) for row in span)
        who = rows.names_of("craft")[rows.craft[span[0]]]
        return f"{who} from {first:.1f} s to {last:.1f} s; {navigation(rows, span[0])}"
    if found.row is None:
        return "never in contact" if c.statistic == "at_contact" else _nothing(rows, mine)
    who, at = rows.names_of("craft")[rows.craft[found.row]], float(rows.column("time_s")[found.row])
    most = ""
    if not found.exact and c.measure not in NAMED:
        most = f"largest, {rows.column(c.measure)[found.row]:.4g} {written_unit(c.measure)}".rstrip() + ", "
    most = "first " if c.measure == "contacts" else most
    return f"{most}{who} at {at:.1f} s; {navigation(rows, found.row)}"


def _nothing(rows: TelemetryTable, mine: Ints) -> str:
    return navigation(rows, int(mine[-1])) if len(mine) else "no row of these craft at these times"


def _margin(criterion: Criterion, value: float | None) -> float:
    """Return the distance of a value from the nearer limit; it is negative outside."""
    if value is None:
        return -np.inf
    below = np.inf if criterion.max is None else criterion.max - value
    above = np.inf if criterion.min is None else value - criterion.min
    return float(min(below, above))


def _single(criterion: Criterion, rows: TelemetryTable, own: Ints) -> tuple[float | None, int | None]:
    """Return one craft's last value, or its last one before its first contact, and the row of it."""
    if criterion.statistic == "at_contact":
        touched = touching(rows, own)
        if not len(touched):
            return None, None
        own = own[: touched[0]]
    column = rows.column(criterion.measure)
    known = own[np.isfinite(column[own])]
    return (float(column[known[-1]]), int(known[-1])) if len(known) else (None, None)


_OVER_ALL: dict[str, Callable[[Floats], Any]] = {
    "rms": lambda x: np.sqrt(np.mean(x**2)),
    "mean": np.mean,
    "max": np.max,
    "min": np.min,
    "sum": np.sum,
}


def _contacts(rows: TelemetryTable, mine: Ints) -> _Found:
    touched = mine[touching(rows, mine)]
    row = int(touched[0]) if len(touched) else None
    return _Found(float(len(touched)), None, row, exact=False)


def _tracking_share(rows: TelemetryTable, mine: Ints) -> _Found:
    if not len(mine):
        return _Found(None)
    by_light = rows.by_light

    def longest() -> tuple[int, int] | None:
        gaps = (longest_time(own, ~by_light[own]) for _, own in _by_craft(rows, mine))
        return max(filter(None, gaps), key=lambda gap: gap[1] - gap[0], default=None)

    return _Found(float(by_light[mine].mean()), span=longest)


def _longest_blind_s(rows: TelemetryTable, mine: Ints) -> _Found:
    tracking, time_s = rows.by_light, rows.column("time_s")
    longest = _Found(None)
    for _, own in _by_craft(rows, mine):
        seen = np.flatnonzero(tracking[own])
        if len(seen):
            # Up to the end of the rows, where it never came back.
            at = np.append(seen, len(own) - 1)
            blind = np.diff(time_s[own][at])
            i = int(np.argmax(blind))
            if longest.value is None or blind[i] > longest.value:
                first = min(at[i] + 1, len(own) - 1)
                span = int(own[first]), int(own[at[i + 1]])
                longest = _Found(float(blind[i]), span=lambda span=span: span)  # type: ignore[misc]
    return longest


def _separation_m(rows: TelemetryTable, mine: Ints) -> _Found:
    place = np.stack([rows.column(f"true_p{a}_m")[mine] for a in "xyz"], axis=1)
    frame, count = rows.column("frame")[mine], len(np.unique(rows.craft[mine]))
    if count < 2:
        return _Found(None)
    order = np.argsort(frame, kind="stable")
    place = place[order].reshape(-1, count, 3)
    one, other = np.triu_indices(count, 1)
    least, row, block = np.inf, 0, max(1, PAIRS_AT_A_TIME // len(one))
    for first in range(0, len(place), block):
        part = place[first : first + block]
        apart = np.linalg.norm(part[:, one] - part[:, other], axis=2)
        if float(apart.min()) < least:
            least = float(apart.min())
            at, pair = np.unravel_index(int(apart.argmin()), apart.shape)
            row = int(mine[order[(first + at) * count + one[pair]]])
    return _Found(least, None, row)


_NAMED: dict[str, Callable[[TelemetryTable, Ints], _Found]] = {
    "contacts": _contacts,
    "tracking_share": _tracking_share,
    "longest_blind_s": _longest_blind_s,
    "separation_m": _separation_m,
}
