"""The corridor in front of a docking port that an approach must not leave: a cone with a blunt tip.

With the range rho and the lateral offset of `swarm.hardware`, a craft is inside where

    lateral <= r + max(rho, 0) tan(c)                                                                               (C2)

and its angle is within a limit of its own.
"""

from dataclasses import dataclass
from math import tan

from swarm.hardware import Closing


@dataclass(frozen=True)
class Corridor:
    """radius_m: r, at the port. half_angle_rad: c. angle_rad: how far the attitude may be off."""

    radius_m: float
    half_angle_rad: float
    angle_rad: float

    def contains(self, at: Closing) -> bool:
        """Whether one craft that stands so is inside."""
        width = self.radius_m + max(float(at.range_m), 0.0) * tan(self.half_angle_rad)
        return bool(at.lateral_m <= width and at.angle_rad <= self.angle_rad)
