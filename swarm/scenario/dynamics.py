"""The tables of a scenario for the forces on the craft: `[orbit]` and `[craft.actuation]`."""

from typing import Annotated, Literal

from pydantic import Field

from swarm.scenario.limits import ALTITUDE, ANGLE, ELEVATION, THRUST, THRUST_TILT
from swarm.scenario.table import Table


class Orbit(Table):
    """The lighthouse is on a circular orbit around the Earth. Craft near it move by the Clohessy-Wiltshire equations,
    and the computer of every craft knows the orbit. Without this table there is weightless space. See docs/orbit.md.
    """

    altitude_km: Annotated[float, ALTITUDE] = Field(
        ge=120, le=100000, description="Altitude above the radius of the equator, 6378.137 km."
    )
    boresight: Literal["v-bar", "-v-bar", "r-bar", "-r-bar", "h-bar", "-h-bar"] = Field(
        default="-v-bar",
        description="Direction in which the lighthouse looks: v-bar is along its velocity, r-bar points to the Earth, "
        "h-bar is against the orbit's angular momentum. The y axis (down) of the lighthouse is r-bar, or -v-bar where "
        "it looks along r-bar.",
    )
    sun_phase_deg: Annotated[float | None, ANGLE] = Field(
        default=None,
        ge=-360,
        le=360,
        description="Direction of the sun that recordings draw, in the orbit's plane: along the flight from the "
        "lighthouse at the start. Nothing else depends on it. Unset: no sun is drawn.",
    )
    sun_beta_deg: Annotated[float, ELEVATION] = Field(
        default=0.0,
        ge=-90,
        le=90,
        description="Elevation of that sun above the orbit's plane, to its angular momentum.",
    )


class Actuation(Table):
    """The thrusters (sites `thruster...`) and reaction wheels (`wheel...`) of the craft's model carry out its orders. A
    model without thrusters gets exactly the force that it orders; one without either gets exactly the torque too. See
    docs/actuation.md.
    """

    ideal: bool = Field(
        default=False,
        description="Whether the craft gets exactly the force and torque that it orders, whatever its model has.",
    )
    thrust_error_percent: Annotated[float, THRUST] = Field(
        default=0.0, ge=0, le=50, description="Standard deviation of a thruster's force, drawn once per thruster."
    )
    thrust_direction_error_deg: Annotated[float, THRUST_TILT] = Field(
        default=0.0,
        ge=0,
        le=30,
        description="Standard deviation of a thruster's tilt about each axis, drawn once per thruster.",
    )
