"""Protection levels against errors: the Stanford diagram of every craft's own position, and of those of pairs."""

from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Axes, Figure, decade_ticks, plain_log_x, plain_log_y
from swarm.report.figures import BLUE, GREY, ORANGE, RED, Picture, legend, panels, picture
from swarm.report.numbers import number
from swarm.report.page import Section, prose
from swarm.report.series import Series
from swarm.report.subject import Subject

MOST_DOTS = 20_000
MOST_PANELS = 6
LEAST_MM = 1e-3


class Levelled(NamedTuple):
    """Errors and levels [mm] of one kind, (n,), and the alert limit [mm], None without one."""

    title: str
    error: Floats
    level: Floats
    limit: float | None


def section(subject: Subject) -> Section | None:
    """Return the section, for a run with a truth and levels."""
    kinds = [kind for kind in (_own(subject), *_pairs(subject)) if len(kind.error)]
    if not kinds:
        return None
    told = [_sentence(kind) for kind in kinds]
    return Section("Protection levels", [*told, *prose("run.txt.j2", "protection")], [_picture(kinds)])


def _own(subject: Subject) -> Levelled:
    series = subject.series
    table = _table(_table(subject.scenario, "navigation"), "integrity")
    error, level = (series.of(name)[:, series.navigating] for name in ("position_error_m", "position_protection_m"))
    return _levelled("every craft by itself", error, level, table.get("alert_position_mm"))


def _pairs(subject: Subject) -> list[Levelled]:
    series, told = subject.series, subject.scenario.get("pair")
    pairs = [pair for pair in told if isinstance(pair, dict)] if isinstance(told, list) else []
    out = []
    for pair in pairs:
        craft, to = str(pair.get("craft")), str(pair.get("to"))
        if craft in series.names and series.has(f"to_{to}_position_protection_m"):
            error, level = (_of_pair(series, craft, to, name) for name in ("position_error_m", "position_protection_m"))
            out.append(_levelled(f"{craft} to {to}", error, level, pair.get("alert_position_mm")))
    return out


def _of_pair(series: Series, craft: str, to: str, name: str) -> Floats:
    out: Floats = series.of(f"to_{to}_{name}")[:, series.names.index(craft)]
    return out


def _levelled(title: str, error: Floats, level: Floats, limit: Any) -> Levelled:
    known = np.isfinite(error) & np.isfinite(level)
    return Levelled(title, 1e3 * error[known], 1e3 * level[known], float(limit) if limit else None)


def _table(of: dict[str, Any], name: str) -> dict[str, Any]:
    found = of.get(name)
    return found if isinstance(found, dict) else {}


def _sentence(kind: Levelled) -> str:
    """Return one kind in figures."""
    rms, beyond = float(np.sqrt(np.mean(kind.error**2))), int(np.count_nonzero(kind.error > kind.level))
    out = (
        f"Position, {kind.title}: {len(kind.error)} estimates with an error of {number(rms)} mm RMS and a level of "
        f"{number(float(np.median(kind.level)))} mm (median); {beyond} errors beyond their level, the largest at "
        f"{number(float(np.max(kind.error / kind.level)))} of it."
    )
    if kind.limit is None:
        return out
    raised = int(np.count_nonzero(kind.level > kind.limit))
    hazardous = int(np.count_nonzero((kind.error > kind.limit) & (kind.level <= kind.limit)))
    return f"{out} Alert limit {number(kind.limit)} mm: {raised} alerts, {hazardous} errors above it without one."


def _picture(kinds: list[Levelled]) -> Picture:
    shown = kinds[:MOST_PANELS]

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(shown))
        for one, kind in zip(axes, shown, strict=True):
            _paint(one, kind)
        legend(figure, axes[:1], 3)

    more = f" The first {MOST_PANELS} of {len(kinds)}." if len(kinds) > MOST_PANELS else ""
    alert = "; above the dotted line there is an alert" if any(kind.limit for kind in shown) else ""
    caption = (
        "Stanford diagram: error of the position and its protection level, a dot per craft and period, thinned. A dot "
        f"right of the diagonal is an error beyond its level{alert}.{more}"
    )
    rows = -(-len(shown) // 2)
    return picture("protection", caption, paint, 0.6 + 3.0 * rows, 0.8 + 3.0 * len(shown))


def _paint(axes: Axes, kind: Levelled) -> None:
    """Draw one diagram, on logarithmic axes."""
    every = -(-len(kind.error) // MOST_DOTS)
    error, level = np.maximum(kind.error, LEAST_MM)[::every], np.maximum(kind.level, LEAST_MM)[::every]
    low, high = float(min(error.min(), level.min())) / 1.5, 1.5 * float(max(error.max(), level.max(), kind.limit or 0))
    dots: dict[str, Any] = {"markersize": 3, "markeredgewidth": 0, "rasterized": True}
    axes.plot(error, level, ".", color=BLUE, alpha=0.3, label="estimates", **dots)
    beyond = kind.error > kind.level
    if beyond.any():
        axes.plot(kind.error[beyond], kind.level[beyond], ".", color=RED, label="beyond their level", **dots)
    axes.plot([low, high], [low, high], color=GREY, linewidth=1, label="error = level")
    if kind.limit is not None:
        axes.axhline(kind.limit, color=ORANGE, linestyle=":", label="alert limit")
        axes.axvline(kind.limit, color=ORANGE, linestyle=":")
    plain_log_y(axes)
    plain_log_x(axes, decade_ticks(low, high))
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.set_title(kind.title)
    axes.set_xlabel("error [mm]")
    axes.set_ylabel("protection level [mm]")
