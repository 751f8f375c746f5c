"""The page of one run: its figures, a table of criteria, and a table per craft."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarm.report.page import Column, Fact, Section, Table, number, prose
from swarm.report.run_figures import MOST_PANELS, Series, consistency, dilution, errors, visibility
from swarm.report.run_table import about, limits, outcome
from swarm.report.smooth_figure import is_smoothed, smoothed
from swarm.results.run_folder import Run
from swarm.results.table import TelemetryTable

MOST_ROWS = 60
PROSE = "run.txt.j2"
CRAFT_COLUMNS = (
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
    ("ekf_position_scatter_mm", 1.0, Column("scatter", "mm")),
    ("smooth_position_scatter_mm", 1.0, Column("smoothed scatter", "mm")),
    ("peer_position_scatter_mm", 1.0, Column("peer scatter", "mm")),
)
"""Key in the summary, factor, and head of the table per craft."""


def facts(run: Run) -> list[Fact]:
    """Return the run in a few figures."""
    swarm = run.summary.get("swarm") or {}
    share, craft = number(swarm.get("tracking_share"), scale=100), run.summary["craft_count"]
    out = [Fact("Tracking", f"{share} %", f"of the time, {craft} craft")]
    for name, what, unit, scale in (("Position", "position", "m", 1000), ("Attitude", "attitude", "deg", 1)):
        shown = " mm" if unit == "m" else "°"
        rms, largest = (number(swarm.get(f"ekf_{what}_{which}_{unit}"), scale=scale) for which in ("rms", "max"))
        out.append(Fact(f"{name} error, RMS", f"{rms}{shown}", f"at most {largest}{shown}"))
    if nees := swarm.get("nees"):
        side = "inside" if nees["inside_band"] else "outside"
        out.append(
            Fact(
                "NEES, mean",
                number(nees["mean"]),
                f"{side} the 95 % band {number(nees['band_low'])} to {number(nees['band_high'])}; 6 is consistent",
            )
        )
    out += _smoothed_facts(swarm)
    return [fact for fact in out if not fact.value.startswith("–")]


def _smoothed_facts(swarm: Mapping[str, Any]) -> list[Fact]:
    """Return the gain of the smoother, against the truth or, in a replay, in scatter."""
    ratios = [swarm.get(f"smooth_to_ekf_{what}_ratio") for what in ("position", "attitude")]
    gains = [number(1 / ratio) for ratio in ratios if ratio]
    if len(gains) == 2:
        position, attitude = gains
        return [Fact("Smoothed", f"{position} times", f"below the filter's position error; attitude {attitude} times")]
    before, after = (swarm.get(f"{source}_position_scatter_mm") for source in ("ekf", "smooth"))
    if not before or not after:
        return []
    return [Fact("Scatter, smoothed", f"{number(after)} mm", f"of the filter's positions {number(before)} mm")]


def extent(run: Run) -> str:
    """Return how many craft flew for how long: by the summary, or by the rows where a killed run has no figures."""
    craft, seconds = run.summary.get("craft_count"), run.summary.get("duration_s")
    if craft is not None and seconds is not None:
        return f"{craft} craft, {seconds:.1f} s flown"
    table = run.telemetry
    if not len(table):
        return "nothing recorded"
    time = table.column("time_s").to_numpy()
    return f"{len(table.column('craft').unique())} craft, rows of {time.max() - time.min():.1f} s"


def sections(run: Run) -> list[Section]:
    """Return the sections of a run's page: figures over time, then the craft in a table."""
    if not len(run.telemetry):
        return [Section("Nothing was recorded", ["Not one lighthouse period was recorded."])]
    series = Series(TelemetryTable.of(run.telemetry))
    out = []
    if np.isfinite(series.of("position_error_m")).any():
        which = prose(PROSE, "which", craft=len(series.names)) if len(series.names) > MOST_PANELS else []
        out += [
            Section("Error against what the filter believes", prose(PROSE, "error") + which, [errors(series)]),
            Section("Consistency", prose(PROSE, "consistency"), [consistency(series)]),
        ]
    if is_smoothed(series):
        out.append(Section("Smoothed", prose(PROSE, "smoothed"), [smoothed(series)]))
    return [
        *out,
        Section("Geometry", prose(PROSE, "geometry"), [dilution(series)]),
        Section("Visibility", (), [visibility(series)]),
        *([Section("Criteria", (), (), [_criteria(verdicts)])] if (verdicts := run.summary.get("criteria")) else []),
        *([Section("Craft by craft", (), (), [_table(craft)])] if (craft := run.summary.get("craft")) else []),
    ]


def _criteria(verdicts: Sequence[Mapping[str, Any]]) -> Table:
    rows = [[v["name"], outcome(v).lower(), about(v), number(v["value"]), limits(v)] for v in verdicts]
    return Table([Column(head) for head in ("criterion", "", "craft", "value", "limits")], rows, left=3)


def _table(craft: Mapping[str, Any]) -> Table:
    known = [w for w in CRAFT_COLUMNS if any(figures.get(w[0]) is not None for figures in craft.values())]
    worst = sorted(craft.items(), key=lambda item: -(item[1].get("ekf_position_rms_m") or 0.0))[:MOST_ROWS]
    shown = list(craft.items()) if len(craft) <= MOST_ROWS else worst
    body = []
    for name, figures in shown:
        nees = figures.get("nees")
        band = f"{nees['band_low']:.2f}–{nees['band_high']:.2f}" if nees else "–"
        body.append(
            [
                name,
                *(number(figures.get(key), scale=scale) for key, scale, _ in known),
                number(nees["mean"] if nees else None),
                band,
            ]
        )
    caption = f"The {MOST_ROWS} worst of {len(craft)} craft." if len(shown) < len(craft) else ""
    return Table([Column("craft"), *(c for _, _, c in known), Column("NEES"), Column("95 % band")], body, caption)
