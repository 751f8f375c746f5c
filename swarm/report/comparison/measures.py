"""The figures of several runs beside each other, from their summaries, each with its ratio to that of the first run."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from swarm.report.numbers import number
from swarm.report.subject import Subject

Figures = Mapping[str, Any]
ARCSEC_PER_RAD = math.degrees(1) * 3600
NOTHING = "–"
MOST_WHOLE = 1e6


class Measure(NamedTuple):
    """A figure of runs. values: of each run in `unit`, None where a run does not have it."""

    name: str
    unit: str
    values: tuple[float | None, ...]

    def ratio(self, run: int) -> float | None:
        """Return the figure of a run over that of the first one."""
        first, value = self.values[0], self.values[run]
        return value / first if first and value is not None else None

    def text(self, run: int) -> str:
        """Return the figure of a run, or a dash."""
        value = self.values[run]
        whole = value is not None and value == round(value) and abs(value) < MOST_WHOLE
        return f"{value:.0f}" if whole else number(value)

    def ratio_text(self, run: int) -> str:
        """Return the ratio of a run, or a dash."""
        ratio = self.ratio(run)
        return NOTHING if ratio is None else f"×{number(ratio)}"


Value = Callable[[Figures], float | None]


def _of(key: str, scale: float = 1.0, inside: str | None = None) -> Value:
    def value(figures: Figures) -> float | None:
        found = figures if inside is None else figures.get(inside) or {}
        figure = found.get(key)
        return scale * figure if isinstance(figure, int | float) and math.isfinite(figure) else None

    return value


_FLOWN: tuple[tuple[str, str, Value], ...] = (
    ("craft", "", _of("craft_count")),
    ("flown", "s", _of("duration_s")),
)
_ERRORS: tuple[tuple[str, str, Value], ...] = tuple(
    (f"{source}{what} error, {which}", shown, _of(f"{key}_{what}_{which.lower()}_{unit}", scale))
    for source, key in (("", "ekf"), ("smoothed ", "smooth"), ("PnP ", "pnp"))
    for what, unit, shown, scale in (("position", "m", "mm", 1000.0), ("attitude", "deg", "°", 1.0))
    for which in ("RMS", "max")
)
_SWARM: tuple[tuple[str, str, Value], ...] = (
    ("tracking", "%", _of("tracking_share", 100)),
    ("photodiodes lit, mean", "", _of("mean_visible")),
    *_ERRORS,
    ("ADOP, mean", "°/rad", _of("mean_adop_deg_per_rad")),
    ("PDOP, mean", "m/rad", _of("mean_pdop_m_per_rad")),
    ("NEES, mean", "", _of("mean", inside="nees")),
    ("NIS, mean", "", _of("mean", inside="nis")),
    ("residual, median", "arcsec", _of("residual_median_rad", ARCSEC_PER_RAD)),
    ("position scatter", "mm", _of("ekf_position_scatter_mm")),
    ("attitude scatter", "°", _of("ekf_attitude_scatter_deg")),
    ("position to peer", "mm", _of("peer_position_scatter_mm")),
    ("attitude to peer", "°", _of("peer_attitude_scatter_deg")),
    ("delta-v per craft", "m/s", _of("delta_v_m_s")),
    ("periods in contact", "", _of("contact_periods")),
)
_COUNTED = {"periods in contact"}
"""Figures that are left out where they are zero in every run."""


def measures(subjects: Sequence[Subject]) -> list[Measure]:
    """Return the figures that at least one run has: of the whole run, of its swarm, of craft with the same sensors."""
    whole = [subject.summary for subject in subjects]
    rows = _rows("", _FLOWN, whole)
    rows += _rows("", _SWARM, [summary.get("swarm") or {} for summary in whole])
    groups = dict.fromkeys(name for summary in whole for name in summary.get("groups") or ())
    for name in groups:
        rows += _rows(f"{name}: ", _ERRORS[:4], [(summary.get("groups") or {}).get(name) or {} for summary in whole])
    rows += _rows("", (("craft docked", "", _docked), ("docked after", "s", _docking_time_s)), whole)
    rows += _rows("", (("criteria held", "", _held), ("criteria missed", "", _missed)), whole)
    return rows


def _rows(prefix: str, columns: Sequence[tuple[str, str, Value]], figures: Sequence[Figures]) -> list[Measure]:
    made = [Measure(prefix + name, unit, tuple(value(one) for one in figures)) for name, unit, value in columns]
    known = [row for row in made if any(value is not None for value in row.values)]
    return [row for row in known if row.name not in _COUNTED or any(row.values)]


def _dockings(summary: Figures) -> list[Figures]:
    return [docking for craft in (summary.get("craft") or {}).values() if (docking := craft.get("docking"))]


def _docked(summary: Figures) -> float | None:
    dockings = _dockings(summary)
    return float(sum(bool(one["docked"]) for one in dockings)) if dockings else None


def _docking_time_s(summary: Figures) -> float | None:
    """Return the time at which the last craft has docked."""
    return max((one["time_s"] for one in _dockings(summary) if one.get("time_s") is not None), default=None)


def _judged(held: bool) -> Value:
    def value(summary: Figures) -> float | None:
        verdicts = summary.get("criteria")
        return float(sum(verdict["held"] is held for verdict in verdicts)) if verdicts else None

    return value


_held, _missed = _judged(True), _judged(False)
