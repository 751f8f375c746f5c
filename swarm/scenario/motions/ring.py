"""The motion `ring`."""

from math import pi
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from swarm.scenario.limits import FIGURE, TILT, TURNING
from swarm.scenario.motions.base import Place, Turned
from swarm.scenario.motions.paths import Circle, Path
from swarm.scenario.table import Vector
from swarm.units import si


class Ring(Turned):
    """The craft moves on a circle, right-handed about the circle's axis; a swarm is spread evenly over the circle."""

    starts_at: ClassVar[str] = "radius_m"

    kind: Literal["ring"] = Field(description="The craft move on a turning circle, evenly spread.")
    centre_m: Vector = Field(default=(0.0, 0.0, 3.0), description="Centre of the circle.")
    radius_m: Annotated[float, FIGURE] = Field(ge=1e-3, le=1000, description="Radius of the circle.")
    rate_deg_s: Annotated[float, TURNING] = Field(
        default=0.0, ge=-360, le=360, description="Angular rate of the circle about its axis."
    )
    tilt_deg: Annotated[float, TILT] = Field(
        default=0.0,
        ge=-90,
        le=90,
        description="Tilt of the circle's axis from the lighthouse's z axis, about the x axis.",
    )

    def path(self, place: Place) -> Path:
        """Return the circle, with the craft's phase on it."""
        own = si(self)
        return Circle(self.centre_m, self.radius_m, own.rate_rad_s, own.tilt_rad, 2 * pi * place.index / place.count)
