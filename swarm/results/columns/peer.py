"""The telemetry columns of a replay: the pose that came with the recording."""

import numpy as np

from estimators.arrays import Floats
from swarm.results.columns.column import Group, fill_pose, pose_columns
from swarm.results.period import Period


def _fill(period: Period, out: Floats) -> None:
    if period.peer is None:
        out[:] = np.nan
    else:
        fill_pose(period.peer.position, period.peer.quaternion, out)


PEER = Group(tuple(pose_columns("peer", "pose that came with the recording, not the truth")), _fill, "in a replay")
