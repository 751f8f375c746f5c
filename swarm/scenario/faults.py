"""The `[[fault]]` tables of a scenario: one frozen pydantic model per kind, told apart by `kind`.

A fault strikes at a time, or at random with a probability per second, and lasts for a time, until a time, or for good.
`swarm.flight.faults` makes them happen.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict

from swarm.scenario.table import Mistake, Table, Vector


def _listed(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


Names = Annotated[tuple[str, ...], BeforeValidator(_listed), Strict(False)]
"""Names of craft; one by itself need not be a list."""
Numbers = Annotated[tuple[Annotated[int, Field(ge=0, le=1000)], ...], Strict(False)]
_FOR_GOOD = "How long it lasts. Unset: until until_s, or to the end of the run."


class Strike(Table):
    """When a fault strikes."""

    at_s: float | None = Field(default=None, ge=0, le=86400, description="When it strikes. Unset: at random.")
    probability_per_s: float | None = Field(
        default=None,
        gt=0,
        le=10,
        description="It strikes at random: each craft by itself, where it is about craft. Unset: at at_s.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Either a time or a probability."""
        if (self.at_s is None) == (self.probability_per_s is None):
            yield "needs either at_s or probability_per_s, to say when it strikes", "at_s", "probability_per_s"


class Lasting(Strike):
    """A fault that lasts."""

    for_s: float | None = Field(default=None, gt=0, le=86400, description=_FOR_GOOD)
    until_s: float | None = Field(default=None, gt=0, le=86400, description="When it ends. Unset: see for_s.")

    def between_keys(self) -> Iterator[Mistake]:
        """One end, after the beginning; at random, a length."""
        yield from super().between_keys()
        if self.for_s is not None and self.until_s is not None:
            yield "for_s and until_s both say when it ends: give one of them", "until_s", "for_s"
        if self.until_s is not None and self.at_s is None:
            yield "needs at_s; what strikes at random lasts for_s", "until_s", "at_s"
        if self.until_s is not None and self.at_s is not None and self.until_s <= self.at_s:
            yield f"must come after at_s = {self.at_s}", "until_s", "at_s"


class OfCraft(Table):
    """A fault of single craft."""

    craft: Names = Field(default=(), description="Whose, by name; a single name need not be a list. Empty: all craft.")


class PhotodiodeDead(Lasting, OfCraft):
    """Photodiodes see nothing any more."""

    kind: Literal["photodiode-dead"] = Field(description="Photodiodes see nothing any more.")
    photodiodes: Numbers = Field(min_length=1, description="Which, counted from 0.")


class PhotodiodeStuck(Lasting, OfCraft):
    """A photodiode's timing register keeps the last sweeps that it took: the same angles in every period."""

    kind: Literal["photodiode-stuck"] = Field(description="Photodiodes report the last angles that they took for ever.")
    photodiodes: Numbers = Field(min_length=1, description="Which, counted from 0.")


class Reflection(Lasting, OfCraft):
    """Flat faces of other craft are mirrors: a photodiode is also swept by way of them, where geometry has it so."""

    kind: Literal["reflection"] = Field(description="Flat faces of other craft throw the sweeps onto its photodiodes.")
    mirrors: Names = Field(default=(), description="The craft whose faces are mirrors, by name. Empty: all others.")
    outshines: bool = Field(
        default=False,
        description="Whether the reflection outshines the direct sweep, which then is not timed; otherwise both are.",
    )


class Ghosts(Lasting, OfCraft):
    """A random share of the sweeps is timed from a reflection instead of from the lighthouse."""

    kind: Literal["ghosts"] = Field(description="A random share of the sweeps comes from somewhere else.")
    share: float = Field(gt=0, le=1, description="Of all sweeps over its photodiodes.")
    spread_deg: float = Field(
        default=5.0, gt=0, le=60, description="How far off their angles are at most, uniformly distributed."
    )


class LighthouseDark(Lasting):
    """The lighthouse gives no light, neither flashes nor sweeps."""

    kind: Literal["lighthouse-dark"] = Field(description="The lighthouse gives no light.")


class RotorDrift(Strike):
    """The rotor's speed hunts once about its nominal value: too fast, then as much too slow, as one sine."""

    kind: Literal["rotor-drift"] = Field(description="The rotor's speed swings away and back.")
    for_s: float = Field(gt=0, le=3600, description="How long the swing lasts.")
    speed_ppm: float = Field(ge=-900, le=900, description="Its amplitude; positive: too fast first.")

    def between_keys(self) -> Iterator[Mistake]:
        """The phase stays where the craft look for the flashes."""
        yield from super().between_keys()
        if abs(self.speed_ppm) * 1e-6 * self.for_s > 3e-3:
            yield "moves the flashes by more than a millisecond: speed_ppm times for_s must be below 3000", "speed_ppm"


class SyncLoss(Lasting, OfCraft):
    """A burst in which flashes are missed."""

    kind: Literal["sync-loss"] = Field(description="Flashes are missed.")
    missed_sync_probability: float = Field(default=1.0, gt=0, le=1, description="Per flash, each craft by itself.")


class ThrusterStuck(Lasting, OfCraft):
    """A thruster that no longer obeys."""

    kind: Literal["thruster-stuck"] = Field(description="A thruster no longer obeys.")
    thruster: int = Field(ge=0, le=1000, description="Which, counted from 0.")
    state: Literal["on", "off"] = Field(description="How it is stuck.")


class CraftLost(Lasting, OfCraft):
    """A craft is knocked out of control: it gets a kick and then flies free, until control comes back if ever."""

    kind: Literal["craft-lost"] = Field(description="Out of control, with a kick.")
    velocity_m_s: Vector = Field(default=(0.0, 0.0, 0.0), description="Change of velocity, lighthouse frame.")
    angular_rate_deg_s: Vector = Field(default=(0.0, 0.0, 0.0), description="Change of angular rate, lighthouse frame.")


class Restart(Strike, OfCraft):
    """The craft's computer starts again: filter, hypotheses and flashes are forgotten; meanwhile it neither sees nor
    commands."""

    kind: Literal["restart"] = Field(description="The craft's computer starts again.")
    for_s: float = Field(default=0.5, gt=0, le=3600, description="How long it takes.")


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
KINDS = (
    "photodiode-dead",
    "photodiode-stuck",
    "reflection",
    "ghosts",
    "lighthouse-dark",
    "rotor-drift",
    "sync-loss",
    "thruster-stuck",
    "craft-lost",
    "restart",
)
"""All kinds; a fault's bit in the telemetry's codes is its place here."""
