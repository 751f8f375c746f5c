"""A trajectory as comma-separated values (RFC 4180): a head with units, a row per pose, columns as in the telemetry."""

from collections.abc import Iterator

import numpy as np

from swarm.exports.trajectory import Trajectory


def table(trajectory: Trajectory) -> Iterator[str]:
    """Yield the lines of a file; what the source does not know has no column."""
    heads = ["frame", "time_s", *(f"p{axis}_m" for axis in "xyz"), *(f"q{axis}" for axis in "wxyz")]
    columns = [trajectory.time_s[:, None], trajectory.position, trajectory.quaternion]
    for more, names in (
        (trajectory.velocity, [f"v{axis}_m_s" for axis in "xyz"]),
        (trajectory.angular_rate, [f"w{axis}_rad_s" for axis in "xyz"]),
        (trajectory.sigma, ["position_sigma_m", "attitude_sigma_deg"]),
    ):
        if more is not None:
            heads, columns = [*heads, *names], [*columns, more]
    yield ",".join(heads)
    for frame, row in zip(trajectory.frame.tolist(), np.concatenate(columns, axis=1).tolist(), strict=True):
        yield ",".join((str(frame), *("" if value != value else repr(value) for value in row)))
