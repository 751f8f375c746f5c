"""The tables of a scenario that say what moves the craft beside their control: `[orbit]` and `[craft.actuation]`.

`swarm.flight.builders` turns them into `estimators.relative_orbit` and `swarm.onboard.actuation`.
"""

from typing import Literal

from pydantic import Field

from swarm.scenario.table import Table


class Orbit(Table):
    """The lighthouse's circular orbit around the Earth: craft beside it move by the Clohessy-Wiltshire equations, and
    every craft's computer knows it. Without this table there is weightless space. See docs/orbit.md.
    """

    altitude_km: float = Field(ge=120, le=100000, description="Above the equator's radius, 6378.137 km.")
    boresight: Literal["v-bar", "-v-bar", "r-bar", "-r-bar", "h-bar", "-h-bar"] = Field(
        default="-v-bar",
        description="What the lighthouse looks along: v-bar is its velocity, r-bar points to the Earth, h-bar against "
        "the orbit's angular momentum. Its y axis (down) is r-bar, or where it looks along that, -v-bar.",
    )


class Actuation(Table):
    """How a craft's orders are carried out: by the thrusters (sites `thruster...`) and reaction wheels (`wheel...`) of
    its model. A model without thrusters gets exactly the force that it orders, one without either the torque too.
    See docs/actuation.md.
    """

    ideal: bool = Field(default=False, description="Exactly what is ordered, whatever the model has.")
    thrust_error_percent: float = Field(
        default=0.0, ge=0, le=50, description="Error of a thruster's force, 1 sigma, drawn once per thruster."
    )
    thrust_direction_error_deg: float = Field(
        default=0.0, ge=0, le=30, description="Tilt of a thruster about each axis, 1 sigma, drawn once per thruster."
    )
