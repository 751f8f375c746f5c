"""Relative navigation: how well craft know where others are in their own axes."""

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Figure
from swarm.report.figures import BLUE, GREY, ORANGE, Picture, legend, panels, picture
from swarm.report.numbers import number
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import mark
from swarm.report.series import Series
from swarm.report.subject import Subject

MOST_PAIRS = 6
"""Pairs that have a picture."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no craft navigates relative to another."""
    series = subject.series
    pairs = _pairs(series)
    if not pairs:
        return None
    told = [_sentence(series, craft, to) for craft, to in pairs]
    return Section("Relative navigation", [*told, *prose("run.txt.j2", "relative")], [_picture(subject, pairs)])


def _pairs(series: Series) -> list[tuple[int, str]]:
    """Return the pairs of a run: index of the craft that knows, name of the other."""
    out = []
    for name in series.names:
        if series.has(f"to_{name}_position_sigma_m"):
            known = np.isfinite(series.of(f"to_{name}_position_sigma_m")).any(axis=0)
            out += [(int(craft), name) for craft in np.flatnonzero(known)]
    return out


def _of(series: Series, craft: int, to: str, column: str) -> Floats:
    out: Floats = series.of(f"to_{to}_{column}")[:, craft]
    return out


def _rms(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else np.nan


def _sentence(series: Series, craft: int, to: str) -> str:
    """Return one pair in figures."""
    parts = {
        name: _of(series, craft, to, name)
        for name in (
            "position_error_m",
            "attitude_error_deg",
            "position_sigma_m",
            "independent_sigma_m",
            "bound_sigma_m",
            "nees",
            "independent_nees",
        )
    }
    sigma = ", ".join(
        f"{number(_rms(parts[f'{name}_sigma_m']), scale=1000)} mm {how}"
        for name, how in (
            ("position", "by what both share"),
            ("independent", "as if both were independent"),
            ("bound", "for any correlation"),
        )
    )
    out = f"{series.names[craft]} knows {to}{_told(series, craft, to)} with a position sigma of {sigma}"
    if not np.isfinite(parts["position_error_m"]).any():
        return f"{out}."
    return (
        f"{out}. The error is {number(_rms(parts['position_error_m']), scale=1000)} mm and "
        f"{number(_rms(parts['attitude_error_deg']))}° RMS, the NEES {number(_mean(parts['nees']))}; as if independent "
        f"it would be {number(_mean(parts['independent_nees']))}."
    )


def _told(series: Series, craft: int, to: str) -> str:
    """Return how much the other craft tells of itself; empty where a run does not have it."""
    span = float(series.time_s[-1] - series.time_s[0])
    if not series.has(f"to_{to}_message_bytes") or not span:
        return ""
    size = _mean(_of(series, craft, to, "message_bytes"))
    rate = size * (len(series.time_s) - 1) / span
    return f", from messages of {size:.0f} bytes, {number(rate, scale=1e-3)} kB/s,"


def _picture(subject: Subject, pairs: list[tuple[int, str]]) -> Picture:
    series, shown = subject.series, pairs[:MOST_PAIRS]

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(shown))
        for one, (craft, to) in zip(axes, shown, strict=True):
            mark(one, subject.strikes)
            error, own, apart = (
                1000 * _of(series, craft, to, name)
                for name in ("position_error_m", "position_sigma_m", "independent_sigma_m")
            )
            one.plot(series.time_s, error, color=BLUE, linewidth=0.8, label="error")
            one.plot(series.time_s, 3 * own, color=ORANGE, label="3σ")
            one.plot(series.time_s, 3 * apart, color=GREY, linestyle=":", label="3σ as if independent")
            one.set_ylim(bottom=0)
            one.set_title(f"{series.names[craft]} to {to}, position [mm]")
            one.set_xlabel("time [s]")
        legend(figure, axes[:1], 3)

    more = f" The first {MOST_PAIRS} of {len(pairs)} pairs." if len(pairs) > MOST_PAIRS else ""
    rows = -(-len(shown) // 2)
    caption = f"Error of the relative position, in the craft's own axes, and three times its sigma.{more}"
    return picture("relative", caption, paint, 0.6 + 2.4 * rows, 0.8 + 2.6 * len(shown))
