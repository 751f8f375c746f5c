"""The kinds of motion that a craft decides on board, by its own estimate and by what others broadcast.

`swarm.build_guidance` turns these tables into the SI records of `swarm.onboard.guidance`, which compute. See
docs/guidance.md.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.scenario.motions import Length, Mistake, Motion, Table, Time, Vector


class Flown(Table):
    """What every guided motion has: how firmly it is held."""

    deviation_m: float = Field(
        default=0.002,
        gt=0,
        le=100,
        description="A deviation as bad as the effort effort_m_s2: only their ratio counts.",
    )
    effort_m_s2: float = Field(
        default=0.001, gt=0, le=100, description="An acceleration as bad as the deviation deviation_m."
    )


class Clear(Flown):
    """What guided motions have that keep clear of other craft."""

    separation_m: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="Least distance between the centres of this craft and of any that broadcasts. 0: it does not look.",
    )
    brake_m_s2: float = Field(
        default=0.05,
        gt=0,
        le=100,
        description="Acceleration that it counts on to keep clear, and does not exceed then.",
    )


class Dock(Flown):
    """Flies to a docking port by hold points on its axis, retreats where it must, and closes softly to contact."""

    kind: Literal["dock"] = Field(description="Flies an approach to another craft's docking port, to contact.")
    from_m: Vector = Field(description="Where it waits and starts.")
    target: str = Field(description="Name of the craft with the port (a site `port...`); it must hold its place.")
    start_s: float = Field(default=0.0, ge=0, le=86400, description="It does not leave earlier.")
    hold_ranges_m: Annotated[tuple[Length, ...], Strict(False)] = Field(
        default=(1.0,), min_length=1, description="Ranges of the hold points before the port, the farthest first."
    )
    hold_s: Annotated[tuple[Time, ...], Strict(False)] = Field(
        default=(2.0,), min_length=1, description="How long it waits at each hold point: as many."
    )
    speed_m_s: float = Field(default=0.15, gt=0, le=100, description="Its speed at most.")
    glideslope_s: float = Field(
        default=3.0, gt=0.1, le=3600, description="The glideslope: distance to go over the speed flown there."
    )
    acceleration_m_s2: float = Field(default=0.02, gt=0, le=100, description="Its acceleration at most, of the plan.")
    closing_speed_m_s: float = Field(default=0.03, gt=0, le=10, description="Its speed at contact.")
    corridor_radius_m: float = Field(
        default=0.05, gt=0, le=1000, description="The corridor's radius at the port: a larger offset is a retreat."
    )
    corridor_deg: float = Field(default=10.0, ge=0, lt=90, description="Half the corridor's opening angle.")
    corridor_attitude_deg: float = Field(
        default=5.0, gt=0, le=180, description="An attitude farther off than this is a retreat."
    )
    sigma_limit_m: float = Field(
        default=0.05, gt=0, le=1000, description="Less sure of its position than this, it counts as lost, and stops."
    )
    lost_s: float = Field(default=0.25, gt=0, le=3600, description="Without a pose for longer, it is lost, and stops.")
    brake_m_s2: float = Field(default=0.05, gt=0, le=100, description="How hard it brakes when it is lost.")
    settle_s: float = Field(
        default=1.0, ge=0, le=3600, description="So long its navigation must be good before it trusts it."
    )
    retreats: int = Field(default=3, ge=0, le=1000, description="It gives up after more retreats than this.")
    latch_radius_m: float = Field(
        default=0.03, gt=0, le=1000, description="The latch closes on contact within this lateral offset."
    )
    latch_deg: float = Field(default=5.0, gt=0, le=180, description="The latch closes on contact within this angle.")

    def between_keys(self) -> Iterator[Mistake]:
        """As many waits as hold points, which come nearer."""
        if len(self.hold_s) != len(self.hold_ranges_m):
            yield f"has {len(self.hold_s)} times for {len(self.hold_ranges_m)} hold_ranges_m", "hold_s", "hold_ranges_m"
        for i, (before, after) in enumerate(pairwise(self.hold_ranges_m), start=1):
            if after >= before:
                yield f"must come nearer: hold_ranges_m[{i}] = {after} follows {before}", "hold_ranges_m"
        if self.closing_speed_m_s > self.speed_m_s:
            yield f"must be at most speed_m_s = {self.speed_m_s}", "closing_speed_m_s", "speed_m_s"


class Figure(Table):
    """One figure of a formation."""

    at_s: float = Field(default=0.0, ge=0, le=86400, description="From when on; the first one at 0.")
    shape: Literal["ring", "line", "tetrahedron", "projected-circle"] = Field(
        description="The figure; a projected circle is a free motion in the orbit, and needs [orbit]."
    )
    radius_m: float | None = Field(
        default=None, gt=0, le=1000, description="Of a ring, a projected circle, or the sphere about a tetrahedron."
    )
    length_m: float | None = Field(default=None, gt=0, le=1000, description="Of a line, from end to end.")
    centre_m: Vector | None = Field(default=None, description="Its centre. Unset: the formation's.")
    tilt_deg: float = Field(default=0.0, ge=-180, le=180, description="First turn of the figure, about the x axis.")
    turn_deg: float = Field(default=0.0, ge=-180, le=180, description="Second turn of the figure, about the z axis.")
    rate_deg_s: float = Field(default=0.0, ge=-360, le=360, description="How fast it turns about its own z axis.")

    def between_keys(self) -> Iterator[Mistake]:
        """The figure has its size, and no other."""
        size, other = ("length_m", "radius_m") if self.shape == "line" else ("radius_m", "length_m")
        if getattr(self, size) is None:
            yield f"missing: a {self.shape} needs it", size
        if getattr(self, other) is not None:
            yield f"means nothing to a {self.shape}, which has {size}", other
        if self.shape == "projected-circle" and (self.tilt_deg or self.turn_deg or self.rate_deg_s):
            yield "a projected circle lies and turns as the orbit has it: no tilt_deg, turn_deg, rate_deg_s", "shape"


class Formation(Motion, Clear):
    """A swarm in one figure after the other, every craft by its own estimate and by what the others broadcast."""

    kind: Literal["formation"] = Field(description="A swarm that flies from one figure to the next.")
    centre_m: Vector = Field(default=(0.0, 0.0, 4.0), description="The figures' centre.")
    figures: Annotated[tuple[Figure, ...], Strict(False)] = Field(
        min_length=1, description="The figures, in the order of time: a list of tables."
    )
    speed_m_s: float = Field(default=0.1, gt=0, le=100, description="The fastest craft's speed from figure to figure.")

    def between_keys(self) -> Iterator[Mistake]:
        """The figures follow each other."""
        if self.figures[0].at_s != 0:
            yield "the first figure is that in which the craft start: at 0", "figures[0].at_s"
        for i, (before, after) in enumerate(pairwise(self.figures), start=1):
            if after.at_s <= before.at_s:
                yield f"must be later than the figure before it, at {before.at_s} s", f"figures[{i}].at_s"


class Keep(Motion, Clear):
    """Keeps its station; a swarm spreads over a square grid that faces the lighthouse, centred there."""

    kind: Literal["keep"] = Field(description="Keeps its station, held by the regulator, clear of the others.")
    position_m: Vector = Field(default=(0.0, 0.0, 3.0), description="The place; the centre of a swarm's grid.")
    spacing_m: float = Field(default=0.5, gt=0, le=1000, description="Between neighbours in a swarm's grid.")
