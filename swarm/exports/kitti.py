"""The format of KITTI's odometry benchmark: the upper 3 x 4 part of a pose per line, row by row, without time.

Line n of all files of a craft is the same lighthouse period: periods in which one of the sources has no pose are left
out of all of them, and `NAME.times.txt` has the time of each line, as KITTI's `times.txt`.
"""

from collections.abc import Iterator, Sequence
from functools import reduce

import numpy as np

from estimators.rotation import matrix_from_quaternion
from swarm.exports.trajectory import Trajectory


def common(trajectories: Sequence[Trajectory]) -> list[Trajectory]:
    """Return the trajectories of a craft in the periods that all of them have."""
    frames = reduce(np.intersect1d, (one.frame for one in trajectories))
    return [one.part(np.isin(one.frame, frames)) for one in trajectories]


def kitti(trajectory: Trajectory) -> Iterator[str]:
    """Yield the lines of a file."""
    rows = np.concatenate([matrix_from_quaternion(trajectory.quaternion), trajectory.position[..., None]], axis=2)
    for row in rows.reshape(-1, 12).tolist():
        yield " ".join(map(repr, row))


def times(trajectory: Trajectory) -> Iterator[str]:
    """Yield the lines of the file of times [s]."""
    yield from map(repr, trajectory.time_s.tolist())
