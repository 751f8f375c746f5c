"""The format of TUM's RGB-D benchmark: a line `time x y z qx qy qz qw` per pose, in seconds and metres.

Source: vision.in.tum.de, "File Formats" of the RGB-D SLAM dataset and benchmark.
"""

from collections.abc import Iterator

from estimators.rotation import xyzw_from_wxyz
from swarm.exports.trajectory import MEANINGS, Trajectory


def tum(trajectory: Trajectory) -> Iterator[str]:
    """Yield the lines of a file. Numbers have 17 digits: read again, they are the same numbers."""
    yield f"# {trajectory.craft}: {MEANINGS[trajectory.source]}; lighthouse frame, x right, y down, z forward"
    yield "# time_s x_m y_m z_m qx qy qz qw"
    for time_s, position, quaternion in zip(
        trajectory.time_s.tolist(),
        trajectory.position.tolist(),
        xyzw_from_wxyz(trajectory.quaternion).tolist(),
        strict=True,
    ):
        yield " ".join(map(repr, (time_s, *position, *quaternion)))
