"""Motion of craft that are pushed, as a filter's process noise has it: constant accelerations through a period."""

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.state import State


def pushed(truth: State, acceleration: Floats, angular_acceleration: Floats, time_s: float) -> State:
    """Return the state `time_s` [s] later.

    Args:
        truth: State of C craft.
        acceleration: (C, 3) [m/s^2].
        angular_acceleration: (C, 3) [rad/s^2].
        time_s: Length of the period.
    """
    ahead = truth.ahead(time_s)
    return State(
        rot.exp(angular_acceleration * time_s**2 / 2) @ ahead.rotation,
        ahead.position + acceleration * time_s**2 / 2,
        truth.velocity + acceleration * time_s,
        truth.angular_rate + angular_acceleration * time_s,
    )
