"""The motion `dock`."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict

from swarm.scenario.limits import (
    ATTITUDE_LIMIT,
    CONTACT_SPEED,
    CORRIDOR,
    GLIDESLOPE,
    LOST,
    RETREATS,
    SETTLING,
)
from swarm.scenario.motions.base import Course, Place
from swarm.scenario.motions.guided import Guided
from swarm.scenario.motions.paths import Path, line
from swarm.scenario.table import Acceleration, Length, Mistake, Pace, Time, Vector


class Dock(Guided):
    """The craft flies to a docking port by hold points on its axis, retreats where it must, and closes softly to
    contact.
    """

    starts_at: ClassVar[str] = "from_m"

    kind: Literal["dock"] = Field(
        description="The craft flies an approach to another craft's docking port, to contact."
    )
    from_m: Vector = Field(description="Point where the craft waits and starts.")
    target: str = Field(
        description="Name of the craft with the docking port (a site `port...`). It must hold its position, unless a "
        "[[pair]] says that this craft navigates relative to it: then it may move and turn."
    )
    start_s: Time = Field(default=0.0, description="Earliest time of the departure.")
    hold_ranges_m: Annotated[tuple[Length, ...], Strict(False)] = Field(
        default=(1.0,), min_length=1, description="Ranges of the hold points before the port, the farthest first."
    )
    hold_s: Annotated[tuple[Time, ...], Strict(False)] = Field(
        default=(2.0,), min_length=1, description="Waiting times at the hold points, one per hold point."
    )
    speed_m_s: Pace = Field(default=0.15, description="Largest speed.")
    glideslope_s: Annotated[float, GLIDESLOPE] = Field(
        default=3.0,
        ge=0.1,
        le=3600,
        description="Time constant of the glideslope: the distance to go over the speed that is flown there.",
    )
    acceleration_m_s2: Acceleration = Field(default=0.02, description="Largest acceleration of the plan.")
    closing_speed_m_s: Annotated[float, CONTACT_SPEED] = Field(
        default=0.03, ge=1e-6, le=10, description="Speed at contact."
    )
    corridor_radius_m: Length = Field(
        default=0.05,
        description="Radius of the corridor at the port; the craft retreats from a larger lateral offset.",
    )
    corridor_deg: Annotated[float, CORRIDOR] = Field(
        default=10.0, ge=0, le=89, description="Half the opening angle of the corridor."
    )
    corridor_attitude_deg: Annotated[float, ATTITUDE_LIMIT] = Field(
        default=5.0,
        ge=1e-3,
        le=180,
        description="Largest attitude error in the corridor; the craft retreats from a larger one.",
    )
    sigma_limit_m: Length = Field(
        default=0.05,
        description="Largest standard deviation of the position; a craft that is less sure counts as lost, and stops.",
    )
    lost_s: Annotated[float, LOST] = Field(
        default=0.25,
        ge=1e-3,
        le=3600,
        description="Longest time without a pose; after that the craft is lost, and stops.",
    )
    brake_m_s2: Acceleration = Field(default=0.05, description="Acceleration by which a lost craft brakes.")
    settle_s: Annotated[float, SETTLING] = Field(
        default=1.0,
        ge=0.1,
        le=3600,
        description="Time for which the navigation must be good before the craft relies on it.",
    )
    retreats: Annotated[int, RETREATS] = Field(
        default=3, ge=0, le=1000, description="Number of retreats after which the craft gives up at the next one."
    )
    latch_radius_m: Length = Field(
        default=0.03, description="Largest lateral offset at which the latch closes on contact."
    )
    latch_deg: Annotated[float, ATTITUDE_LIMIT] = Field(
        default=5.0, ge=1e-3, le=180, description="Largest attitude error at which the latch closes on contact."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require one wait per hold point, and hold points that come nearer."""
        if len(self.hold_s) != len(self.hold_ranges_m):
            yield f"has {len(self.hold_s)} times for {len(self.hold_ranges_m)} hold_ranges_m", "hold_s", "hold_ranges_m"
        for i, (before, after) in enumerate(pairwise(self.hold_ranges_m), start=1):
            if after >= before:
                yield f"must come nearer: hold_ranges_m[{i}] = {after} follows {before}", "hold_ranges_m"
        if self.closing_speed_m_s > self.speed_m_s:
            yield f"must be at most speed_m_s = {self.speed_m_s}", "closing_speed_m_s", "speed_m_s"

    def path(self, place: Place) -> Path:
        """Return a point at rest."""
        return line(self.from_m)

    def course(self, place: Place) -> Course:
        """Return the course of a craft that waits; only the ports' models say how it is turned."""
        return super().course(place)._replace(facing=False)
