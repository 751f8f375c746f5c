"""The tables of the craft: those of the swarm, and single ones beside it."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from swarm.scenario.cameras import Ccd
from swarm.scenario.dynamics import Actuation
from swarm.scenario.lidar import Lidar
from swarm.scenario.limits import (
    ATTITUDE_SIGMA,
    COUNT,
    POSITION_SIGMA,
    PUSH,
    SPEED_SIGMA,
    SPIN_SIGMA,
    TURNING_PUSH,
)
from swarm.scenario.motions import AnyMotion, Hold
from swarm.scenario.stations import NAME_PATTERN
from swarm.scenario.table import Mistake, Table


class Disturbance(Table):
    """Random accelerations push the craft beside its own control: white, constant over each lighthouse period."""

    acceleration_m_s2: Annotated[float, PUSH] = Field(
        default=0.0, ge=0, le=100, description="Standard deviation of the acceleration per axis."
    )
    angular_acceleration_deg_s2: Annotated[float, TURNING_PUSH] = Field(
        default=0.0, ge=0, le=36000, description="Standard deviation of the angular acceleration per axis."
    )


class Scatter(Table):
    """A craft starts at random about the beginning of its motion: drawn once per craft from the seed and its name."""

    position_m: Annotated[float, POSITION_SIGMA] = Field(
        default=0.0, ge=0, le=100, description="Standard deviation of the start position per axis."
    )
    velocity_m_s: Annotated[float, SPEED_SIGMA] = Field(
        default=0.0, ge=0, le=100, description="Standard deviation of the start velocity per axis."
    )
    attitude_deg: Annotated[float, ATTITUDE_SIGMA] = Field(
        default=0.0, ge=0, le=180, description="Standard deviation of the start attitude per axis."
    )
    angular_rate_deg_s: Annotated[float, SPIN_SIGMA] = Field(
        default=0.0, ge=0, le=3600, description="Standard deviation of the start angular rate per axis."
    )


class Craft(Table):
    """A craft, or all craft of the swarm."""

    model: str = Field(default="mockup", description="Name of a model (`swarm list`), or path of an MJCF file.")
    feedback: Literal["truth", "estimate"] = Field(
        default="truth", description="Pose that the controller steers by: the true one, or the craft's own estimate."
    )
    controller: str | None = Field(
        default=None,
        description="Controller of your own in the place of the program's feedback (docs/plug-ins.md): FILE.py:CLASS, "
        "with a path relative to this file, or the name of an entry point. The file is executed. Unset: none.",
    )
    navigator: str | None = Field(
        default=None,
        description="Navigator of your own in the place of the program's filter, likewise. Unset: none.",
    )
    motion: AnyMotion = Field(default=Hold(kind="hold"), description="Motion of the craft: a table with a `kind`.")
    lighthouse: bool = Field(default=True, description="Whether the photodiodes for the lighthouse are on board.")
    passive: bool = Field(
        default=False,
        description="Whether the craft does not cooperate: it needs no photodiodes, and computes nothing on board.",
    )
    disturbance: Disturbance = Field(
        default=Disturbance(), description="Random accelerations beside the craft's own control."
    )
    actuation: Actuation = Field(
        default=Actuation(), description="Thrusters and reaction wheels that carry out the craft's orders."
    )
    scatter: Scatter = Field(default=Scatter(), description="Random start about the beginning of the motion.")

    def between_keys(self) -> Iterator[Mistake]:
        """Require that a craft that steers by its estimate computes one."""
        if self.passive and self.feedback == "estimate":
            yield "a passive craft has no estimate", "feedback", "passive"
        if self.passive and self.navigator is not None:
            yield "a passive craft computes nothing", "navigator", "passive"
        if not self.lighthouse and self.navigator is not None:
            yield "a navigator needs the photodiodes' light", "navigator", "lighthouse"


class Swarm(Craft):
    """Equal craft share one motion; they are named craft-0, craft-1, ..."""

    count: Annotated[int, COUNT] = Field(default=0, ge=0, le=10000, description="Number of craft.")

    def between_keys(self) -> Iterator[Mistake]:
        """Refuse a motion that would put all craft at one position."""
        yield from super().between_keys()
        if self.count > 1 and self.motion.kind in ("waypoints", "approach", "dock"):
            yield (
                f'must be 0 or 1 where motion.kind = "{self.motion.kind}", which would put all craft at one position; '
                "give each its own [[craft]] entry",
                "count",
                "motion.kind",
            )


class SingleCraft(Craft):
    """One craft has its own name and motion, beside the swarm."""

    name: str | None = Field(
        default=None,
        pattern=NAME_PATTERN,
        max_length=64,
        description="Name of the craft. Unset: craft-N, counted after the swarm.",
    )
    ccd: Ccd | None = Field(default=None, description="Pair of cameras that looks at another craft. Unset: none.")
    lidar: Lidar | None = Field(default=None, description="LiDAR that inspects a passive craft. Unset: none.")

    def between_keys(self) -> Iterator[Mistake]:
        """Refuse sensors on a craft that computes nothing."""
        yield from super().between_keys()
        if self.passive and self.lidar is not None:
            yield "a passive craft has no LiDAR", "lidar", "passive"
        if self.passive and self.ccd is not None:
            yield "a passive craft has no cameras", "ccd", "passive"
        if self.navigator is not None and self.ccd is not None:
            yield "poses of cameras go into the program's filter only", "navigator", "ccd"
