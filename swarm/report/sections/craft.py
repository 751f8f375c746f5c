"""The craft one by one, in a table."""

from collections.abc import Mapping
from typing import Any

from swarm.report.findings import LEAST_DELTA_V, names
from swarm.report.numbers import number
from swarm.report.page import Column, Section, Table
from swarm.report.subject import Subject

MOST_ROWS = 60
COLUMNS = (
    ("tracking_share", 100.0, Column("tracking", "%")),
    ("mean_visible", 1.0, Column("photodiodes lit", "mean")),
    ("ekf_position_rms_m", 1000.0, Column("position RMS", "mm")),
    ("ekf_position_max_m", 1000.0, Column("position max", "mm")),
    ("ekf_attitude_rms_deg", 1.0, Column("attitude RMS", "°")),
    ("ekf_attitude_max_deg", 1.0, Column("attitude max", "°")),
    ("smooth_position_rms_m", 1000.0, Column("smoothed position RMS", "mm")),
    ("smooth_attitude_rms_deg", 1.0, Column("smoothed attitude RMS", "°")),
    ("pnp_position_rms_m", 1000.0, Column("PnP position RMS", "mm")),
    ("mean_adop_deg_per_rad", 1.0, Column("ADOP", "°/rad")),
    ("mean_pdop_m_per_rad", 1.0, Column("PDOP", "m/rad")),
    ("predicted_attitude_deg", 1.0, Column("ADOP × noise", "°")),
    ("predicted_position_m", 1000.0, Column("PDOP × noise", "mm")),
    ("delta_v_m_s", 1.0, Column("delta-v", "m/s")),
    ("ekf_position_scatter_mm", 1.0, Column("scatter", "mm")),
    ("smooth_position_scatter_mm", 1.0, Column("smoothed scatter", "mm")),
    ("peer_position_scatter_mm", 1.0, Column("peer scatter", "mm")),
)
"""Key in the summary, factor, and head of the table per craft."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no craft navigates."""
    craft: Mapping[str, Any] = subject.summary.get("craft") or {}
    navigating = {name: figures for name, figures in craft.items() if figures.get("navigates", True)}
    if not navigating:
        return None
    still = [name for name in craft if name not in navigating]
    text = [f"Left out, because without a sensor they do not navigate: {names(still)}."] if still else []
    groups: Mapping[str, Any] = subject.summary.get("groups") or {}
    if groups:
        text.append(
            "Craft with different sensors have different errors: the first rows are the means of each set of sensors."
        )
    return Section("Craft by craft", text, (), [_table(navigating, groups)])


def _worth_telling(key: str, value: float | None) -> bool:
    return value is not None and not (key == "delta_v_m_s" and value < LEAST_DELTA_V)


def _table(craft: Mapping[str, Any], groups: Mapping[str, Any]) -> Table:
    known = [c for c in COLUMNS if any(_worth_telling(c[0], figures.get(c[0])) for figures in craft.values())]
    worst = sorted(craft.items(), key=lambda item: -(item[1].get("ekf_position_rms_m") or 0.0))[:MOST_ROWS]
    shown = list(craft.items()) if len(craft) <= MOST_ROWS else worst
    consistent = any(figures.get("nees") for figures in craft.values())
    body = []
    for name, figures in [*groups.items(), *shown]:
        told = ((figures.get(key) if _worth_telling(key, figures.get(key)) else None, scale) for key, scale, _ in known)
        row = [name, *(number(value, scale=scale) for value, scale in told)]
        if consistent:
            nees = figures.get("nees")
            row.append(number(nees["mean"] if nees else None))
            row.append(f"{nees['band_low']:.2f}–{nees['band_high']:.2f}" if nees else "–")
        body.append(row)
    heads = [Column("craft"), *(c for _, _, c in known)]
    heads += [Column("NEES"), Column("95 % band")] if consistent else []
    return Table(heads, body, f"The {MOST_ROWS} worst of {len(craft)} craft." if len(shown) < len(craft) else "")
