"""The time that a flight takes, and times in words.

The time is that of one core of `swarm.studies.papers.catalogue.MACHINE`, by what `benchmarks/whole_loop.py` measures
(docs/performance.md): per period of 1/60 s a fixed part, a part per craft, and one per pair of cameras and per LiDAR.
"""

START_S = 2.0
"""Processor time from the command to the first period [s]."""
RUN_S = 0.5
"""The same for a further run of a study."""
PERIOD_S, CRAFT_S, CAMERAS_S, LIDAR_S = 1.7e-3, 18e-6, 1.5e-3, 4e-3
RATE_HZ = 60.0


def flight_s(duration_s: float, craft: int, cameras: int = 0, lidars: int = 0) -> float:
    """Return the processor time of a flight [s].

    Args:
        duration_s: Simulated time [s].
        craft: Number of craft.
        cameras: Number of pairs of cameras.
        lidars: Number of LiDARs.
    """
    return duration_s * RATE_HZ * (PERIOD_S + CRAFT_S * craft + CAMERAS_S * cameras + LIDAR_S * lidars)


def in_words(seconds: float) -> str:
    """Return a time in words, to about a third: "about 5 s"."""
    if seconds < 90:
        return f"about {max(round(seconds / 5) * 5, 5)} s"
    return f"about {round(seconds / 60)} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"
