"""What a scenario file may say: one frozen pydantic model per table, extra keys forbidden.

A key carries its unit as a suffix. The description of every field is what the scenario reference, the JSON schema
for editors and the error messages say about it. Nothing here computes: `swarm.flight.builders` turns it into SI
settings.
"""

from collections.abc import Iterator
from itertools import chain
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.errors import did_you_mean
from swarm.scenario.cameras import Ccd
from swarm.scenario.criteria import Criterion
from swarm.scenario.dynamics import Actuation, Orbit
from swarm.scenario.faults import AnyFault, OfCraft, Reflection
from swarm.scenario.lidar import Lidar
from swarm.scenario.motions import AnyMotion, Hold
from swarm.scenario.table import Mistake, Table

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"


class Disturbance(Table):
    """What pushes a craft beside its own control: white, constant over each lighthouse period."""

    acceleration_m_s2: float = Field(default=0.0, ge=0, le=100, description="1 sigma per axis.")
    angular_acceleration_deg_s2: float = Field(default=0.0, ge=0, le=36000, description="1 sigma per axis.")


class Scatter(Table):
    """How far from its motion's beginning a craft starts: drawn once per craft from the seed, 1 sigma per axis."""

    position_m: float = Field(default=0.0, ge=0, le=100, description="Of its place.")
    velocity_m_s: float = Field(default=0.0, ge=0, le=100, description="Of its velocity.")
    attitude_deg: float = Field(default=0.0, ge=0, le=180, description="Of its attitude.")
    angular_rate_deg_s: float = Field(default=0.0, ge=0, le=3600, description="Of its angular rate.")


class Craft(Table):
    """A craft, or what all craft of the swarm share."""

    model: str = Field(default="mockup", description="A model's name (`swarm list`), or the path of an MJCF file.")
    feedback: Literal["truth", "estimate"] = Field(
        default="truth", description="What the controller steers by: the true pose, or the craft's own estimate."
    )
    motion: AnyMotion = Field(default=Hold(kind="hold"), description="How it moves: a table with a `kind`.")
    lighthouse: bool = Field(default=True, description="Whether it carries photodiodes for the lighthouse on board.")
    passive: bool = Field(
        default=False,
        description="A craft that does not cooperate: no photodiodes needed, nothing is computed on board.",
    )
    disturbance: Disturbance = Field(default=Disturbance(), description="What pushes it beside its own control.")
    actuation: Actuation = Field(default=Actuation(), description="How its orders are carried out.")
    scatter: Scatter = Field(default=Scatter(), description="How far from its motion's beginning it starts.")

    def between_keys(self) -> Iterator[Mistake]:
        """Who computes nothing on board cannot steer by it."""
        if self.passive and self.feedback == "estimate":
            yield "a passive craft has no estimate", "feedback", "passive"


class Swarm(Craft):
    """Equal craft that share one motion, named craft-0, craft-1, ..."""

    count: int = Field(default=0, ge=0, le=10000, description="How many craft.")

    def between_keys(self) -> Iterator[Mistake]:
        """No motion that would put all craft at one place."""
        yield from super().between_keys()
        if self.count > 1 and self.motion.kind in ("waypoints", "approach", "dock"):
            yield (
                f'must be 0 or 1 where motion.kind = "{self.motion.kind}", which would put all craft at one place; '
                "give each its own [[craft]] entry",
                "count",
                "motion.kind",
            )


class SingleCraft(Craft):
    """One craft with its own name and motion, beside the swarm."""

    name: str | None = Field(
        default=None, pattern=NAME_PATTERN, max_length=64, description="Unset: craft-N, counted after the swarm."
    )
    ccd: Ccd | None = Field(default=None, description="A pair of cameras that looks at another craft. Unset: none.")
    lidar: Lidar | None = Field(default=None, description="A LiDAR that inspects a passive craft. Unset: none.")

    def between_keys(self) -> Iterator[Mistake]:
        """A craft that does nothing on board has nothing on board."""
        yield from super().between_keys()
        if self.passive and self.lidar is not None:
            yield "a passive craft has no LiDAR", "lidar", "passive"
        if self.passive and self.ccd is not None:
            yield "a passive craft has no cameras", "ccd", "passive"


class Physics(Table):
    """The simulation of the craft's bodies."""

    steps_per_period: int = Field(
        default=8, ge=4, le=256, multiple_of=4, description="MuJoCo steps per lighthouse period; a multiple of 4."
    )


class Fan(Table):
    """Systematic errors of one fan, all zero for a perfect one: equation (E) of `estimators.lighthouse.sweep` has the
    signs.
    """

    phase_rad: float = Field(default=0.0, ge=-0.5, le=0.5, description="Constant error; positive lowers the angle.")
    tilt_rad: float = Field(
        default=0.0,
        ge=-0.5,
        le=0.5,
        description="Skew of the fan; positive lowers the angle where the other coordinate is > 0.",
    )
    curve: float = Field(
        default=0.0, ge=-0.5, le=0.5, description="Bend; positive raises the angle at both ends of the fan."
    )
    gibbous_phase_rad: float = Field(default=0.0, ge=-6.3, le=6.3, description="Phase of the once-per-turn error.")
    gibbous_magnitude: float = Field(default=0.0, ge=-0.5, le=0.5, description="Size of the once-per-turn error.")


class Lighthouse(Table):
    """The emitter, and how the photodiodes and timing circuits see it."""

    model: str = Field(
        default="lighthouse", description="The model that is drawn: a name, or the path of an MJCF file."
    )
    rate_hz: float = Field(
        default=60.0, gt=0, le=1000, description="Turns per second: one period is one sweep of each fan."
    )
    angle_noise_arcsec: float = Field(
        default=8.8, ge=0, le=3600, description="Random error of one sweep angle, 1 sigma."
    )
    rotor_correlation: float = Field(
        default=0.8717,
        ge=0,
        le=1,
        description="Share of the noise's variance that comes from the rotor: common to all photodiodes of a sweep.",
    )
    sync_jitter_ns: float = Field(
        default=0.0, ge=0, le=1e5, description="Jitter of the flash that announces a sweep, 1 sigma."
    )
    tick_ns: float = Field(default=20.0, gt=0, le=1e4, description="Resolution of the craft's timing circuit.")
    field_deg: float = Field(default=120.0, gt=0, le=170, description="Full width of the field in each axis.")
    range_min_m: float = Field(default=0.3, ge=0, le=1000, description="Photodiodes nearer than this see nothing.")
    range_max_m: float = Field(default=20.0, gt=0, le=1000, description="Photodiodes farther than this see nothing.")
    incidence_max_deg: float = Field(
        default=80.0, gt=0, le=90, description="Largest angle between a photodiode's normal and the light."
    )
    photodiode_diameter_mm: float = Field(default=3.0, gt=0, le=50, description="Sets the width of the sweep pulses.")
    mounting_error_mm: float = Field(
        default=0.0, ge=0, le=50, description="Photodiodes off their place, 1 sigma per axis, drawn once."
    )
    mounting_seed: int | None = Field(
        default=None,
        ge=0,
        lt=10**18,
        description="Draws the mounting errors: the same hardware in runs of different seeds. Unset: the run's seed.",
    )
    missed_sync_probability: float = Field(default=0.0, ge=0, le=1, description="A craft misses a flash, per flash.")
    lost_pulse_probability: float = Field(
        default=0.0, ge=0, le=1, description="A photodiode misses a sweep, per sweep."
    )
    stray_pulse_rate_hz: float = Field(default=0.0, ge=0, le=1e5, description="Pulses out of nowhere, per craft.")
    fan_x: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the y axis (measures x/z)."
    )
    fan_y: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the x axis (measures y/z)."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """The range is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield (
                f"range_min_m ({self.range_min_m} m) must be below range_max_m ({self.range_max_m} m)",
                "range_min_m",
                "range_max_m",
            )


class Integrity(Table):
    """How far a craft trusts its own pose: docs/integrity.md."""

    residual_test: bool | None = Field(
        default=None,
        description="Test the residuals of every pose, and drop photodiodes that disagree. Unset: where the angle "
        "noise accounts for every error, that is, with motion compensation, and with a calibration where fans or "
        "mountings have errors.",
    )
    false_alarm_probability: float = Field(
        default=1e-7, gt=0, lt=0.5, description="Of the residual test, per honest pose."
    )
    missed_detection_probability: float = Field(
        default=1e-4, gt=0, lt=0.5, description="Of a fault as large as the protection level allows for."
    )
    integrity_risk: float = Field(
        default=1e-7, gt=0, lt=0.2, description="That an error exceeds its protection level, per estimate."
    )
    alert_position_mm: float | None = Field(
        default=None, gt=0, le=1e6, description="Alert where the position's protection level is above. Unset: never."
    )
    alert_attitude_deg: float | None = Field(
        default=None, gt=0, le=180, description="Alert where the attitude's protection level is above. Unset: never."
    )


class Navigation(Table):
    """What every craft computes on board."""

    filter: Literal["auto", "filterpy", "compiled"] = Field(
        default="auto",
        description="The extended Kalman filter that runs: filterpy's, or one compiled for large swarms with the same "
        "numbers; auto: filterpy up to 64 craft, compiled beyond.",
    )
    motion_compensation: bool = Field(
        default=True,
        description="Refer every angle to its own instant; false: one period is one instant, as the paper does.",
    )
    angle_noise_arcsec: float | None = Field(
        default=None,
        gt=0,
        le=3600,
        description="What the craft believe; never less than their ticks' rounding. Unset: the lighthouse's.",
    )
    rotor_correlation: float | None = Field(
        default=None, ge=0, le=1, description="What the craft believe. Unset: the lighthouse's."
    )
    acceleration_noise_m_s2: float = Field(
        default=0.2, gt=0, le=100, description="Process noise: white acceleration, 1 sigma per axis and period."
    )
    angular_acceleration_noise_deg_s2: float = Field(
        default=12.0,
        gt=0,
        le=36000,
        description="Process noise: white angular acceleration, 1 sigma per axis and period.",
    )
    gate_probability: float = Field(
        default=0.99999, gt=0.5, lt=1, description="Share of good measurements that the innovation gate lets pass."
    )
    coast_limit_s: float = Field(
        default=2.0, ge=0, le=3600, description="How long a craft predicts without light before it searches again."
    )
    calibration: str | None = Field(
        default=None,
        description="File with the fans' systematic errors and the photodiodes' places that the craft go by, as "
        "`swarm calibrate` writes it; relative to this file. Unset: none.",
    )
    integrity: Integrity = Field(default=Integrity(), description="How far a craft trusts its own pose.")


class Recording(Table):
    """The recording for the viewer."""

    enabled: bool = Field(default=True, description="Whether a recording is written.")
    angles: bool = Field(
        default=False, description="Whether every sweep angle is written to angles.parquet, for `swarm calibrate`."
    )
    detail: Annotated[tuple[str, ...], Strict(False)] = Field(
        default=(), description="Craft drawn in full detail in a large swarm, by name. Empty: the first."
    )


class Scenario(Table):
    """One run: the craft, how they move, the lighthouse that they see, and what they compute on board."""

    name: str = Field(
        default="scenario",
        pattern=NAME_PATTERN,
        max_length=64,
        description="Names the run's folder. Unset: the file's name.",
    )
    description: str = Field(default="", max_length=200, description="One line; `swarm list` shows it.")
    duration_s: float = Field(default=30.0, gt=0, le=86400, description="Simulated time.")
    seed: int = Field(default=0, ge=0, lt=10**18, description="Every random draw follows from it.")
    physics: Physics = Field(default=Physics(), description="The simulation of the bodies.")
    orbit: Orbit | None = Field(default=None, description="The lighthouse's orbit. Unset: weightless space.")
    lighthouse: Lighthouse = Field(
        default=Lighthouse(), description="The emitter, and what photodiodes make of its light."
    )
    navigation: Navigation = Field(default=Navigation(), description="What every craft computes on board.")
    swarm: Swarm = Field(default=Swarm(), description="Equal craft that share one motion.")
    craft: Annotated[tuple[SingleCraft, ...], Strict(False)] = Field(
        default=(), description="Single craft beside the swarm, one [[craft]] each."
    )
    fault: Annotated[tuple[AnyFault, ...], Strict(False)] = Field(
        default=(), description="What goes wrong, one [[fault]] each."
    )
    criteria: Annotated[tuple[Criterion, ...], Strict(False)] = Field(
        default=(), description="What must hold for the run to have succeeded, one [[criteria]] each."
    )
    recording: Recording = Field(default=Recording(), description="The recording for the viewer.")

    @property
    def craft_names(self) -> tuple[str, ...]:
        """All names: the swarm's first, then those of [[craft]]."""
        swarm = self.swarm.count
        single = (c.name or f"craft-{i}" for i, c in enumerate(self.craft, start=swarm))
        return tuple(chain((f"craft-{i}" for i in range(swarm)), single))

    def between_keys(self) -> Iterator[Mistake]:
        """There is a craft, names are distinct, named craft exist, and waypoints begin before the run ends."""
        names = self.craft_names
        if not names:
            yield "there is no craft at all: set swarm.count, or add a [[craft]] entry", "swarm.count"
        for i in range(self.swarm.count, len(names)):
            if names[i] == "lighthouse":
                yield "is the name of the lighthouse itself", f"craft[{i - self.swarm.count}].name"
            if names[i] in names[:i]:
                yield "another craft has this name", f"craft[{i - self.swarm.count}].name"
        yield from self._ccd_mistakes(names)
        yield from self._dock_mistakes(names)
        yield from self._criteria_mistakes(names)
        for i, fault in enumerate(self.fault):
            for key in ("craft", "mirrors"):
                owner = fault if isinstance(fault, Reflection if key == "mirrors" else OfCraft) else None
                for j, name in enumerate(getattr(owner, key, ())):
                    if name not in names:
                        yield f"no craft has the name {name!r}{did_you_mean(name, names)}", f"fault[{i}].{key}[{j}]"
        yield from self._lidar_mistakes(names)
        for i, name in enumerate(self.recording.detail):
            if name not in names:
                yield f"no craft has this name{did_you_mean(name, names)}", f"recording.detail[{i}]"
        for key, group in (("swarm", self.swarm), *((f"craft[{i}]", c) for i, c in enumerate(self.craft))):
            motion = group.motion
            if motion.kind == "waypoints" and motion.times_s[0] >= self.duration_s:
                yield (
                    f"the first time ({motion.times_s[0]:g} s) must lie within the run, which ends at "
                    f"duration_s = {self.duration_s:g} s",
                    f"{key}.motion.times_s",
                    "duration_s",
                )

    def _ccd_mistakes(self, names: tuple[str, ...]) -> Iterator[Mistake]:
        """The cameras' target exists, is another craft, and stays where the craft knows it to be."""
        for i, craft in enumerate(self.craft):
            if craft.ccd is not None:
                yield from self._station_mistakes(
                    names, self.swarm.count + i, craft.ccd.target, f"craft[{i}].ccd.target"
                )

    def _dock_mistakes(self, names: tuple[str, ...]) -> Iterator[Mistake]:
        """The same of the ports that craft dock to."""
        groups = [("swarm", self.swarm)] * self.swarm.count
        for i, (key, group) in enumerate([*groups, *((f"craft[{k}]", c) for k, c in enumerate(self.craft))]):
            if group.motion.kind == "dock":
                yield from self._station_mistakes(names, i, group.motion.target, f"{key}.motion.target")

    def _station_mistakes(self, names: tuple[str, ...], craft: int, target: str, key: str) -> Iterator[Mistake]:
        """A craft's target exists, is another one, and stays where the craft knows it to be."""
        if target not in names:
            yield f"no craft has this name{did_you_mean(target, names)}", key
            return
        of = names.index(target)
        group = self.swarm if of < self.swarm.count else self.craft[of - self.swarm.count]
        table = "swarm" if of < self.swarm.count else f"craft[{of - self.swarm.count}]"
        if of == craft:
            yield "a craft cannot be its own target", key
        elif group.motion.kind != "hold" or group.motion.attitude.spin_deg_s:
            yield "must hold its place without spin: its station is known on board", key, f"{table}.motion.kind"
        elif group.feedback != "truth":
            yield 'must hold its place exactly: feedback = "truth"', key, f"{table}.feedback"

    def _criteria_mistakes(self, names: tuple[str, ...]) -> Iterator[Mistake]:
        """Criteria are about craft that exist, and have a name each."""
        labels = [criterion.label for criterion in self.criteria]
        for i, criterion in enumerate(self.criteria):
            for k, name in enumerate(criterion.craft):
                if name not in names:
                    yield f"no craft has this name{did_you_mean(name, names)}", f"criteria[{i}].craft[{k}]"
            if labels[i] in labels[:i]:
                yield f"another criterion is called {labels[i]} too: give one of them a name", f"criteria[{i}].name"

    def _lidar_mistakes(self, names: tuple[str, ...]) -> Iterator[Mistake]:
        """What a LiDAR inspects exists and is passive; no scan is shorter than a lighthouse period."""
        groups = [self.swarm] * self.swarm.count + list(self.craft)
        for i, craft in enumerate(self.craft):
            if craft.lidar is None:
                continue
            key, target = f"craft[{i}].lidar", craft.lidar.target
            if target not in names:
                yield f"no craft has this name{did_you_mean(target, names)}", f"{key}.target"
                continue
            of = names.index(target)
            if not groups[of].passive:
                table = "swarm" if of < self.swarm.count else f"craft[{of - self.swarm.count}]"
                yield "must be passive: who navigates by itself is not inspected", f"{key}.target", f"{table}.passive"
            if craft.lidar.rate_hz > self.lighthouse.rate_hz:
                yield f"at most one scan per lighthouse period, {self.lighthouse.rate_hz:g} Hz", f"{key}.rate_hz"
