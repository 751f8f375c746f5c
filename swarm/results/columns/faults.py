"""The telemetry column of a run with faults: what is wrong in truth."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period

MEANING = "what is wrong with the craft, or the lighthouse; the craft is not told"


def faults(names: Sequence[str]) -> Group:
    """Return the group of a run; names: meanings of the codes in `Period.fault`."""
    return Group((Column("fault", "", MEANING, "state", tuple(names), "fault"),), _fill, "with [[fault]] tables")


def _fill(period: Period, out: Floats) -> None:
    out[0] = np.nan if period.fault is None else period.fault
