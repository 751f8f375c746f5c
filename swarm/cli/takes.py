"""The time that a flight takes, and times in words.

The time is that of one core of `swarm.studies.papers.catalogue.MACHINE`, by what `benchmarks/whole_loop.py` and
`benchmarks/stations.py` measure (docs/performance.md): per lighthouse period a fixed part, a part per craft, by the
filter that it has, one per craft and station of `[[station]]` tables (to a factor of two: how many a craft sees is not
looked at), and one per pair of cameras and per LiDAR.
"""

from typing import NamedTuple

START_S = 2.0
"""Processor time from the command to the first period [s]."""
RUN_S = 0.5
"""The same for a further run of a study."""
MOST_FILTERPY = 16
"""Craft up to which filterpy filters, four models of motion each."""
PERIOD_S, FILTERPY_S, CRAFT_S, STATION_S, CAMERAS_S, LIDAR_S = 1.7e-3, 0.25e-3, 12e-6, 20e-6, 1.5e-3, 13e-3


class Work(NamedTuple):
    """Contents of every period of a flight: numbers of craft, pairs of cameras, LiDARs, and stations of tables."""

    craft: int
    cameras: int = 0
    lidars: int = 0
    stations: int = 0


def flight_s(periods: float, work: Work) -> float:
    """Return the processor time of a flight of so many lighthouse periods [s]."""
    craft_s = FILTERPY_S if work.craft <= MOST_FILTERPY and not work.stations else CRAFT_S
    craft_s += STATION_S * work.stations
    return periods * (PERIOD_S + craft_s * work.craft + CAMERAS_S * work.cameras + LIDAR_S * work.lidars)


def in_words(seconds: float) -> str:
    """Return a time in words, to about a third: "about 5 s"."""
    if seconds < 90:
        return f"about {max(round(seconds / 5) * 5, 5)} s"
    return f"about {round(seconds / 60)} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"
