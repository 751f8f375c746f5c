"""The scenario's own table, with those of the physics and the recording; the other tables have files of their own.

The scenario reference, the JSON schema for editors and the error messages show the description of every field. Nothing
here computes; `swarm.units.si` gives a table in SI units.
"""

from collections.abc import Iterator
from itertools import chain
from typing import Annotated, Literal

from pydantic import Field, Strict

from swarm.errors import did_you_mean
from swarm.scenario.criteria import Criterion
from swarm.scenario.dynamics import Orbit
from swarm.scenario.faults import AnyFault
from swarm.scenario.fleet import SingleCraft, Swarm
from swarm.scenario.lidar import Lidar
from swarm.scenario.lighthouse import Lighthouse
from swarm.scenario.limits import (
    DURATION,
    SEED,
    STEPS,
)
from swarm.scenario.navigation import Navigation
from swarm.scenario.relative import Pair
from swarm.scenario.stations import NAME_PATTERN, Station, mistakes
from swarm.scenario.table import Mistake, Table

ONE_LIGHTHOUSE = ("reflection", "ghosts", "photodiode-stuck", "rotor-drift", "sync-loss")
"""Faults in the light of the one lighthouse."""
LEAST_BELIEF = 0.2
"""Least share of the lighthouse's angle noise that craft may assume: at that, the NEES is 25 times too large."""


class Physics(Table):
    """MuJoCo simulates the bodies of the craft."""

    steps_per_period: Annotated[int | None, STEPS] = Field(
        default=None,
        ge=2,
        le=256,
        multiple_of=2,
        description="Number of MuJoCo steps per period, even. Unset: the least of 2, 4, 8 ... 64 whose errors stay "
        "below 20 um and 20 arcsec in a period, 1.2 mm and 0.1 deg in a second (docs/physics.md).",
    )


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
