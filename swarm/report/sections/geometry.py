"""The dilution of precision over time."""

import numpy as np

from swarm.figures import Figure
from swarm.report.figures import legend, panels, picture
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import lines
from swarm.report.subject import Subject

DILUTIONS = (("adop_deg_per_rad", "ADOP [°/rad]"), ("pdop_m_per_rad", "PDOP [m/rad]"))

SPIKE = 100.0
"""Largest dilution, of its median, that a linear axis shows."""


def section(subject: Subject) -> Section | None:
    """Return the section; None where no craft ever saw enough light."""
    series = subject.series
    if not np.isfinite(series.of("pdop_m_per_rad")[:, series.lit]).any():
        return None

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(DILUTIONS))
        for one, (column, label) in zip(axes, DILUTIONS, strict=True):
            values = series.of(column)
            lines(one, series, values, series.lit)
            one.set_title(label)
            one.set_xlabel("time [s]")
            known = values[:, series.lit]
            if np.nanmax(known) > SPIKE * np.nanmedian(known):
                one.set_yscale("log")  # a few periods that decide hardly anything would hide all others
            else:
                one.set_ylim(bottom=0)
        legend(figure, axes[:1])

    caption = "Attitude and position dilution of precision, per craft."
    pictures = [picture("dilution", caption, paint, 3.4, 5.6)]
    return Section("Geometry", prose("run.txt.j2", "geometry"), pictures)
