"""Guided flight: the approach of craft that dock, what guidance does, and how far off its reference a craft is."""

import numpy as np

from estimators.arrays import Ints
from swarm.figures import Axes, Figure
from swarm.report.figures import Picture, is_narrow, legend, panels, picture
from swarm.report.findings import dockings
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import lines, mark
from swarm.report.series import Series
from swarm.report.subject import Subject

APPROACH = (
    ("docking_range_m", 1.0, "range of the ports [m]"),
    ("docking_lateral_m", 1000.0, "lateral offset [mm]"),
    ("docking_speed_m_s", 1000.0, "closing speed [mm/s]"),
    ("docking_angle_deg", 1.0, "angle of the ports [°]"),
)
"""Column, factor, label."""
MOST_LANES = 24
PHASE_COLOURS = (
    "#c3ccd6", "#9cc4e4", "#1f6fb4", "#8fd0ae", "#2f8f5b", "#e9c46a",
    "#d9772b", "#c0392b", "#7b5ea7", "#128a94",
)  # fmt: skip
"""Colours of the phases, in their order."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where nobody is guided."""
    series = subject.series
    if not series.has("phase"):
        return None
    guided = np.flatnonzero(np.isfinite(series.of("phase")).any(axis=0))
    pictures = []
    if series.has("docking_range_m"):
        pictures.append(_approach(subject, np.flatnonzero(np.isfinite(series.of("docking_range_m")).any(axis=0))))
    pictures.append(_phases(subject, guided))
    text = prose("run.txt.j2", "guidance", docks=series.has("docking_range_m"))
    ends = [finding.text for finding in dockings(subject.summary.get("craft") or {})]
    return Section("Guidance", [*ends, *text], pictures)


def _approach(subject: Subject, docking: Ints) -> Picture:
    series = subject.series

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(APPROACH))
        for one, (column, scale, label) in zip(axes, APPROACH, strict=True):
            mark(one, subject.strikes)
            if len(docking) == 1:
                _shade(one, series, int(docking[0]))
            lines(one, series, scale * series.of(column), docking)
            one.axhline(0, color="#7d8a97", linewidth=0.8)
            one.set_title(label)
            one.set_xlabel("time [s]")
        legend(figure, axes[:1], 2 if is_narrow(figure) else 12)

    caption = "The approaches in the frame of the target's port."
    if len(docking) == 1:
        name = series.names[int(docking[0])]
        caption = f"The approach of {name} in the frame of the target's port; the background is the phase of guidance."
    return picture("approach", caption, paint, 5.2, 9.4)


def _shade(axes: Axes, series: Series, craft: int) -> None:
    """Colour the background by the phase of a craft."""
    for phase, first_s, past_s in _spans(series, craft):
        axes.axvspan(first_s, past_s, color=_colour(series, phase), alpha=0.3, linewidth=0, label=phase)


def _spans(series: Series, craft: int) -> list[tuple[str, float, float]]:
    """Return the phases of a craft in turn: name, beginning and end [s]."""
    code, words = series.of("phase")[:, craft], series.words("phase")
    code = np.where(np.isfinite(code), code, -1.0).astype(np.int64)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(code) != 0]))
    ends = [*starts[1:].tolist(), len(code) - 1]
    return [
        (words[code[start]], float(series.time_s[start]), float(series.time_s[end]))
        for start, end in zip(starts.tolist(), ends, strict=True)
        if code[start] >= 0
    ]


def _colour(series: Series, phase: str) -> str:
    return PHASE_COLOURS[series.words("phase").index(phase) % len(PHASE_COLOURS)]


def _phases(subject: Subject, guided: Ints) -> Picture:
    series, shown = subject.series, guided[:MOST_LANES].tolist()

    def paint(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 0.4 + 0.32 * len(shown)))
        mark(above, subject.strikes)
        lines(above, series, 1000 * series.of("reference_error_m"), guided, peaks=True)
        above.set_ylim(bottom=0)
        above.set_title("off the reference [mm]")
        for lane, craft in enumerate(shown):
            for phase, first_s, past_s in _spans(series, craft):
                colour = _colour(series, phase)
                below.broken_barh([(first_s, past_s - first_s)], (lane - 0.4, 0.8), color=colour, label=phase)
        below.set_yticks(range(len(shown)), [series.names[i] for i in shown])
        below.set_ylim(len(shown) - 0.5, -0.5)
        below.grid(visible=False)
        below.set_xlabel("time [s]")
        legend(figure, [above, below] if len(guided) > 1 else [below], 3 if is_narrow(figure) else 12)

    more = f" The first {MOST_LANES} of {len(guided)} craft." if len(guided) > MOST_LANES else ""
    caption = f"Distance of the craft from where guidance wants them; below, what guidance does.{more}"
    height_in = 2.9 + 0.24 * len(shown)
    return picture("guidance", caption, paint, height_in, height_in + 0.9)
