"""The faults of one run, applied at their place: in the light, in the pulses, in a craft's control or its computer.

Per lighthouse period the run loop calls `begin`, and then

    idle, blow, thrusters              craft without control, changes of motion, thrusters that do not obey
    light, seen, rotor                 remaining light, what is to be seen of it, and the rotor's speed
    signals                            photodiodes dead or stuck, reflections, missed flashes
    restarting                         craft whose computer forgets its state
    states                             faults of every craft, for the telemetry

The craft's computers receive none of this information.
"""

from collections.abc import Sequence
from math import prod

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.sweep import measured_theta, time_from_theta
from swarm.draws import Keys, key_of, uniform_rows
from swarm.flight.faults.schedule import Schedule, Window, speed_swing
from swarm.messages import BeamHits, Pulses, Signals
from swarm.random import Purpose
from swarm.scenario.faults import (
    AnyFault,
    CraftLost,
    Ghosts,
    LighthouseDark,
    PhotodiodeDead,
    PhotodiodeStuck,
    Reflection,
    Restart,
    RotorDrift,
    SyncLoss,
    ThrusterStuck,
)
from swarm.sensors import mirror
from swarm.sensors import pulse_faults as pulses
from swarm.sensors.lighthouse import Lighthouse, Motion, Rotor
from swarm.sensors.pulse_faults import Clock, Register, Row
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import Visibility
from swarm.units import si
from swarm.world.execution import StuckThruster
from swarm.world.pushes import Blow


class NoFaults:
    """A run of C craft without faults."""

    names: tuple[str, ...] = ()
    """Names of the combinations of faults that a craft may have at one time; empty without faults."""

    def __init__(self, craft: int) -> None:
        self._nobody = np.zeros(craft, dtype=np.bool_)

    def begin(self, frame: int) -> None:
        """Advance to period `frame`."""

    def states(self) -> Ints | None:
        """Return the index in `names` of every craft's faults, (C,); None without faults."""
        return None

    def idle(self) -> Bools:
        """Return the craft (C,) whose control does nothing: lost ones, and those whose computer is restarting."""
        return self._nobody

    def restarting(self) -> Bools | None:
        """Return the craft (C,) whose computer is restarting; None if no craft of the run ever does."""
        return None

    def blow(self) -> Blow | None:
        """Return the sudden changes of the craft's motion in this period, if any."""
        return None

    def thrusters(self) -> Sequence[StuckThruster]:
        """Return the thrusters that do not obey."""
        return ()

    def light(self, lit: Bools) -> Bools:
        """Return the photodiodes (C, K, 2) that receive light, of those in its way."""
        return lit

    def seen(self, sight: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode over the period, (C, K), from that without faults."""
        return sight

    def rotor(self) -> Rotor | None:
        """Return the rotor's speed and phase at mid-period; None if they are nominal."""
        return None

    def signals(self, truth: Motion, lit: Bools, given: Signals) -> Signals:
        """Return the signals of this period as the craft receive them.

        Args:
            truth: true motion of the craft.
            lit: photodiodes that receive light, as `Sensors.sight` has them.
            given: signals of sensors without a fault.
        """
        return given


class Faults(NoFaults):
    """The faults of C craft; those of a period do not depend on the order in which the random streams are used."""

    def __init__(
        self,
        faults: Sequence[AnyFault],
        names: Sequence[str],
        keys: Sequence[int],
        seed: int,
        duration_s: float,
        lighthouse: Lighthouse,
        visibility: Visibility,
        period_hz: float,
    ) -> None:
        """Draw the schedule of all faults.

        Args:
            faults: faults of the scenario.
            names: names of the craft.
            keys: number of each craft's random streams.
            seed: seed of the run.
            duration_s: length of the run [s].
            lighthouse: lighthouse, whose pulses the faults change.
            visibility: visibility of the photodiodes, for reflections.
            period_hz: number of periods per second [Hz].
        """
        self._rate_hz = period_hz
        self.schedule = Schedule(faults, names, keys, seed, self._rate_hz, duration_s)
        super().__init__(len(names))
        self.names = self.schedule.names
        self._names, self._keys, self._seed = list(names), list(keys), seed
        self._lighthouse, self._visibility = lighthouse, visibility
        self._frame, self._now = 0, list[Window]()
        self._registers: dict[tuple[int, int, int, int], Register] = {}
        self._draws: dict[tuple[int, int], Keys] = {}

    def begin(self, frame: int) -> None:
        """Advance to period `frame`."""
        self._frame, self._now = frame, self.schedule.at(frame)

    def states(self) -> Ints:
        """Return the index in `names` of every craft's faults, (C,)."""
        return self.schedule.states(self._frame)

    def idle(self) -> Bools:
        """Return the craft (C,) that are lost, or whose computer is restarting."""
        return self._of(CraftLost) | self._of(Restart)

    def blow(self) -> Blow | None:
        """Return the sudden changes of the craft's motion in this period, if any."""
        out = np.zeros((2, len(self._names), 3))
        for window in self._now:
            if isinstance(window.fault, CraftLost) and window.first == self._frame:
                out[0, window.craft] += window.fault.velocity_m_s
                out[1, window.craft] += si(window.fault).angular_rate_rad_s
        return Blow(out[0], out[1]) if out.any() else None

    def thrusters(self) -> list[StuckThruster]:
        """Return the thrusters that do not obey."""
        return [
            StuckThruster(window.craft, window.fault.thruster, window.fault.state == "on")
            for window in self._now
            if isinstance(window.fault, ThrusterStuck)
        ]

    def restarting(self) -> Bools:
        """Return the craft (C,) whose computer is restarting."""
        return self._of(Restart)

    def light(self, lit: Bools) -> Bools:
        """Return the photodiodes (C, K, 2) that receive light, of those in its way."""
        return np.zeros_like(lit) if self._dark else lit

    def seen(self, sight: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode over the period, (C, K), from that without faults."""
        nothing: NDArray[np.int8] = np.full_like(sight, Sight.OUTSIDE)
        return np.where(self._dead(sight.shape), np.int8(Sight.DEAD), nothing if self._dark else sight)

    @property
    def _dark(self) -> bool:
        return any(isinstance(window.fault, LighthouseDark) for window in self._now)

    def _dead(self, shape: tuple[int, ...]) -> Bools:
        """Return the photodiodes (C, K) that do not answer."""
        out = np.zeros(shape, dtype=np.bool_)
        for window in self._now:
            if isinstance(window.fault, PhotodiodeDead):
                out[window.craft, window.fault.photodiodes] = True
        return out

    def rotor(self) -> Rotor | None:
        """Return the rotor's speed and phase at mid-period; None if they are nominal."""
        speed, phase_s = 0.0, 0.0
        for window in self._now:
            if isinstance(window.fault, RotorDrift):
                time_s = (self._frame + 0.5 - window.first) / self._rate_hz
                more, later = speed_swing(time_s, window.fault.for_s, si(window.fault).speed)
                speed, phase_s = speed + float(more), phase_s + float(later)
        return Rotor(1 + speed, phase_s) if speed or phase_s else None

    def signals(self, truth: Motion, lit: Bools, given: Signals) -> Signals:
        """Return the signals of this period as the craft receive them, with the faults of the lighthouse's light.

        Args:
            truth: true motion of the craft.
            lit: photodiodes that receive light, as `Sensors.sight` has them.
            given: signals of sensors without a fault.
        """
        pulses = self.pulses(truth, lit, given.pulses)
        return given._replace(pulses=pulses, beams=None if given.beams is None else self._beams(given.beams))

    def _beams(self, given: BeamHits) -> BeamHits:
        """Return the hits of Lighthouse 2.0 without those of dead photodiodes."""
        dark = np.zeros(given.photodiode.shape, dtype=np.bool_)
        for window in self._now:
            if isinstance(window.fault, PhotodiodeDead):
                dark[window.craft] |= np.isin(given.photodiode[window.craft], window.fault.photodiodes)
        return given.without(dark) if dark.any() else given

    def pulses(self, truth: Motion, lit: Bools, given: Pulses) -> Pulses:
        """Return the pulses of this period as the craft log them.

        Args:
            truth: true motion of the craft.
            lit: photodiodes that receive light, (C, K, 2).
            given: pulses that the lighthouse causes in them.
        """
        rows: dict[int, Row] = {}
        # First the light at a photodiode, then the photodiode's faults, then the flashes that the circuit misses.
        for kind in (Reflection, Ghosts, PhotodiodeStuck, PhotodiodeDead, SyncLoss):
            for window in self._now:
                if isinstance(window.fault, kind):
                    before = rows.get(window.craft, pulses.row_of(given, window.craft))
                    rows[window.craft] = self._changed(window, before, truth, lit)
        return pulses.with_rows(given, rows) if rows else given

    def _changed(self, window: Window, row: Row, truth: Motion, lit: Bools) -> Row:
        """Return one craft's row after one of its faults."""
        clock, fault = self._clock(window.craft), window.fault
        match fault:
            case Reflection():
                return self._reflected(fault, window.craft, row, clock, truth, lit)
            case Ghosts():
                draws = self._draw(window, (lit.shape[1], 2, 2))
                struck, shift = draws[..., 0] < fault.share, 2 * draws[..., 1] - 1
                return pulses.moved(row, clock, struck, si(fault).spread_rad * shift)
            case PhotodiodeStuck():
                for k in fault.photodiodes:
                    key = (window.number, window.craft, window.first, k)
                    row = self._registers.setdefault(key, Register()).stuck(row, clock, k)
                return row
            case PhotodiodeDead():
                return pulses.only(row, ~pulses.of_photodiodes(row, fault.photodiodes))
            case SyncLoss():
                return pulses.without_flashes(row, clock, self._draw(window, (2,)) < fault.missed_sync_probability)
            case _:
                raise TypeError(f"{fault.kind} is no fault of pulses")

    def _reflected(self, fault: Reflection, craft: int, row: Row, clock: Clock, truth: Motion, lit: Bools) -> Row:
        """Return the row with the sweeps that mirrors reflect.

        The reflections are those of the craft's poses at the physics' knot in mid-sweep.
        """
        if any(isinstance(window.fault, LighthouseDark) for window in self._now):
            return row
        named = [self._names.index(name) for name in fault.mirrors]
        mirrors = [j for j in named or range(len(self._names)) if j != craft]
        settings, layout = self._lighthouse.settings, self._lighthouse.photodiodes
        rotor = self.rotor() or Rotor()
        knots = len(truth.time_s) - 1
        for fan, knot in enumerate((knots // 4, 3 * knots // 4)):
            pose = truth.position[knot], truth.quaternion[knot]
            seen = mirror.ghosts(self._visibility, layout, craft, mirrors, settings, *pose)
            if not len(seen.photodiode):
                continue
            theta = measured_theta(seen.point_m, self._lighthouse.fans)[:, fan]
            rate_hz = self._rate_hz * rotor.speed
            instant = rotor.phase_s + fan / 2 / rate_hz + time_from_theta(theta, rate_hz)
            width = settings.photodiode_diameter_m / seen.way_m / (2 * np.pi * rate_hz)
            if fault.outshines:
                direct = pulses.of_photodiodes(row, seen.photodiode) & (clock.fan(row) == fan) & ~clock.flash(row)
                row = pulses.only(row, ~direct)
            row = pulses.joined(row, clock.pulse(seen.photodiode, instant, width))
        return row

    def _of(self, kind: type[CraftLost] | type[Restart]) -> Bools:
        out = np.zeros(len(self._names), dtype=np.bool_)
        out[[window.craft for window in self._now if isinstance(window.fault, kind)]] = True
        return out

    def _clock(self, craft: int) -> Clock:
        period_s, tick_s = 1 / self._rate_hz, self._lighthouse.settings.tick_s
        start = self._lighthouse.clock_offset_tick[craft] + self._frame * period_s / tick_s
        return Clock(float(start), tick_s, period_s)

    def _draw(self, window: Window, shape: tuple[int, ...]) -> Floats:
        """Return uniform random numbers of this period, of this fault and craft."""
        own = (window.number, self._keys[window.craft])
        if own not in self._draws:
            self._draws[own] = np.array([key_of(self._seed, Purpose.FAULT, *own)])
        return uniform_rows(self._draws[own], self._frame, prod(shape)).reshape(shape)
