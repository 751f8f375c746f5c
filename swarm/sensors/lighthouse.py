"""The lighthouse: two turning fans and two flashes per period, and the pulses that every craft logs of them.

Lighthouse frame: x right, y down, looking along +z. In the period that starts at t_k = frame / rate, fan X passes its
zero at t_k and fan Y at t_k + T/2. A photodiode, moving with its craft, is hit by a fan at the instant t that solves

    measured(p(t)) + rotor error + own error = w (t - t_0),    w = 2 pi / T            (1), with (E) of
    estimators.lighthouse.sweep

p(t) interpolated between the physics' knots as MuJoCo moves: a straight line and a turn at constant rate. Errors of
one standard deviation s per angle: the rotor's part sqrt(rho) s is one draw per fan and sweep for the whole swarm, the
own part sqrt(1 - rho) s one per photodiode, fan and sweep (19). Jitter shifts the flash, not the rotor.

What a craft logs, in ticks of its own clock (an unknown offset, no drift):
- flash: rises at t_0 + jitter, as long as its fan's code says; seen by every photodiode in that fan's line of sight;
- sweep: centred on the crossing, as long as the fan takes to pass the photodiode's face, a disc: diameter times the
  foreshortening along the fan's motion, over the distance from the rotor's axis, over w. The rise is rounded such that
  rise + width / 2 is within half a tick of the crossing. Nearer than 0.25 m the sweep over a 3 mm face is longer than
  half a flash, and a decoder cannot tell it from one.
Light's travel time (67 ns at 20 m) is left out: it delays flash and sweep alike.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.frame import WORLD, Frame
from estimators.lanes import WIDE
from estimators.lighthouse.sweep import FanErrors, FanPair, kernel_fans, lighthouse_1
from swarm import random
from swarm.draws import Keys, key_of, keys_of, normals
from swarm.hardware import Photodiodes
from swarm.messages import SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, Pulses
from swarm.random import Purpose
from swarm.scenario import Lighthouse as Station
from swarm.sensors.crossing import cross_into, knots_of, side_by_side
from swarm.sensors.light_draws import FLASH, chances_into, draw_room, errors_into, strays
from swarm.sensors.pulses import pack_into, pulse_room
from swarm.units import si


class Motion(Protocol):
    """The part of `swarm.world.PeriodTruth` that the lighthouse needs: knots over the period, in the lighthouse
    frame.
    """

    @property
    def time_s(self) -> Floats:
        """(n + 1,) [s], from the period's start to its end."""

    @property
    def position(self) -> Floats:
        """(n + 1, C, 3) [m]."""

    @property
    def quaternion(self) -> Floats:
        """(n + 1, C, 4) wxyz."""


class Rotor(NamedTuple):
    """The rotor in one period: its speed over the nominal one, and the delay of its zeros [s]."""

    speed: float = 1.0
    phase_s: float = 0.0


class Lighthouse:
    """Pulses of every craft, period by period; the same for the same frame, in whatever order frames are asked.

    A draw depends on the seed, its kind, the craft's key, the photodiode and the frame: not on what is lit, on other
    craft, their number, padding, or the strength of any error.
    """

    photodiodes: Photodiodes
    """The photodiodes as they really are: the drawn layout plus the mounting error."""
    keys: Keys
    """(C,) what the draws of each craft's light are named by."""
    clock_offset_tick: Floats
    """(C,) what each craft's clock shows at time zero [ticks]; a craft never learns it."""

    def __init__(
        self,
        layout: Photodiodes,
        station: Station,
        seed: int,
        craft_keys: Sequence[int] | None = None,
        frame: Frame = WORLD,
    ) -> None:
        """Prepare the draws.

        Args:
            layout: The photodiodes as drawn.
            station: The scenario's table.
            seed: The run's seed.
            craft_keys: Different numbers >= 0, one per craft, that name the craft for good, if they may change places.
            frame: The station's frame in the world.
        """
        self.settings = settings = si(station)
        self.fans = fans(station)
        self._frame = frame
        names = list(range(layout.craft_count)) if craft_keys is None else [int(key) for key in craft_keys]
        if len(set(names)) != layout.craft_count:
            raise ValueError(f"{layout.craft_count} different craft keys needed, not {names}")
        self.keys, self._rotor = keys_of(seed, Purpose.LIGHT, names), key_of(seed, Purpose.LIGHT)
        self._count = layout.present.sum(axis=1)
        flash_s = SYNC_WIDTH_S + SYNC_WIDTH_STEP_S * np.arange(2)
        self._flash_ticks = np.rint(flash_s / settings.tick_s).astype(np.int64)
        self._fans = kernel_fans(lighthouse_1(*self.fans))
        point = layout.point_m.copy()
        offset = np.empty(layout.craft_count)
        for i, key in enumerate(names):
            mounted = seed if settings.mounting_seed is None else settings.mounting_seed
            mounting = random.stream(mounted, Purpose.MOUNTING, key).standard_normal((self._count[i], 3))
            point[i, layout.present[i]] += settings.mounting_error_m * mounting
            # Up to 20 min of ticks, and never so few that a jitter in frame 0 makes them negative.
            offset[i] = random.stream(seed, Purpose.CLOCK, key).uniform(1e6, 1e6 + 1200.0 / settings.tick_s)
        self.photodiodes = layout._replace(point_m=point)
        self._draws, self._sweeps = draw_room(point.shape[1]), pulse_room(point.shape[1])
        self._points, self._normals = side_by_side(point), side_by_side(layout.normal)
        self.clock_offset_tick = offset

    def sweep(self, truth: Motion, frame: int, lit: Bools, rotor: Rotor | None = None) -> Pulses:
        """Return the pulses that every craft logs in one period.

        Args:
            truth: The motion of the craft in the period.
            frame: The number of the period.
            lit: Whether a photodiode is in line of sight as fan X, Y sweeps, (C, K, 2).
            rotor: The rotor's turning, if not as it should be.

        Raises:
            ValueError: An array has a wrong shape.
        """
        true = self.photodiodes
        shape = (*true.present.shape, 2)
        if lit.shape != shape:
            raise ValueError(f"lit must have shape {shape}, not {lit.shape}")
        if truth.position.shape[1:] != (true.craft_count, 3) or truth.quaternion.shape[1:] != (true.craft_count, 4):
            raise ValueError(f"motion of {true.craft_count} craft needed, not {truth.position.shape}")
        turn = rotor or Rotor()
        instant, width = self._crossings(truth, frame, lit, turn)
        return self._logged(frame, lit, turn, instant, width)

    def _crossings(self, truth: Motion, frame: int, lit: Bools, turn: Rotor) -> tuple[Floats, Floats]:
        """Return the instants and widths of the sweeps, WIDE craft side by side, (G, 2, K, WIDE) each [s]."""
        settings = self.settings
        position, quaternion = self._frame.poses_into(truth.position, truth.quaternion)
        rho, noise = settings.rotor_correlation, settings.angle_noise_rad
        error, instant, width = np.empty((3, len(self._points), 2, lit.shape[1], WIDE))
        errors_into(self.keys, self._rotor, frame, lit, noise * sqrt(1 - rho), noise * sqrt(rho), self._draws, error)
        cross_into(
            knots_of(truth.time_s - truth.time_s[0] - turn.phase_s, position, quaternion),
            self._points,
            self._normals,
            error,
            self._fans,
            1 / settings.rate_hz / turn.speed,
            settings.photodiode_diameter_m,
            instant,
            width,
        )
        return instant + turn.phase_s if turn.phase_s else instant, width

    def _logged(self, frame: int, lit: Bools, turn: Rotor, instant: Floats, width: Floats) -> Pulses:
        """Return what the timing circuits log of the flashes, the sweeps and stray light."""
        settings, craft, period = self.settings, len(lit), 1 / self.settings.rate_hz
        jitter = settings.sync_jitter_s * np.array(normals(self._rotor, frame, 0, FLASH))
        flash = turn.phase_s + np.array([0.0, period / turn.speed / 2]) + jitter
        flashed = lit
        chances = settings.missed_sync_probability, settings.lost_pulse_probability
        if any(chances):
            flashed = lit.copy()
            chances_into(self.keys, frame, *chances, flashed, instant)
        stray = strays(self.keys, self._count, frame, settings.stray_pulse_rate_hz, period)
        most = 4 * lit.shape[1] + stray.pulse.shape[1]
        pulses = Pulses(
            np.empty((craft, most), dtype=np.int16),
            np.empty((craft, most), dtype=np.int64),
            np.empty((craft, most), dtype=np.int32),
            np.empty(craft, dtype=np.int32),
        )
        pack_into(
            flashed,
            instant,
            width,
            stray.number,
            stray.pulse,
            flash,
            self._flash_ticks,
            self.clock_offset_tick + frame * period / settings.tick_s,
            settings.tick_s,
            self._sweeps,
            pulses,
        )
        used = int(pulses.total.max(initial=0))
        return Pulses(
            pulses.photodiode[:, :used], pulses.rise_tick[:, :used], pulses.width_tick[:, :used], pulses.total
        )


def fans(station: Station) -> FanPair:
    """Return the systematic errors of both fans, X first."""
    return FanErrors(**station.fan_x.model_dump()), FanErrors(**station.fan_y.model_dump())
