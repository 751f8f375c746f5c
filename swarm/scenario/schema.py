"""The tables of a scenario file, but for those of motions, faults, sensors and criteria.

The scenario reference, the JSON schema for editors and the error messages show the description of every field. Nothing
here computes; `swarm.units.si` gives a table in SI units.
"""

from collections.abc import Iterator
from itertools import chain
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.errors import did_you_mean
from swarm.scenario.cameras import Ccd
from swarm.scenario.criteria import Criterion
from swarm.scenario.dynamics import Actuation, Orbit
from swarm.scenario.faults import AnyFault, Names
from swarm.scenario.lidar import Lidar
from swarm.scenario.limits import (
    ALERT,
    ALERT_ATTITUDE,
    ANGLE_NOISE,
    ASSUMED_NOISE,
    ATTITUDE_SIGMA,
    COAST,
    COUNT,
    DURATION,
    FALSE_PHOTODIODES,
    FALSE_STATIONS,
    FIELD,
    GATE,
    INCIDENCE,
    JITTER,
    LISTENING,
    MODELS,
    MOUNTING,
    PHOTODIODE,
    POSITION_SIGMA,
    PUSH,
    RANGE_MAX,
    RANGE_MIN,
    RARE,
    RISK,
    ROTOR_RATE,
    SEED,
    SHARE_OF_NOISE,
    SPEED_SIGMA,
    SPIN_SIGMA,
    STAY,
    STEPS,
    STRAY,
    TICK,
    TURNING_PUSH,
)
from swarm.scenario.motions import AnyMotion, Hold
from swarm.scenario.relative import FanSigma, Pair
from swarm.scenario.stations import NAME_PATTERN, Fan, Station, mistakes
from swarm.scenario.table import Mistake, Probability, ProcessNoise, Table, TurningNoise

ONE_LIGHTHOUSE = ("reflection", "ghosts", "photodiode-stuck", "rotor-drift", "sync-loss")
"""Faults in the light of the one lighthouse."""
LEAST_BELIEF = 0.2
"""Least share of the lighthouse's angle noise that craft may assume: at that, the NEES is 25 times too large."""


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


class Physics(Table):
    """MuJoCo simulates the bodies of the craft."""

    steps_per_period: Annotated[int, STEPS] = Field(
        default=8,
        ge=4,
        le=256,
        multiple_of=4,
        description="Number of MuJoCo steps per lighthouse period, a multiple of 4.",
    )


class Lighthouse(Table):
    """The lighthouse, and the photodiodes and timing circuits that receive its light."""

    model: str = Field(
        default="lighthouse", description="Model of the lighthouse that is drawn: a name, or the path of an MJCF file."
    )
    rate_hz: Annotated[float, ROTOR_RATE] = Field(
        default=60.0,
        ge=1,
        le=300,
        description="Turns per second; one period is one sweep of each fan.",
    )
    angle_noise_arcsec: Annotated[float, ANGLE_NOISE] = Field(
        default=8.8, ge=0, le=600, description="Standard deviation of one sweep angle."
    )
    rotor_correlation: Annotated[float, SHARE_OF_NOISE] = Field(
        default=0.8717,
        ge=0,
        le=1,
        description="Share of the noise's variance that comes from the rotor and is common to all photodiodes of a "
        "sweep.",
    )
    sync_jitter_ns: Annotated[float, JITTER] = Field(
        default=0.0,
        ge=0,
        le=1e4,
        description="Standard deviation of the instant of the flash that announces a sweep.",
    )
    tick_ns: Annotated[float, TICK] = Field(
        default=20.0,
        ge=0.01,
        le=5000,
        description="Resolution of the timing circuit of a craft.",
    )
    field_deg: Annotated[float, FIELD] = Field(
        default=120.0, ge=1, le=170, description="Full width of the field of view in each axis."
    )
    range_min_m: Annotated[float, RANGE_MIN] = Field(
        default=0.3, ge=0, le=1000, description="Least range at which a photodiode receives light."
    )
    range_max_m: Annotated[float, RANGE_MAX] = Field(
        default=20.0, ge=0.01, le=1000, description="Largest range at which a photodiode receives light."
    )
    incidence_max_deg: Annotated[float, INCIDENCE] = Field(
        default=80.0, ge=1, le=90, description="Largest angle between the normal of a photodiode and the light."
    )
    photodiode_diameter_mm: Annotated[float, PHOTODIODE] = Field(
        default=3.0, ge=0.01, le=20, description="Diameter of a photodiode, which sets the width of the sweep pulses."
    )
    listening_ms: Annotated[float | None, LISTENING] = Field(
        default=None,
        ge=1,
        le=1000,
        description="Time in the middle of a period for which the circuits listen to [[station]] tables of Lighthouse "
        "2.0; a turn takes 18.5 ms to 20 ms. Unset: always.",
    )
    mounting_error_mm: Annotated[float, MOUNTING] = Field(
        default=0.0,
        ge=0,
        le=10,
        description="Standard deviation of a photodiode's mounting position per axis, drawn once.",
    )
    mounting_seed: Annotated[int | None, SEED] = Field(
        default=None,
        ge=0,
        lt=10**18,
        description="Seed of the mounting errors, for the same hardware in runs of different seeds. Unset: the run's "
        "seed.",
    )
    missed_sync_probability: Probability = Field(default=0.0, description="Probability that a craft misses a flash.")
    lost_pulse_probability: Probability = Field(
        default=0.0, description="Probability that a photodiode misses a sweep."
    )
    stray_pulse_rate_hz: Annotated[float, STRAY] = Field(
        default=0.0, ge=0, le=5000, description="Rate of random pulses from elsewhere, per craft."
    )
    fan_x: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the y axis (measures x/z)."
    )
    fan_y: Fan = Field(
        default=Fan(), description="Systematic errors of the fan that turns about the x axis (measures y/z)."
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Require a range that is not empty."""
        if self.range_min_m >= self.range_max_m:
            yield (
                f"range_min_m ({self.range_min_m} m) must be below range_max_m ({self.range_max_m} m)",
                "range_min_m",
                "range_max_m",
            )


class Integrity(Table):
    """Every craft tests its own pose, and computes how far off it may be. See docs/integrity.md."""

    residual_test: bool | None = Field(
        default=None,
        description="Whether the residuals of every pose are tested, and photodiodes that disagree are left out. "
        "Unset: true where the angle noise accounts for every error, that is, with motion compensation, and with a "
        "calibration where fans or mountings have errors: of every craft's photodiodes, where mountings have.",
    )
    false_alarm_probability: Annotated[float, RARE] = Field(
        default=1e-7, ge=1e-15, lt=0.5, description="Probability that the residual test rejects a pose without fault."
    )
    missed_detection_probability: Annotated[float, RARE] = Field(
        default=1e-4,
        ge=1e-15,
        lt=0.5,
        description="Probability that a fault as large as the protection level allows for is not detected.",
    )
    integrity_risk: Annotated[float, RISK] = Field(
        default=1e-7,
        ge=1e-15,
        lt=0.2,
        description="Probability that an error exceeds its protection level, per estimate.",
    )
    alert_position_mm: Annotated[float | None, ALERT] = Field(
        default=None,
        ge=1e-6,
        le=1e6,
        description="Protection level of the position above which the craft raises an alert. Unset: never.",
    )
    alert_attitude_deg: Annotated[float | None, ALERT_ATTITUDE] = Field(
        default=None,
        ge=1e-6,
        le=180,
        description="Protection level of the attitude above which the craft raises an alert. Unset: never.",
    )
    false_photodiodes: Annotated[int, FALSE_PHOTODIODES] = Field(
        default=0,
        ge=0,
        le=2,
        description="Number of photodiodes that may be false all the time without an error beyond the filter's "
        "protection level, by separation of solutions: filters that leave out one or two of them (docs/integrity.md). "
        "0: the level has what one false photodiode may do that a pose's residual test misses.",
    )
    false_stations: Annotated[int, FALSE_STATIONS] = Field(
        default=0,
        ge=0,
        le=1,
        description="Number of [[station]] tables that may be false all the time, as by a station that was moved, "
        "without an error beyond the filter's protection level, by filters that leave out one of them each "
        "(docs/integrity.md).",
    )
    unseen_acceleration_m_s2: Annotated[float, PUSH] = Field(
        default=0.0,
        ge=0,
        le=100,
        description="Largest unknown acceleration for which levels by separation of solutions allow without light.",
    )
    unseen_angular_acceleration_deg_s2: Annotated[float, TURNING_PUSH] = Field(
        default=0.0,
        ge=0,
        le=36000,
        description="Largest unknown angular acceleration for which they allow without light.",
    )

    def between_keys(self) -> Iterator[Mistake]:
        """Refuse unseen accelerations where levels are not by separation of solutions."""
        for key in ("unseen_acceleration_m_s2", "unseen_angular_acceleration_deg_s2"):
            if getattr(self, key) and not (self.false_photodiodes or self.false_stations):
                yield "has no effect without levels by separation of solutions", key, "false_photodiodes"


class Quiet(Table):
    """The filter's other models of motion: those of craft which nothing pushes much but what it knows of."""

    craft: Literal["free", "all", "none"] = Field(
        default="all",
        description="Whose filter has quieter models beside that of a craft that manoeuvres, and weighs them by how "
        "well they predict the light (docs/filter.md): craft that hold neither place nor attitude, all, or none.",
    )
    models: Annotated[int, MODELS] = Field(
        default=6,
        ge=2,
        le=12,
        description="Number of models, with process noises in geometric series from that of navigation to the least. "
        "A craft runs the four about the likeliest.",
    )
    acceleration_noise_m_s2: ProcessNoise = Field(
        default=0.00005,
        description="Least process noise: white acceleration, standard deviation per axis and period.",
    )
    angular_acceleration_noise_deg_s2: TurningNoise = Field(
        default=0.003,
        description="Least process noise: white angular acceleration, standard deviation per axis and period.",
    )
    mean_duration_s: Annotated[float, STAY] = Field(
        default=30.0, ge=0.1, le=1e6, description="Mean time until a craft begins to move more."
    )
    mean_manoeuvre_s: Annotated[float, STAY] = Field(
        default=2.0, ge=0.1, le=1e6, description="Mean time until a craft begins to move less."
    )


class Navigation(Table):
    """Every craft computes its pose on board."""

    filter: Literal["auto", "filterpy", "compiled"] = Field(
        default="auto",
        description="Extended Kalman filter: that of filterpy, or one compiled for large swarms, with the same "
        "numbers. auto: filterpy up to 64 filters, craft times models of motion that run, compiled beyond.",
    )
    coupling: Literal["auto", "loose", "tight"] = Field(
        default="auto",
        description="What goes into the filter: the pose of a period where four or more photodiodes decide one, and "
        "where they do not its single sweep angles (auto); poses only (loose); or always the angles (tight).",
    )
    motion_compensation: bool = Field(
        default=True,
        description="Whether every angle is referred to its own instant; false: one period is one instant, as in the "
        "paper.",
    )
    angle_noise_arcsec: Annotated[float | None, ASSUMED_NOISE] = Field(
        default=None,
        ge=0.1,
        le=600,
        description="Standard deviation of a sweep angle that the craft assume, beside the rounding to ticks and the "
        "sync jitter, whose variances are added. Unset: that of the lighthouse.",
    )
    rotor_correlation: Annotated[float | None, SHARE_OF_NOISE] = Field(
        default=None, ge=0, le=1, description="Rotor correlation that the craft assume. Unset: that of the lighthouse."
    )
    acceleration_noise_m_s2: ProcessNoise = Field(
        default=0.2,
        description="Process noise: white acceleration, standard deviation per axis and period.",
    )
    angular_acceleration_noise_deg_s2: TurningNoise = Field(
        default=12.0,
        description="Process noise: white angular acceleration, standard deviation per axis and period.",
    )
    quiet: Quiet = Field(default=Quiet(), description="Motion of a craft that nothing pushes.")
    gate_probability: Annotated[float, GATE] = Field(
        default=0.99999, gt=0.5, lt=1, description="Share of good measurements that the innovation gate lets pass."
    )
    coast_limit_s: Annotated[float, COAST] = Field(
        default=2.0,
        ge=0,
        le=3600,
        description="Time for which a craft predicts without light before it searches again.",
    )
    calibration: str | None = Field(
        default=None,
        description="File with the systematic errors of the fans and the positions of the photodiodes that the craft "
        "use, as `swarm calibrate` writes it; its path is relative to this file. Unset: none.",
    )
    reference: Names = Field(
        default=(),
        description="Craft that stand still at known places and tell the others by how much each sweep is off there, "
        "which they take off theirs (docs/relative.md); a single name may stand alone. Empty: none.",
    )
    fan_sigma: FanSigma = Field(
        default=FanSigma(), description="Errors of the fans that are left over, in every covariance."
    )
    integrity: Integrity = Field(default=Integrity(), description="Integrity of the pose.")


class Recording(Table):
    """The run leaves a recording for the viewer."""

    enabled: bool = Field(default=True, description="Whether a recording is written.")
    angles: bool = Field(
        default=False, description="Whether every sweep angle is written to angles.parquet for `swarm calibrate`."
    )
    filter: bool | None = Field(
        default=None,
        description="Whether the history of the filters is kept in filter.history for `swarm smooth`. Unset: where a "
        "run has at most 100 000 rows of telemetry.",
    )
    up: Literal["-y", "z"] = Field(
        default="-y", description="Direction that the viewer shows as up: -y of the lighthouse frame, or z of a room."
    )
    detail: Annotated[tuple[str, ...], Strict(False)] = Field(
        default=(), description="Names of the craft that are drawn in full detail in a large swarm. Empty: the first."
    )


class Scenario(Table):
    """One run: the craft and their motions, the lighthouse that they see, and the navigation on board."""

    name: str = Field(
        default="scenario",
        pattern=NAME_PATTERN,
        max_length=64,
        description="Name of the run and its folder. Unset: the file's name.",
    )
    description: str = Field(default="", max_length=200, description="One line that `swarm list` shows.")
    duration_s: Annotated[float, DURATION] = Field(default=30.0, ge=1e-3, le=86400, description="Simulated time.")
    seed: Annotated[int, SEED] = Field(default=0, ge=0, lt=10**18, description="Seed of every random draw.")
    physics: Physics = Field(default=Physics(), description="Simulation of the bodies.")
    orbit: Orbit | None = Field(default=None, description="Orbit of the lighthouse. Unset: weightless space.")
    lighthouse: Lighthouse = Field(default=Lighthouse(), description="Lighthouse, and the reception of its light.")
    station: Annotated[tuple[Station, ...], Strict(False)] = Field(
        default=(), description="Lighthouse stations in the lighthouse's place, one [[station]] each."
    )
    navigation: Navigation = Field(default=Navigation(), description="Navigation on board every craft.")
    swarm: Swarm = Field(default=Swarm(), description="Equal craft that share one motion.")
    craft: Annotated[tuple[SingleCraft, ...], Strict(False)] = Field(
        default=(), description="Single craft beside the swarm, one [[craft]] each."
    )
    pair: Annotated[tuple[Pair, ...], Strict(False)] = Field(
        default=(), description="Craft that navigate relative to another, one [[pair]] each."
    )
    fault: Annotated[tuple[AnyFault, ...], Strict(False)] = Field(default=(), description="Faults, one [[fault]] each.")
    criteria: Annotated[tuple[Criterion, ...], Strict(False)] = Field(
        default=(), description="Conditions for the success of the run, one [[criteria]] each."
    )
    recording: Recording = Field(default=Recording(), description="Recording for the viewer.")

    def _noise_mistakes(self) -> Iterator[Mistake]:
        """Refuse an assumed noise that the light contradicts: the filter would not be consistent by any means."""
        assumed, own = self.navigation.angle_noise_arcsec, self.lighthouse.angle_noise_arcsec
        if assumed is not None and assumed < LEAST_BELIEF * own:
            yield (
                f"must be at least {LEAST_BELIEF * own:g} arcsec, {LEAST_BELIEF:g} of lighthouse.angle_noise_arcsec = "
                f"{own:g}: craft that believe the light so much better call errors of many sigma certain",
                "navigation.angle_noise_arcsec",
                "lighthouse.angle_noise_arcsec",
            )

    @property
    def turns(self) -> int:
        """Turns of the rotor in a period: one, or as many as there are stations that take turns."""
        return len(self.station) if self.station and not self.station[0].second else 1

    @property
    def period_hz(self) -> float:
        """Number of periods per second [Hz]."""
        return self.lighthouse.rate_hz / self.turns

    @property
    def period_s(self) -> float:
        """Length of a period [s]."""
        return self.turns / self.lighthouse.rate_hz

    @property
    def craft_names(self) -> tuple[str, ...]:
        """All names: those of the swarm first, then those of [[craft]]."""
        swarm = self.swarm.count
        single = (c.name or f"craft-{i}" for i, c in enumerate(self.craft, start=swarm))
        return tuple(chain((f"craft-{i}" for i in range(swarm)), single))

    @property
    def tables(self) -> list[tuple[str, "Swarm | SingleCraft"]]:
        """The table of every craft and its key, in the order of `craft_names`."""
        single = [(f"craft[{i}]", table) for i, table in enumerate(self.craft)]
        return [*[("swarm", self.swarm)] * self.swarm.count, *single]

    def between_keys(self) -> Iterator[Mistake]:
        """Require a craft, distinct names, craft that exist where named, and waypoints that begin within the run."""
        names, tables = self.craft_names, self.tables
        yield from self._noise_mistakes()
        if self.navigation.integrity.false_stations and len(self.station) < 2:
            told = "leaves no light without a false station: at least two [[station]] tables are needed"
            yield told, "navigation.integrity.false_stations", "station"
        yield from mistakes(self.station, names)
        yield from self._station_use()
        if not names:
            yield "there is no craft at all: set swarm.count, or add a [[craft]] entry", "swarm.count"
        for i in range(self.swarm.count, len(names)):
            if names[i] == "lighthouse":
                yield "is the name of the lighthouse itself", f"{tables[i][0]}.name"
            if names[i] in names[:i]:
                yield "another craft has this name", f"{tables[i][0]}.name"
        for name, key in self._named():
            if name not in names:
                yield f"no craft has this name{did_you_mean(name, names)}", key
        for i, (key, table) in enumerate(tables):
            if isinstance(table, SingleCraft) and table.ccd is not None:
                yield from self._station_mistakes(i, table.ccd.target, f"{key}.ccd.target")
            if isinstance(table, SingleCraft) and table.lidar is not None:
                yield from self._lidar_mistakes(table.lidar, f"{key}.lidar")
            if table.motion.kind == "dock" and not self.navigates_relative(names[i], table.motion.target):
                yield from self._station_mistakes(i, table.motion.target, f"{key}.motion.target")
            if table.motion.kind == "formation" and table.motion.about is not None:
                yield from self._about_mistakes(names[i], table.motion.about, f"{key}.motion.about")
        yield from self._pair_mistakes()
        for i, name in enumerate(self.navigation.reference):
            if name in self.navigation.reference[:i]:
                yield "is in the list twice", f"navigation.reference[{i}]"
            yield from self._station_mistakes(-1, name, f"navigation.reference[{i}]")
        yield from self._criteria_mistakes()
        yield from self._waypoint_mistakes()
        yield from self._plug_in_mistakes()

    def _plug_in_mistakes(self) -> Iterator[Mistake]:
        """Refuse what the program's filter alone can give, where a craft has a navigator of its own."""
        integrity = self.navigation.integrity
        for key in dict.fromkeys(key for key, table in self.tables if table.navigator is not None):
            if self.recording.filter:
                told = "a navigator of your own has no history to smooth: leave recording.filter out"
                yield told, f"{key}.navigator", "recording.filter"
            for limit in ("alert_position_mm", "alert_attitude_deg"):
                if getattr(integrity, limit) is not None:
                    told = f"protection levels are of the program's filter: leave navigation.integrity.{limit} out"
                    yield told, f"{key}.navigator", f"navigation.integrity.{limit}"

    def _station_use(self) -> Iterator[Mistake]:
        """Refuse what has no effect, or is not possible, beside [[station]] tables."""
        if not self.station:
            return
        second = self.station[0].second
        silent = ("sync_jitter_ns", "missed_sync_probability", "stray_pulse_rate_hz") if second else ()
        if not second and self.lighthouse.listening_ms is not None:
            yield (
                "circuits of Lighthouse 1.0 wait for flashes all the time",
                "lighthouse.listening_ms",
                "station[0].kind",
            )
        for key in (*silent, "fan_x", "fan_y"):
            if getattr(self.lighthouse, key) != type(self.lighthouse).model_fields[key].default:
                said = "Lighthouse 2.0 has no flash, and its receivers hear modulated light only"
                told = "belongs to the one lighthouse; every [[station]] has errors of its own"
                yield said if key in silent else told, f"lighthouse.{key}", "station"
        if self.recording.angles:
            yield "is for the calibration of the one lighthouse", "recording.angles", "station"
        if self.navigation.calibration is not None:
            yield "is of the one lighthouse; a [[station]] has `calibrated`", "navigation.calibration", "station"
        if self.navigation.coupling == "loose":
            said = "stations are navigated by rows: their poses do not come one by one"
            yield said, "navigation.coupling", "station"
        for i, station in enumerate(self.station):
            if station.craft is not None and self.navigation.reference:
                said = "knows where it stands, but not where a station is that rides on a craft"
                yield said, "navigation.reference", f"station[{i}].craft"
            if station.bearer == "estimate":
                for key in ("false_photodiodes", "false_stations"):
                    if getattr(self.navigation.integrity, key):
                        said = "separates filters that do not count the error of a craft that carries a station"
                        yield said, f"navigation.integrity.{key}", f"station[{i}].bearer"
            if station.bearer == "estimate" and station.craft in self.craft_names:
                bearer = self.tables[self.craft_names.index(station.craft)][1]
                blind = not bearer.lighthouse and getattr(bearer, "ccd", None) is None
                if bearer.passive or blind or bearer.navigator is not None:
                    said = "tells no estimate: it is passive, sees no light, or has a navigator of its own"
                    yield said, f"station[{i}].craft", f"station[{i}].bearer"
        for i, fault in enumerate(self.fault):
            if fault.kind in ONE_LIGHTHOUSE:
                yield "is a fault of the one lighthouse, not of stations", f"fault[{i}].kind", "station"

    def _named(self) -> Iterator[tuple[str, str]]:
        """Yield every name of a craft in a table, with the name's key."""
        for i, fault in enumerate(self.fault):
            yield from _entries(getattr(fault, "craft", ()), f"fault[{i}].craft")
            yield from _entries(getattr(fault, "mirrors", ()), f"fault[{i}].mirrors")
        for i, criterion in enumerate(self.criteria):
            yield from _entries(criterion.craft, f"criteria[{i}].craft")
        yield from _entries(self.recording.detail, "recording.detail")
        yield from _entries(self.navigation.reference, "navigation.reference")
        for i, pair in enumerate(self.pair):
            yield pair.craft, f"pair[{i}].craft"
            yield pair.to, f"pair[{i}].to"
        for key, table in dict(self.tables).items():
            for inner, name in (("ccd", "target"), ("lidar", "target"), ("motion", "target"), ("motion", "about")):
                other = getattr(getattr(table, inner, None), name, None)
                if other is not None:
                    yield other, f"{key}.{inner}.{name}"

    def _station_mistakes(self, craft: int, target: str, key: str) -> Iterator[Mistake]:
        """Require that a craft's target is another craft, and stays where the craft knows it to be."""
        if target not in self.craft_names:
            return
        of = self.craft_names.index(target)
        table, group = self.tables[of]
        if of == craft:
            yield "a craft cannot be its own target", key
        elif group.motion.kind != "hold" or group.motion.attitude.spin_deg_s:
            yield "must hold its position without spin: its pose is known on board", key, f"{table}.motion.kind"
        elif group.feedback != "truth":
            yield 'must hold its position exactly: feedback = "truth"', key, f"{table}.feedback"

    def navigates_relative(self, craft: str, to: str) -> bool:
        """Return whether a [[pair]] says that a craft navigates relative to another."""
        return any((pair.craft, pair.to) == (craft, to) for pair in self.pair)

    def _about_mistakes(self, craft: str, leader: str, key: str) -> Iterator[Mistake]:
        """Require that a craft whose figures move with another one navigates relative to it."""
        if leader == craft:
            yield "a craft cannot move about itself", key
        elif leader in self.craft_names and not self.navigates_relative(craft, leader):
            yield f"{craft} must navigate relative to {leader}: add a [[pair]] of both", key, "pair"

    def _lidar_mistakes(self, lidar: Lidar, key: str) -> Iterator[Mistake]:
        """Require that the target of a LiDAR is passive, and that no scan is shorter than a lighthouse period."""
        if lidar.target not in self.craft_names:
            return
        table, group = self.tables[self.craft_names.index(lidar.target)]
        if not group.passive:
            told = "must be passive: a craft that navigates by itself is not inspected"
            yield told, f"{key}.target", f"{table}.passive"
        if lidar.rate_hz > self.period_hz:
            yield f"at most one scan per lighthouse period, {self.period_hz:g} Hz", f"{key}.rate_hz"

    def _pair_mistakes(self) -> Iterator[Mistake]:
        """Require pairs of two craft that have estimates, each pair once."""
        told = [(pair.craft, pair.to) for pair in self.pair]
        tables = dict(zip(self.craft_names, self.tables, strict=True))
        for i, pair in enumerate(self.pair):
            if pair.craft == pair.to:
                yield "a craft has no pose relative to itself", f"pair[{i}].to", f"pair[{i}].craft"
            if told[i] in told[:i]:
                yield "another pair is of the same two craft", f"pair[{i}].to"
            for key in ("craft", "to"):
                table = tables.get(getattr(pair, key))
                if table is not None and table[1].passive:
                    yield "a passive craft has no estimate to broadcast", f"pair[{i}].{key}", f"{table[0]}.passive"
                if table is not None and not (table[1].lighthouse or getattr(table[1], "ccd", None)):
                    reason = "a craft that sees no light has no estimate to broadcast"
                    yield reason, f"pair[{i}].{key}", f"{table[0]}.lighthouse"
                if table is not None and table[1].navigator is not None:
                    reason = "a navigator of your own does not tell what it shares with others"
                    yield reason, f"pair[{i}].{key}", f"{table[0]}.navigator"

    def _criteria_mistakes(self) -> Iterator[Mistake]:
        """Require one name per criterion."""
        labels = [criterion.label for criterion in self.criteria]
        for i, label in enumerate(labels):
            if label in labels[:i]:
                yield f"another criterion is called {label} too: give one of them a name", f"criteria[{i}].name"

    def _waypoint_mistakes(self) -> Iterator[Mistake]:
        """Require waypoints that begin within the run."""
        for key, group in (("swarm", self.swarm), *((f"craft[{i}]", c) for i, c in enumerate(self.craft))):
            motion = group.motion
            if motion.kind == "waypoints" and motion.times_s[0] >= self.duration_s:
                yield (
                    f"the first time ({motion.times_s[0]:g} s) must lie within the run, which ends at "
                    f"duration_s = {self.duration_s:g} s",
                    f"{key}.motion.times_s",
                    "duration_s",
                )


def _entries(names: tuple[str, ...], key: str) -> Iterator[tuple[str, str]]:
    """Yield the names in a list, with the key of each."""
    for i, name in enumerate(names):
        yield name, f"{key}[{i}]"
