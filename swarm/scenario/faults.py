"""The `[[fault]]` tables of a scenario: one table per kind, told apart by `kind`.

A fault strikes at a time, or at random with a probability per second, and lasts for a time, until a time, or for good.
`swarm.flight.faults.injection` makes it happen. A new kind is a table here, an entry in `AnyFault`, and its effect
there.
"""

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field, Strict

from swarm.scenario.limits import GHOST_SPREAD, MOMENT, NUMBER, ONCE, RESTART, SHARE, SPAN, SWING, SWING_TIME
from swarm.scenario.table import AngularRate, Mistake, Table, Velocity


def _listed(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], BeforeValidator(_listed), Strict(False)]
"""Names of craft; one by itself need not be a list."""
Numbers = Annotated[tuple[Annotated[int, Field(ge=0, le=1000), NUMBER], ...], Strict(False)]


class Strike(Table):
    """The time at which a fault strikes."""

    at_s: Annotated[float | None, MOMENT] = Field(
        default=None, ge=0, le=86400, description="Time at which the fault strikes. Unset: at random."
    )
    probability_per_s: Annotated[float | None, ONCE] = Field(
        default=None,
        ge=1e-9,
        le=10,
        description="Probability per second that the fault strikes, for each craft by itself where the fault is one "
        "of craft. Unset: at at_s.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require either a time or a probability."""
        if (self.at_s is None) == (self.probability_per_s is None):
            yield "needs either at_s or probability_per_s, to say when it strikes", "at_s", "probability_per_s"


class Lasting(Strike):
    """A fault that lasts."""

    for_s: Annotated[float | None, SPAN] = Field(
        default=None,
        ge=1e-3,
        le=86400,
        description="Duration of the fault. Unset: until until_s, or to the end of the run.",
    )
    until_s: Annotated[float | None, SPAN] = Field(
        default=None, ge=1e-3, le=86400, description="Time at which the fault ends. Unset: see for_s."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require one end, after the beginning, and a duration for what strikes at random."""
        yield from super().between_keys()
        if self.for_s is not None and self.until_s is not None:
            yield "for_s and until_s both say when it ends: give one of them", "until_s", "for_s"
        if self.until_s is not None and self.at_s is None:
            yield "needs at_s; a fault that strikes at random lasts for_s", "until_s", "at_s"
        if self.until_s is not None and self.at_s is not None and self.until_s <= self.at_s:
            yield f"must come after at_s = {self.at_s}", "until_s", "at_s"


class OfCraft(Table):
    """A fault of single craft."""

    craft: Names = Field(
        default=(), description="Names of the craft with the fault; a single name need not be a list. Empty: all craft."
    )


class PhotodiodeDead(Lasting, OfCraft):
    """Photodiodes see no light any more."""

    kind: Literal["photodiode-dead"] = Field(description="Photodiodes see no light any more.")
    photodiodes: Numbers = Field(min_length=1, description="Numbers of the photodiodes, counted from 0.")


class PhotodiodeStuck(Lasting, OfCraft):
    """A photodiode's timing register keeps the last sweeps that it took: the same angles in every period."""

    kind: Literal["photodiode-stuck"] = Field(description="Photodiodes report the last angles that they took for ever.")
    photodiodes: Numbers = Field(min_length=1, description="Numbers of the photodiodes, counted from 0.")


class Reflection(Lasting, OfCraft):
    """Flat faces of other craft are mirrors: they throw the sweeps onto photodiodes, where the geometry is such."""

    kind: Literal["reflection"] = Field(
        description="Flat faces of other craft reflect the sweeps onto the photodiodes."
    )
    mirrors: Names = Field(default=(), description="Names of the craft whose faces are mirrors. Empty: all others.")
    outshines: bool = Field(
        default=False,
        description="Whether the reflection outshines the direct sweep, which is not timed then; otherwise both are "
        "timed.",
    )


class Ghosts(Lasting, OfCraft):
    """A random share of the sweeps is timed from a reflection instead of from the lighthouse."""

    kind: Literal["ghosts"] = Field(description="A random share of the sweeps is timed from a reflection.")
    share: Annotated[float, SHARE] = Field(
        ge=1e-6, le=1, description="Share of the sweeps over the photodiodes that is timed from a reflection."
    )
    spread_deg: Annotated[float, GHOST_SPREAD] = Field(
        default=5.0, ge=1e-6, le=60, description="Largest error of those angles, which is distributed uniformly."
    )


class LighthouseDark(Lasting):
    """The lighthouse gives no light, neither flashes nor sweeps."""

    kind: Literal["lighthouse-dark"] = Field(description="The lighthouse gives no light.")


class RotorDrift(Strike):
    """The rotor's speed hunts once about its nominal value: too fast, then as much too slow, as one sine."""

    kind: Literal["rotor-drift"] = Field(description="The rotor's speed swings away and back.")
    for_s: Annotated[float, SWING_TIME] = Field(ge=1e-3, le=3600, description="Duration of the swing.")
    speed_ppm: Annotated[float, SWING] = Field(
        ge=-900, le=900, description="Amplitude of the swing; a positive one begins too fast."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require that the flashes stay where the craft look for them."""
        yield from super().between_keys()
        if abs(self.speed_ppm) * 1e-6 * self.for_s > 3e-3:
            yield "moves the flashes by more than a millisecond: speed_ppm times for_s must be below 3000", "speed_ppm"


class SyncLoss(Lasting, OfCraft):
    """The craft miss flashes."""

    kind: Literal["sync-loss"] = Field(description="The craft miss flashes.")
    missed_sync_probability: Annotated[float, SHARE] = Field(
        default=1.0, ge=1e-6, le=1, description="Probability that a craft misses a flash, for each craft by itself."
    )


class ThrusterStuck(Lasting, OfCraft):
    """A thruster does not obey any more."""

    kind: Literal["thruster-stuck"] = Field(description="A thruster does not obey any more.")
    thruster: Annotated[int, NUMBER] = Field(ge=0, le=1000, description="Number of the thruster, counted from 0.")
    state: Literal["on", "off"] = Field(description="State in which the thruster is stuck.")


class CraftLost(Lasting, OfCraft):
    """A craft is knocked out of control: it gets a kick and flies freely, until the fault ends."""

    kind: Literal["craft-lost"] = Field(description="A craft is knocked out of control.")
    velocity_m_s: Velocity = Field(
        default=(0.0, 0.0, 0.0), description="Change of the velocity, in the lighthouse frame."
    )
    angular_rate_deg_s: AngularRate = Field(
        default=(0.0, 0.0, 0.0), description="Change of the angular rate, in the lighthouse frame."
    )


class Restart(Strike, OfCraft):
    """The craft's computer restarts: it forgets its filter, its hypotheses and the flashes; meanwhile it neither
    measures nor commands.
    """

    kind: Literal["restart"] = Field(description="The craft's computer restarts.")
    for_s: Annotated[float, RESTART] = Field(default=0.5, ge=1e-3, le=3600, description="Duration of the restart.")


AnyFault = Annotated[
    PhotodiodeDead
    | PhotodiodeStuck
    | Reflection
    | Ghosts
    | LighthouseDark
    | RotorDrift
    | SyncLoss
    | ThrusterStuck
    | CraftLost
    | Restart,
    Field(discriminator="kind"),
]
KINDS: tuple[str, ...] = tuple(
    get_args(table.model_fields["kind"].annotation)[0] for table in get_args(get_args(AnyFault)[0])
)
"""All kinds; a fault's bit in the telemetry's codes is its place here."""


def too_late(faults: Sequence[AnyFault], duration_s: float) -> list[str]:
    """Return a sentence on each fault whose time to strike is not before the end of the run at `duration_s` [s]."""
    return [
        f"fault[{i}] ({fault.kind}) does not strike: at_s = {fault.at_s:g} s is not before the end of the run, "
        f"duration_s = {duration_s:g} s"
        for i, fault in enumerate(faults)
        if fault.at_s is not None and fault.at_s >= duration_s
    ]
