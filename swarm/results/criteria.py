"""Judgement of a run by the criteria of its scenario, on its telemetry.

A criterion's value is a statistic of one column over the rows of its craft and its time, or one of the named measures:

    contacts         rows in contact: craft times periods
    tracking_share   share of the rows in which the craft tracks
    longest_blind_s  the longest time that a craft went without a pose, once it had had one
    separation_m     the least distance between the bodies' origins of any two of its craft, at the epochs

`last` and `at_contact` are one value per craft, its last one and the last one before its first contact: each of them
must lie within the limits, and the one farthest out, or least far in, is reported. What has no value is not held; a
criterion about a time after the end of the run, which a shorter run of a scenario has, is not judged.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from estimators.arrays import Floats, Ints
from swarm.errors import SwarmError, did_you_mean
from swarm.results.table import TelemetryTable
from swarm.scenario import Criterion
from swarm.scenario.criteria import NAMED

PAIRS_AT_A_TIME = 1_000_000
"""Distances between craft that are held in memory at a time."""


class Verdict(NamedTuple):
    """One criterion judged. value: None where there is none; craft: the craft with that value, if it is one craft's;
    about: the craft that the criterion names, none for all. held: None where it is not judged, its time being after the
    end of the run.
    """

    name: str
    value: float | None
    craft: str | None
    min: float | None
    max: float | None
    held: bool | None
    about: tuple[str, ...]


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


def judge(criteria: Sequence[Criterion], rows: TelemetryTable) -> list[Verdict]:
    """Return the verdict on every criterion."""
    return [_judge(criterion, rows) for criterion in criteria]


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
    """Yield the chosen rows of each craft among them."""
    craft = rows.craft[chosen]
    for code in np.unique(craft):
        yield rows.names_of("craft")[code], chosen[craft == code]


def _judge(criterion: Criterion, rows: TelemetryTable) -> Verdict:
    c, mine = criterion, _chosen(rows, criterion)
    if c.from_s > float(rows.column("time_s").max(initial=0.0)):
        return Verdict(c.label, None, None, c.min, c.max, None, c.craft)
    who: str | None = None
    value: float | None = None
    if c.measure in NAMED:
        value = _NAMED[c.measure](rows, mine)
    elif c.statistic in ("last", "at_contact"):
        single = [(name, _single(c, rows, own)) for name, own in _by_craft(rows, mine)]
        # Craft to which the column means nothing have no value; who only never touched anything has missed.
        means = [(name, v) for name, v in single if c.craft or v is not None]
        who, value = min(means, key=lambda pair: _margin(c, pair[1])) if means else (None, None)
    else:
        known = rows.column(c.measure)[mine]
        known = known[np.isfinite(known)]
        value = float(_OVER_ALL[c.statistic](known)) if len(known) else None
    return Verdict(c.label, value, who, c.min, c.max, _margin(c, value) >= 0, c.craft)


def _margin(criterion: Criterion, value: float | None) -> float:
    """Return the distance of a value from the nearer limit; it is negative outside."""
    if value is None:
        return -np.inf
    below = np.inf if criterion.max is None else criterion.max - value
    above = np.inf if criterion.min is None else value - criterion.min
    return float(min(below, above))


def _single(criterion: Criterion, rows: TelemetryTable, own: Ints) -> float | None:
    """Return one craft's last value, or its last one before its first contact."""
    if criterion.statistic == "at_contact":
        touching = np.flatnonzero(rows.column("contact")[own] == 1)
        if not len(touching):
            return None
        own = own[: touching[0]]
    known = rows.column(criterion.measure)[own]
    known = known[np.isfinite(known)]
    return float(known[-1]) if len(known) else None


_OVER_ALL: dict[str, Callable[[Floats], Any]] = {
    "rms": lambda x: np.sqrt(np.mean(x**2)),
    "mean": np.mean,
    "max": np.max,
    "min": np.min,
    "sum": np.sum,
}


def _contacts(rows: TelemetryTable, mine: Ints) -> float | None:
    return float(np.count_nonzero(rows.column("contact")[mine] == 1))


def _tracking_share(rows: TelemetryTable, mine: Ints) -> float | None:
    return float(rows.being("status", "tracking")[mine].mean()) if len(mine) else None


def _longest_blind_s(rows: TelemetryTable, mine: Ints) -> float | None:
    tracking, time_s = rows.being("status", "tracking"), rows.column("time_s")
    longest = None
    for _, own in _by_craft(rows, mine):
        seen = np.flatnonzero(tracking[own])
        if len(seen):
            # Up to the end of the rows, where it never came back.
            at = np.append(time_s[own][seen], time_s[own][-1])
            longest = max(longest or 0.0, float(np.diff(at).max()))
    return longest


def _separation_m(rows: TelemetryTable, mine: Ints) -> float | None:
    place = np.stack([rows.column(f"true_p{a}_m")[mine] for a in "xyz"], axis=1)
    frame, count = rows.column("frame")[mine], len(np.unique(rows.craft[mine]))
    if count < 2:
        return None
    order = np.argsort(frame, kind="stable")
    place = place[order].reshape(-1, count, 3)
    one, other = np.triu_indices(count, 1)
    least, block = np.inf, max(1, PAIRS_AT_A_TIME // len(one))
    for first in range(0, len(place), block):
        part = place[first : first + block]
        least = min(least, float(np.linalg.norm(part[:, one] - part[:, other], axis=2).min()))
    return least


_NAMED: dict[str, Callable[[TelemetryTable, Ints], float | None]] = {
    "contacts": _contacts,
    "tracking_share": _tracking_share,
    "longest_blind_s": _longest_blind_s,
    "separation_m": _separation_m,
}
