"""The summary of a run, from its telemetry: the swarm's figures and every craft's.

Craft that others observe, and those without any sensor, do not find themselves: they count per craft, not in the swarm.
Errors, photodiodes and dilutions of craft with different sensors are not averaged: the swarm then has none of them, and
`groups` has the figures of the craft with the same sensors.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from swarm.results.reasons import docking
from swarm.results.summary.figures import Setting, figures
from swarm.results.summary.pairs import pairs
from swarm.results.summary.scans import scans
from swarm.results.summary.statistics import largest, mean
from swarm.results.table import TelemetryTable

NOTES = {
    "nees": (
        "mean over the samples against its 95 % chi-square band for effective_samples independent ones: "
        "effective craft times periods over the autocorrelation time; craft of the same period share the rotor error"
    ),
    "predicted": "ADOP and PDOP, times the standard deviation of a sweep angle that the craft assume",
    "groups": "craft with the same sensors, where not all have the same; swarm has then only what all have in common",
    "pnp_motion_bias": "least-squares slope of (solution - truth) against the true rate, per axis x, y, z",
}


COMMON = ("samples", "tracking_share", "contact_periods")
"""Figures that craft with different sensors have in common, beside the delta-v."""


class _Craft(NamedTuple):
    """The rows of one craft, which are neighbours. aside: it does not find itself in them."""

    name: str
    aside: bool
    rows: TelemetryTable


class _Sorted(NamedTuple):
    """The rows craft by craft.

    everything: all rows. craft: every craft's. own: those of all craft that find themselves. groups: of these, those
    with the same sensors, by the sensors' names, where not all have the same.
    """

    everything: TelemetryTable
    craft: list[_Craft]
    own: TelemetryTable
    groups: dict[str, TelemetryTable]


def summarise(table: pa.Table) -> dict[str, Any]:
    """Return the summary of a run's telemetry, JSON-able: units in the keys' names, null where nothing is known.

    `swarm` is over all craft, `craft` has the same figures per craft. A replay (a table with peer columns) has no
    truth: its errors are null, and it says how far the peer's poses scatter about the solutions.
    """
    return _summary(TelemetryTable.of(table))


def summarise_run(folder: Path) -> dict[str, Any]:
    """Return the summary of the run in a folder, read column by column. Raises SwarmError where a file is damaged."""
    return _summary(TelemetryTable.of_run(folder)) | scans(folder)


def _summary(table: TelemetryTable) -> dict[str, Any]:
    if not len(table):
        return {"periods": 0, "duration_s": 0.0, "craft_count": 0, "swarm": None, "craft": {}, "notes": NOTES}
    still = set(table.without_sensors)
    everything, parts, own, groups = _by_craft(table, still)
    table.forget()
    periods, span, period_s = _times(everything)
    every = [own, *groups.values(), *(craft.rows for craft in parts)]
    swarm, *rest = figures(every, Setting(period_s, table.angle_noise_rad))
    alike, single = dict(zip(groups, rest, strict=False)), rest[len(groups) :]
    if groups:
        swarm = {key: value if key in COMMON else None for key, value in swarm.items()}
    for craft, of_craft in zip(parts, single, strict=True):
        if craft.name in still:
            of_craft |= {"navigates": False, "tracking_share": None}
        if (end := docking(craft.rows, np.arange(len(craft.rows)))) is not None:
            of_craft["docking"] = end._asdict()
        of_craft |= pairs(craft.rows, period_s)
        if "observer" in table.columns:
            of_craft["observed"] = bool(np.isfinite(craft.rows.column("observer")).any())
    if "delta_v_m_s" in table.columns:
        spent = [largest(craft.rows.column("delta_v_m_s")) for craft in parts]
        for of_craft, delta_v in zip(single, spent, strict=True):
            of_craft["delta_v_m_s"] = delta_v
        by_own = [delta_v for craft, delta_v in zip(parts, spent, strict=True) if not craft.aside]
        swarm["delta_v_m_s"] = mean(np.array(by_own, dtype=np.float64))
    return {
        "periods": periods,
        "duration_s": (span + 1) * period_s,
        "craft_count": len(table.names_of("craft")),
        "swarm": swarm,
        **({"groups": alike} if alike else {}),
        "craft": {craft.name: of_craft for craft, of_craft in zip(parts, single, strict=True)},
        "notes": NOTES,
    }


def _times(rows: TelemetryTable) -> tuple[int, int, float]:
    """Return the number of periods, the last one's number from the first, and the length of a period [s]."""
    frame, time_s = rows.frame, rows.column("time_s")
    first = int(frame.min())
    span = int(frame.max()) - first
    periods = int(np.count_nonzero(np.bincount(frame - first)))
    return periods, span, float(time_s.max() - time_s.min()) / span if span else 0.0


def _by_craft(table: TelemetryTable, still: set[str]) -> _Sorted:
    """Return the rows craft by craft: group by group of those with the same sensors, then those that are aside."""
    names, codes = table.names_of("craft"), table.craft
    aside = np.isin(codes, [names.index(name) for name in still if name in names])
    if "observer" in table.columns:
        aside |= np.isfinite(table.column("observer"))
    equipment = table.equipment
    sensors = [" and ".join(equipment[name].sensors) if name in equipment else "" for name in names]
    finding = np.flatnonzero(np.bincount(codes[~aside]))
    kinds = list(dict.fromkeys(sensors[code] for code in finding.tolist()))
    kind = np.array([kinds.index(each) if each in kinds else 0 for each in sensors], dtype=np.int64)
    last = max(len(kinds), 1)
    ranks = codes + len(names) * np.where(aside, last, kind[codes])
    everything = table.ordered(np.argsort(ranks, kind="stable"))
    past = np.cumsum(np.bincount(ranks, minlength=len(names) * (last + 1))).tolist()
    parts = [
        _Craft(names[rank % len(names)], rank >= last * len(names), everything.part(first, end))
        for rank, (first, end) in enumerate(zip([0, *past], past, strict=False))
        if end > first
    ]
    edges = [0, *(past[(i + 1) * len(names) - 1] for i in range(last))]
    groups = {name: everything.part(edges[i], edges[i + 1]) for i, name in enumerate(kinds)} if len(kinds) > 1 else {}
    return _Sorted(everything, parts, everything.part(0, edges[-1]), groups)
