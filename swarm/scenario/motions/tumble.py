"""The motion `tumble`."""

from typing import Literal

from pydantic import Field

from swarm.scenario.motions.base import Course, Place, Spread
from swarm.scenario.motions.paths import Path, line
from swarm.scenario.table import AngularRate, Velocity
from swarm.units import si


class Tumble(Spread):
    """The craft flies freely: a constant velocity and a free spin, without force or torque."""

    kind: Literal["tumble"] = Field(description="The craft flies and spins freely, without control.")
    velocity_m_s: Velocity = Field(default=(0.0, 0.0, 0.0), description="Velocity at the start.")
    angular_rate_deg_s: AngularRate = Field(
        default=(0.0, 0.0, 0.0), description="Angular rate at the start, in the lighthouse frame."
    )

    def path(self, place: Place) -> Path:
        """Return a straight line."""
        return line(self.where(place), self.velocity_m_s)

    def course(self, place: Place) -> Course:
        """Return the course of a craft that is left to itself."""
        return super().course(place)._replace(free=True, rate_rad_s=si(self).angular_rate_rad_s)
