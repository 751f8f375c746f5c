"""Several stations: whose light the craft use, and when, and what their beams cost each other."""

import numpy as np

from estimators.arrays import Floats
from swarm.figures import Figure
from swarm.report.figures import Picture, is_narrow, legend, picture, thin
from swarm.report.numbers import number
from swarm.report.page import Column, Section, Table
from swarm.report.series import Series
from swarm.report.subject import Subject

PREFIX = "rows_"
SMOOTH_S = 0.5
"""Time over which the picture takes means [s]."""
MOST_NAMED = 8
"""Stations that have a colour and a name of their own in the picture; the others are one."""


def section(subject: Subject) -> Section | None:
    """Return the section; None for the one lighthouse."""
    series = subject.series
    columns = [name for name in subject.run.telemetry.column_names if name.startswith(PREFIX)]
    used = [np.nan_to_num(series.of(name)[:, series.lit]) for name in columns]
    total = sum(float(rows.sum()) for rows in used)
    if not columns or not total:
        return None
    names = [name.removeprefix(PREFIX) for name in columns]
    rows = [
        [
            name,
            f"{rows.sum():.0f}",
            number(100 * rows.sum() / total),
            number(100 * float(np.mean(rows > 0))),
            f"{np.count_nonzero((rows > 0).any(axis=0))}",
        ]
        for name, rows in zip(names, used, strict=True)
    ]
    head = [
        Column("station"),
        Column("sweep angles in filters"),
        Column("share of all", "%"),
        Column("share of the craft's time with its light", "%"),
        Column("craft with its light"),
    ]
    seen = np.sum([rows > 0 for rows in used], axis=0)
    shares = ", ".join(f"{k} in {100 * np.mean(seen == k):.1f} %" for k in np.unique(seen).tolist())
    text = f"Stations whose sweep angles went into a craft's filter in a period: {shares} of the craft's time."
    return Section("Stations", [text, *_overlaps(series, total)], [_picture(series, names, used)], [Table(head, rows)])


def _overlaps(series: Series, used: float) -> list[str]:
    """Return what beams cost each other, beside the number of sweep angles in filters; nothing where it is unknown."""
    if not series.has("overlaps"):
        return []
    lost = series.of("overlaps")[:, series.lit]
    whole = float(np.nansum(lost))
    text = f"Two stations' beams were on a photodiode at once: {whole:.0f} hits lost"
    if whole:
        text += f", {number(100 * whole / (whole + used))} % of them and the sweep angles in filters together"
        text += f"; at most {np.nanmax(lost):.0f} of a craft in a period"
    return [f"{text}."]


def _smooth(time_s: Floats, values: Floats) -> Floats:
    """Return the means over SMOOTH_S: a rotor's turn and a period beat, so that periods have one sweep or two."""
    if len(time_s) < 2:
        return values
    size = min(max(1, round(SMOOTH_S / float(np.median(np.diff(time_s))))), len(values))
    window = np.ones(size)
    out: Floats = np.convolve(values, window, "same") / np.convolve(np.ones(len(values)), window, "same")
    return out


def _picture(series: Series, names: list[str], used: list[Floats]) -> Picture:
    """Return the sweep angles per craft and period over time, by station on top of each other."""
    mean = [_smooth(series.time_s, rows.mean(axis=1)) for rows in used]
    order = np.argsort([-rows.sum() for rows in mean], kind="stable").tolist()
    drawn = [(names[i], mean[i]) for i in sorted(order[:MOST_NAMED])]
    if len(order) > MOST_NAMED:
        rest = np.sum([mean[i] for i in order[MOST_NAMED:]], axis=0)
        drawn.append((f"{len(order) - MOST_NAMED} others", rest))

    def paint(figure: Figure) -> None:
        axes, bottom = figure.subplots(), np.zeros(1)
        for name, rows in drawn:
            time_s, value = thin(series.time_s, rows)
            axes.fill_between(time_s, bottom, bottom + value, linewidth=0, label=name)
            bottom = bottom + value
        axes.set_ylim(bottom=0)
        axes.set_title("sweep angles per craft and period")
        axes.set_xlabel("time [s]")
        legend(figure, [axes], 2 if is_narrow(figure) else 5)

    return picture(
        "stations", "Sweep angles that went into the filters, by station, mean of the craft.", paint, 3.2, 3.4
    )
