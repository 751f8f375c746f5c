"""Rates from poses alone: a craft's angular rate and velocity at every pose, by a straight line through its neighbours.

For poses of one craft at times t_j within `reach_s` of t_i, by least squares over j:

    p_j ~ p_i + a + v (t_j - t_i),    log(R_j R_i^T) ~ b + w (t_j - t_i)

with v and w in the lighthouse frame. A steady acceleration does no harm where the neighbours lie evenly on both sides;
with n of them, spaced by T, the rate's error is sqrt(12) / (T n^1.5) times a pose's.
"""

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats

REACH_S = 0.105
"""Largest distance of a neighbour [s]: six periods of a Lighthouse 1.0 on either side, and rounding."""
FEWEST = 3
"""Poses that a rate needs."""


def pose_rates(time_s: Floats, rotation: Floats, position: Floats, reach_s: float = REACH_S) -> tuple[Floats, Floats]:
    """Return the angular rates (N, 3) [rad/s] and velocities (N, 3) [m/s] of one craft, lighthouse frame.

    A pose that is NaN is no neighbour. Rates are NaN where there are fewer than `FEWEST` poses.

    Args:
        time_s: (N,) [s], increasing.
        rotation: (N, 3, 3) R_l_b.
        position: (N, 3) [m].
        reach_s: largest distance of a neighbour [s].

    Raises:
        ValueError: the times do not increase, or shapes do not fit.
    """
    count = len(time_s)
    if rotation.shape != (count, 3, 3) or position.shape != (count, 3):
        raise ValueError(f"{count} times, but rotation has shape {rotation.shape} and position {position.shape}")
    if np.any(np.diff(time_s) <= 0):
        raise ValueError("time_s must increase")
    known: Bools = np.isfinite(position.sum(axis=1) + rotation.sum(axis=(1, 2)))
    # Sums over the neighbours: how many, of time and time^2, of the six values, of time times value.
    number, first, second = known.astype(np.float64), np.zeros(count), np.zeros(count)
    value, product = np.zeros((count, 6)), np.zeros((count, 6))
    for distance in range(1, count):
        earlier = np.flatnonzero(time_s[distance:] - time_s[:-distance] <= reach_s)
        if not len(earlier):
            break
        earlier = earlier[known[earlier] & known[earlier + distance]]
        for here, there in ((earlier, earlier + distance), (earlier + distance, earlier)):
            late = time_s[there] - time_s[here]
            turned = rot.log(rotation[there] @ np.swapaxes(rotation[here], 1, 2))
            moved = np.concatenate([turned, position[there] - position[here]], axis=1)
            number[here] += 1
            first[here] += late
            second[here] += late**2
            value[here] += moved
            product[here] += late[:, None] * moved
    enough = number >= FEWEST
    spread = np.where(enough, number * second - first**2, 1.0)
    slope = np.where(enough, 1.0, np.nan)[:, None] * (number[:, None] * product - first[:, None] * value)
    slope /= spread[:, None]
    return slope[:, :3], slope[:, 3:]
