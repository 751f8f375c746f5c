"""The corridor in front of a docking port that an approach must not leave: a cone with a blunt tip.

With the range rho and the lateral offset of `swarm.hardware`, a craft is inside if

    lateral <= r + max(rho, 0) tan(c)                                                                               (C2)

and its angle is within a limit of its own.
"""

from math import tan

from swarm.hardware import Closing
from swarm.units import SI


def in_corridor(dock: SI, at: Closing) -> bool:
    """Return whether one craft is inside its corridor.

    Args:
        dock: the scenario's table, in SI units: r is its corridor_radius_m, c its corridor_rad.
        at: range, offset and angle of the craft's port relative to the target's.
    """
    width = dock.corridor_radius_m + max(float(at.range_m), 0.0) * tan(dock.corridor_rad)
    return bool(at.lateral_m <= width and at.angle_rad <= dock.corridor_attitude_rad)
