"""The work of the actuators: delta-v, thrusters, wheels."""

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.figures import Figure
from swarm.report.figures import legend, panels, picture
from swarm.report.findings import LEAST_DELTA_V
from swarm.report.numbers import number
from swarm.report.page import Column, Section, Table
from swarm.report.sections.consistency import running_mean
from swarm.report.sections.over_time import lines
from swarm.report.series import Series
from swarm.report.subject import Subject

MOST_ROWS = 40
WORK = (
    ("delta_v_m_s", "delta-v [m/s]", False),
    ("thrusters_open", "thrusters open [mean of 1 s]", True),
    ("wheel_momentum_nms", "wheels [N m s]", False),
)
"""Column, label, and whether a second's mean is drawn of it."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no motor worked."""
    series = subject.series
    if not series.has("delta_v_m_s"):
        return None
    spent = np.nanmax(np.where(np.isfinite(v := series.of("delta_v_m_s")), v, 0.0), axis=0)
    craft = np.flatnonzero(spent >= LEAST_DELTA_V)
    if not len(craft):
        return None
    shown = [work for work in WORK if series.has(work[0]) and np.nanmax(np.abs(series.of(work[0]))) >= LEAST_DELTA_V]

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(shown), 3)
        for one, (column, label, smooth) in zip(axes, shown, strict=True):
            lines(one, series, _smooth(series, column) if smooth else series.of(column), craft)
            one.set_title(label)
            one.set_xlabel("time [s]")
            one.set_ylim(bottom=0)
        legend(figure, axes[:1])

    caption = "Work of the actuators: delta-v since the start, open thrusters, momentum of the reaction wheels."
    pictures = [picture("effort", caption, paint, 3.2, 0.6 + 2.4 * len(shown))]
    tables = [_table(series, craft, spent)] if len(shown) > 1 else []
    return Section("Actuators", (), pictures, tables)


def _smooth(series: Series, column: str) -> Floats:
    data = series.of(column)
    out = np.full(data.shape, np.nan)
    for i in range(data.shape[1]):
        centre, mean = running_mean(series.time_s, data[:, i : i + 1])
        known = np.isfinite(mean)
        if known.any():
            out[:, i] = np.interp(series.time_s, centre[known], mean[known])
    return out


def _table(series: Series, craft: Ints, spent: Floats) -> Table:
    order = craft[np.argsort(-spent[craft], kind="stable")]
    opened = series.of("thrusters_open") if series.has("thrusters_open") else None
    wheels = series.of("wheel_momentum_nms") if series.has("wheel_momentum_nms") else None
    columns = [Column("craft"), Column("delta-v", "m/s")]
    columns += [Column("thrusters open", "% of the time")] if opened is not None else []
    columns += [Column("wheels, at most", "N m s")] if wheels is not None else []
    rows = []
    for i in order[:MOST_ROWS].tolist():
        row = [series.names[i], number(spent[i])]
        row += [number(100 * float(np.mean(opened[:, i] > 0)))] if opened is not None else []
        if wheels is not None:
            known = wheels[np.isfinite(wheels[:, i]), i]
            row.append(number(float(known.max()) if known.size else None))
        rows.append(row)
    caption = f"The {MOST_ROWS} that spent most, of {len(order)} craft." if len(order) > MOST_ROWS else ""
    return Table(columns, rows, caption)
