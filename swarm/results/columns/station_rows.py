"""The telemetry columns of several stations: how many, and whose light, each craft uses, and what overlaps cost."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period


def station_rows(names: Sequence[str]) -> Group:
    """Return the group of a run with these stations; without any, of one for the reference."""
    columns = [
        Column(
            f"rows_{name.replace(' ', '_')}",
            "1",
            f"single sweep angles of station {name} that went into the filter",
            "small",
        )
        for name in names or ("NAME",)
    ]
    number = Column("stations", "1", "stations whose single sweep angles went into the filter", "small")
    lost = Column(
        "overlaps",
        "1",
        "hits that were lost because the beams of two stations were on a photodiode at once",
        "small",
        plot="hits lost to two beams at once",
    )
    return Group((number, lost, *columns), _fill, "with several stations")


def _fill(period: Period, out: Floats) -> None:
    number, used = period.estimate.stations, period.estimate.station_rows
    out[0] = np.nan if number is None else number
    out[1] = np.nan if period.overlaps is None else period.overlaps
    out[2:] = np.nan if used is None else used.T
