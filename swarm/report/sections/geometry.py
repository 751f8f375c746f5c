"""The dilution of precision over time."""

import numpy as np

from swarm.figures import Figure
from swarm.report.figures import legend, panels, picture
from swarm.report.page import Section, prose
from swarm.report.sections.over_time import lines
from swarm.report.subject import Subject

DILUTIONS = (("adop_deg_per_rad", "ADOP [°/rad]"), ("pdop_m_per_rad", "PDOP [m/rad]"))


def section(subject: Subject) -> Section | None:
    """Return the section; None where no craft ever saw enough light."""
    series = subject.series
    if not np.isfinite(series.of("pdop_m_per_rad")[:, series.lit]).any():
        return None

    def paint(figure: Figure) -> None:
        axes = panels(figure, len(DILUTIONS))
        for one, (column, label) in zip(axes, DILUTIONS, strict=True):
            lines(one, series, series.of(column), series.lit)
            one.set_title(label)
            one.set_xlabel("time [s]")
            one.set_ylim(bottom=0)
        legend(figure, axes[:1])

    caption = "Attitude and position dilution of precision, per craft."
    pictures = [picture("dilution", caption, paint, 3.4, 5.6)]
    return Section("Geometry", prose("run.txt.j2", "geometry"), pictures)
