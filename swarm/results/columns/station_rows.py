"""The telemetry columns of several stations: whose light each craft uses."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period


def station_rows(names: Sequence[str]) -> Group:
    """Return the group of a run with these stations; without any, of one for the reference."""
    columns = [
        Column(f"rows_{name}", "1", f"single sweep angles of station {name} that went into the filter", "small")
        for name in names or ("NAME",)
    ]
    return Group(tuple(columns), _fill, "with [[station]] tables, for every station")


def _fill(period: Period, out: Floats) -> None:
    used = period.estimate.station_rows
    out[:] = np.nan if used is None else used.T
