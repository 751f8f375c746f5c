"""The motion `drift`."""

from typing import Annotated, Literal

from pydantic import Field

from swarm.scenario.limits import PUSH, TURNING_PUSH
from swarm.scenario.motions.base import Course, Place, Spread
from swarm.scenario.motions.paths import Path, line
from swarm.scenario.table import Velocity
from swarm.units import si


class Drift(Spread):
    """The craft is pushed by random forces and torques: white accelerations, constant over each lighthouse period."""

    kind: Literal["drift"] = Field(
        description="Random accelerations push the craft: exactly the model of motion of the navigation filter."
    )
    velocity_m_s: Velocity = Field(default=(0.0, 0.0, 0.0), description="Velocity at the start.")
    acceleration_m_s2: Annotated[float | None, PUSH] = Field(
        default=None,
        ge=0,
        le=100,
        description="Standard deviation of the acceleration per axis. Unset: the navigation filter's process noise.",
    )
    angular_acceleration_deg_s2: Annotated[float | None, TURNING_PUSH] = Field(
        default=None,
        ge=0,
        le=36000,
        description="Standard deviation of the angular acceleration per axis. Unset: the navigation filter's process "
        "noise.",
    )

    def path(self, place: Place) -> Path:
        """Return the straight line that the craft would fly without pushes."""
        return line(self.where(place), self.velocity_m_s)

    def course(self, place: Place) -> Course:
        """Return the course of a craft that is left to itself, and pushed."""
        own, turn = si(self).acceleration_m_s2, si(self).angular_acceleration_rad_s2
        push = (
            place.acceleration_noise_m_s2 if own is None else own,
            place.angular_acceleration_noise_rad_s2 if turn is None else turn,
        )
        return super().course(place)._replace(free=True, push=push)
