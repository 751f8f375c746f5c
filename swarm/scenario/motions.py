"""The `motion` table of a scenario: one frozen pydantic model per kind, told apart by `kind`.

Positions are metres in the lighthouse frame (x right, y down, z forward, away from the lighthouse).
`swarm.flight.builders` turns these tables into the SI records of `swarm.world.motion.fleet`, which compute.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator
from pydantic_core import PydanticCustomError

Component = Annotated[float, Field(ge=-1000, le=1000)]
Extent = Annotated[float, Field(ge=0, le=1000)]
Length = Annotated[float, Field(gt=0, le=1000)]
Time = Annotated[float, Field(ge=0, le=86400)]
Vector = Annotated[tuple[Component, Component, Component], Strict(False)]
"""Three numbers; a TOML list becomes a tuple (hence not strict), its elements stay strict."""
Box = Annotated[tuple[Length, Length, Length], Strict(False)]
"""The size of a box along x, y, z."""


Mistake = tuple[str, ...]
"""What is wrong between several keys: a message, the key to blame, and the others that could be changed instead."""


class Table(BaseModel):
    """One TOML table: frozen, no unknown key, no silent conversion, no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def between_keys(self) -> Iterator[Mistake]:
        """Every mistake that lies between several keys, each of them good by itself."""
        yield from ()

    @model_validator(mode="after")
    def _check_between_keys(self) -> Self:
        if mistakes := list(self.between_keys()):
            raise PydanticCustomError("between_keys", "{text}", {"text": mistakes[0][0], "mistakes": mistakes})
        return self


class Attitude(Table):
    """How a craft is turned while it follows its motion."""

    facing: bool = Field(
        default=True,
        description="Whether the front (body +z) follows the direction to the lighthouse. If false, the angles below "
        "are absolute, against the lighthouse frame.",
    )
    roll_deg: float = Field(default=0.0, ge=-360, le=360, description="Third turn, about the body's z axis.")
    pitch_deg: float = Field(default=0.0, ge=-360, le=360, description="Second turn, about the body's y axis.")
    yaw_deg: float = Field(default=0.0, ge=-360, le=360, description="First turn, about the body's x axis.")
    spin_deg_s: float = Field(default=0.0, ge=-3600, le=3600, description="Steady spin about the body's z axis.")


class Motion(Table):
    """What every kind of motion has."""

    attitude: Attitude = Field(default=Attitude(), description="How the craft is turned meanwhile.")


class Hold(Motion):
    """Stays at one place; a swarm spreads over a square grid that faces the lighthouse, centred there."""

    kind: Literal["hold"] = Field(description="Stays at one place.")
    position_m: Vector = Field(default=(0.0, 0.0, 3.0), description="The place; the centre of a swarm's grid.")
    spacing_m: float = Field(default=0.5, gt=0, le=1000, description="Between neighbours in a swarm's grid.")
    box_m: Box | None = Field(
        default=None,
        description="A swarm fills a box of this size, centred there, each craft at a place that does not depend on "
        "their number. Unset: the grid.",
    )


class Ring(Motion):
    """A circle that turns about its centre; a swarm is spread evenly over it."""

    kind: Literal["ring"] = Field(description="A turning circle, the swarm spread evenly over it.")
    centre_m: Vector = Field(default=(0.0, 0.0, 3.0), description="The circle's centre.")
    radius_m: float = Field(gt=0, le=1000, description="The circle's radius.")
    rate_deg_s: float = Field(default=0.0, ge=-360, le=360, description="How fast it turns about its axis.")
    tilt_deg: float = Field(
        default=0.0, ge=-90, le=90, description="Its axis against the lighthouse's z axis, tilted about the x axis."
    )


class Waypoints(Motion):
    """Passes through points at given times, and stays at the last."""

    kind: Literal["waypoints"] = Field(description="Passes through points at given times.")
    points_m: Annotated[tuple[Vector, ...], Strict(False)] = Field(min_length=1, description="The points, in order.")
    times_s: Annotated[tuple[Time, ...], Strict(False)] = Field(
        min_length=1, description="When to be at each point: as many, strictly increasing."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """As many times as points, in order."""
        if len(self.times_s) != len(self.points_m):
            yield f"has {len(self.times_s)} times for {len(self.points_m)} points_m", "times_s", "points_m"
        for i, (before, after) in enumerate(pairwise(self.times_s), start=1):
            if after <= before:
                yield f"must increase strictly: times_s[{i}] = {after} follows {before}", "times_s"


class Approach(Motion):
    """A straight corridor, flown with a smooth start and stop, as in a docking."""

    kind: Literal["approach"] = Field(description="Flies a straight corridor from one point to another.")
    from_m: Vector = Field(description="Where it waits and starts.")
    to_m: Vector = Field(description="Where it stops and stays.")
    start_s: float = Field(default=0.0, ge=0, le=86400, description="When it starts.")
    speed_m_s: float = Field(gt=0, le=100, description="Cruising speed.")

    def between_keys(self) -> Iterator[Mistake]:
        """The corridor has a length."""
        if self.from_m == self.to_m:
            yield "is where the approach starts already (from_m)", "to_m", "from_m"


class Tumble(Motion):
    """Free flight: a steady velocity and a free spin, no force and no torque."""

    kind: Literal["tumble"] = Field(description="Free flight and free spin, without control.")
    position_m: Vector = Field(default=(0.0, 0.0, 3.0), description="Where it starts; the centre of a swarm's grid.")
    velocity_m_s: Vector = Field(default=(0.0, 0.0, 0.0), description="Velocity at the start.")
    angular_rate_deg_s: Vector = Field(
        default=(0.0, 0.0, 0.0), description="Angular rate at the start, lighthouse frame."
    )
    spacing_m: float = Field(default=0.5, gt=0, le=1000, description="Between neighbours in a swarm's grid.")
    box_m: Box | None = Field(
        default=None,
        description="A swarm fills a box of this size, centred there, each craft at a place that does not depend on "
        "their number. Unset: the grid.",
    )


class Drift(Motion):
    """Pushed by random forces and torques: white accelerations, constant over each lighthouse period."""

    kind: Literal["drift"] = Field(description="Random accelerations: exactly the navigation filter's own model.")
    position_m: Vector = Field(default=(0.0, 0.0, 3.0), description="Where it starts; the centre of a swarm's grid.")
    velocity_m_s: Vector = Field(default=(0.0, 0.0, 0.0), description="Velocity at the start.")
    spacing_m: float = Field(default=0.5, gt=0, le=1000, description="Between neighbours in a swarm's grid.")
    box_m: Box | None = Field(
        default=None,
        description="A swarm fills a box of this size, centred there, each craft at a place that does not depend on "
        "their number. Unset: the grid.",
    )
    acceleration_m_s2: float | None = Field(
        default=None, ge=0, le=100, description="1 sigma per axis. Unset: the navigation filter's own value."
    )
    angular_acceleration_deg_s2: float | None = Field(
        default=None, ge=0, le=36000, description="1 sigma per axis. Unset: the navigation filter's own value."
    )


class Wander(Motion):
    """Moved about at random as by a hand: smooth, within a box, without any frequency above its bandwidth."""

    kind: Literal["wander"] = Field(description="Moved about at random as by a hand.")
    centre_m: Vector = Field(default=(0.0, 0.0, 3.0), description="The middle of the box that it never leaves.")
    size_m: Annotated[tuple[Extent, Extent, Extent], Strict(False)] = Field(
        default=(1.0, 1.0, 1.0), description="The box's edges; along an edge of 0 it does not move."
    )
    speed_m_s: float = Field(
        default=0.3, ge=0, le=100, description="RMS speed, shared among the axes as the box's edges are."
    )
    turn_deg: float = Field(
        default=30.0, ge=0, le=180, description="It turns by up to this about each body axis, beside its attitude."
    )
    turn_rate_deg_s: float = Field(default=30.0, ge=0, le=3600, description="RMS angular rate of that turning.")
    bandwidth_hz: float = Field(default=1.0, gt=0, le=30, description="The highest frequency in it.")
