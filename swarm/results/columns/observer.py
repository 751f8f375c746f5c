"""The telemetry column of a run with LiDARs: whose observation the estimate of a passive craft is."""

from collections.abc import Sequence

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Column, Group
from swarm.results.period import Period

FUSED = "fused"
"""Observer of an estimate that several LiDARs make together."""


def observer(craft: Sequence[str], lidar: Sequence[tuple[int, int]]) -> Group:
    """Return the group of these craft; lidar: craft and target of every LiDAR, by index."""
    by = {t: [craft[i] for i, target in lidar if target == t] for _, t in lidar}
    whose = [(by[i][0] if len(by[i]) == 1 else FUSED) if i in by else None for i in range(len(craft))]
    names = tuple(dict.fromkeys(name for name in whose if name is not None))
    code = np.array([np.nan if name is None else names.index(name) for name in whose])
    meaning = f"whose LiDAR the estimate of a passive craft rests on; {FUSED!r}: of several; null: its own estimate"

    def fill(period: Period, out: Floats) -> None:
        out[0] = code

    return Group((Column("observer", "", meaning, "name", names),), fill, "with LiDARs")
