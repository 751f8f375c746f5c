"""The summary of a run, from its telemetry: the swarm's figures and every craft's.

Craft that others observe, and those without any sensor, do not find themselves: they count per craft, not in the swarm.
Errors, photodiodes and dilutions of craft with different sensors are not averaged: the swarm then has none of them, and
`groups` has the figures of the craft with the same sensors.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from swarm.results.reasons import docking
from swarm.results.summary.cameras import cameras
from swarm.results.summary.figures import Account, Figures, Setting
from swarm.results.summary.pairs import pairs
from swarm.results.summary.peer import peer_scatter
from swarm.results.summary.scans import scans
from swarm.results.summary.smooth import smoothed
from swarm.results.summary.statistics import Moments, mean
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


def summarise(table: pa.Table) -> dict[str, Any]:
    """Return the summary of a run's telemetry, JSON-able: units in the keys' names, null where nothing is known.

    `swarm` is over all craft, `craft` has the same figures per craft. A replay (a table with peer columns) has no
    truth: its errors are null, and it says how far the peer's poses scatter about the solutions.
    """
    return _summary(TelemetryTable.of(table))


def summarise_run(folder: Path, account: Account | None = None) -> dict[str, Any]:
    """Return the summary of the run in a folder.

    Args:
        folder: The folder.
        account: All rows of the run, where they were taken while it flew; None: they are read, block by block.

    Raises:
        SwarmError: A file is damaged.
    """
    return _summary(TelemetryTable.of_run(folder), account) | scans(folder)


def _summary(table: TelemetryTable, account: Account | None = None) -> dict[str, Any]:
    if account is None:
        account = _account_of(table)
    if not account:
        return {"periods": 0, "duration_s": 0.0, "craft_count": 0, "swarm": None, "craft": {}, "notes": NOTES}
    periods, span, period_s = account.times
    order, own, groups, craft = account.arranged()
    every = [own, *groups.values(), *(part for _, _, part in craft)]
    found = account.figures(every, order, Setting(period_s, table.angle_noise_rad))
    ordered = table.ordered(order)
    parts = [ordered.part(part.first, part.past) for part in every]
    for section in SECTIONS:
        ordered.forget()
        for figures, rows in zip(found, parts, strict=True):
            figures |= section(rows, period_s)
    swarm, *rest = found
    for figures in found[: 1 + len(groups)]:
        for name in EACH:
            figures.pop(name, None)
    alike, single = dict(zip(groups, rest, strict=False)), rest[len(groups) :]
    if groups:
        swarm = {key: value if key in COMMON else None for key, value in swarm.items()}
    for (name, _, part), figures, rows in zip(craft, single, parts[1 + len(groups) :], strict=True):
        if name in table.without_sensors:
            figures |= {"navigates": False, "tracking_share": None}
        if (end := docking(rows, np.arange(part.past - part.first))) is not None:
            figures["docking"] = end._asdict()
        figures |= pairs(rows, period_s)
    if "delta_v_m_s" in table.columns:
        spent = [figures["delta_v_m_s"] for (_, aside, _), figures in zip(craft, single, strict=True) if not aside]
        swarm["delta_v_m_s"] = mean(Moments.of(np.array(spent, dtype=np.float64)))
    return {
        "periods": periods,
        "duration_s": (span + 1) * period_s,
        "craft_count": len(account.names),
        "swarm": swarm,
        **({"groups": alike} if alike else {}),
        "craft": {name: figures for (name, _, _), figures in zip(craft, single, strict=True)},
        "notes": NOTES,
    }


def _account_of(table: TelemetryTable) -> Account:
    """Return the account of all rows of a table."""
    account = Account(table.names_of("craft"), table.without_sensors, list(table.equipment.values()))
    table.forget()
    for rows in table.blocks():
        account.take(rows)
    return account


def _peer(rows: TelemetryTable, period_s: float) -> Figures:
    return peer_scatter(rows) if "peer_px_m" in rows.columns else {}


SECTIONS: tuple[Callable[[TelemetryTable, float], Figures], ...] = (cameras, smoothed, _peer)
"""Figures that need all rows of a part at once: those of its rows, and of the length of a period [s]."""
EACH = ("delta_v_m_s", "observed")
"""Figures that only single craft have."""
