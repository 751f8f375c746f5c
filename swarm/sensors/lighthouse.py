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
from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.frame import WORLD, Frame
from estimators.lighthouse.sweep import FanErrors, FanPair, kernel_fans, lighthouse_1
from swarm import random
from swarm.hardware import Photodiodes
from swarm.messages import SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, Pulses
from swarm.random import Blocks, Purpose
from swarm.scenario import Lighthouse as Station
from swarm.sensors.crossing import cross_into, pack_into
from swarm.units import si

BLOCK = 64
"""Frames whose random numbers are drawn at once."""
STRAY_WIDTH_MAX_S = SYNC_WIDTH_S / 10
"""Longest stray pulse [s]."""


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


class _Draws(NamedTuple):
    """Random numbers of one block of B frames; angles are standard normal, strays uniform in [0, 1)."""

    rotor: Floats  # (B, 2)
    sync: Floats  # (B, 2)
    angle: Floats  # (B, C, K, 2)
    missed: Bools  # (B, C, 2)
    lost: Bools  # (B, C, K, 2)
    strays: Ints  # (B, C)
    stray: Floats  # (B, C, S, 3): photodiode, instant, width


class Lighthouse:
    """Pulses of every craft, period by period; the same for the same frame, in whatever order frames are asked.

    A draw depends on the seed, its purpose, the craft's key, its number of photodiodes and the frame: not on what is
    lit, other craft, their number, padding, or the strength of any error.
    """

    photodiodes: Photodiodes
    """The photodiodes as they really are: the drawn layout plus the mounting error."""
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
        self._seed, self._frame = seed, frame
        self._keys = list(range(layout.craft_count)) if craft_keys is None else [int(key) for key in craft_keys]
        if len(set(self._keys)) != layout.craft_count:
            raise ValueError(f"{layout.craft_count} different craft keys needed, not {self._keys}")
        self._count = layout.present.sum(axis=1)
        self._fans = kernel_fans(lighthouse_1(*self.fans))
        point = layout.point_m.copy()
        offset = np.empty(layout.craft_count)
        for i, key in enumerate(self._keys):
            mounted = seed if settings.mounting_seed is None else settings.mounting_seed
            mounting = random.stream(mounted, Purpose.MOUNTING, key).standard_normal((self._count[i], 3))
            point[i, layout.present[i]] += settings.mounting_error_m * mounting
            # Up to 20 min of ticks, and never so few that a jitter in frame 0 makes them negative.
            offset[i] = self._stream(Purpose.CLOCK, key).uniform(1e6, 1e6 + 1200.0 / settings.tick_s)
        self.photodiodes = layout._replace(point_m=point)
        self.clock_offset_tick = offset
        self._draws = Blocks(BLOCK, self._draw)

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
        """Return the instants of the sweeps in the period, and their widths, (C, K, 2) each [s]."""
        settings, true = self.settings, self.photodiodes
        position, quaternion = self._frame.poses_into(truth.position, truth.quaternion)
        draws, i = self._draws.at(frame)
        rho, noise = settings.rotor_correlation, settings.angle_noise_rad
        angle_error = (noise * np.sqrt(1 - rho)) * draws.angle[i]
        angle_error += (noise * np.sqrt(rho)) * draws.rotor[i]
        instant, width = np.empty(lit.shape), np.empty(lit.shape)
        cross_into(
            np.ascontiguousarray(truth.time_s - truth.time_s[0] - turn.phase_s),
            np.ascontiguousarray(position),
            np.ascontiguousarray(quaternion),
            true.point_m,
            true.normal,
            lit,
            angle_error,
            self._fans,
            1 / settings.rate_hz / turn.speed,
            settings.photodiode_diameter_m,
            instant,
            width,
        )
        return instant + turn.phase_s if turn.phase_s else instant, width

    def _logged(self, frame: int, lit: Bools, turn: Rotor, instant: Floats, width: Floats) -> Pulses:
        """Return what the timing circuits log of the flashes, the sweeps and stray light."""
        settings, (draws, i) = self.settings, self._draws.at(frame)
        craft, period = len(lit), 1 / settings.rate_hz
        flash = turn.phase_s + np.array([0.0, period / turn.speed / 2]) + settings.sync_jitter_s * draws.sync[i]
        flash_width = (SYNC_WIDTH_S + SYNC_WIDTH_STEP_S * np.arange(2)) / settings.tick_s
        # A stray: which of its photodiodes, which instant of the period, how long.
        scale = np.stack([self._count, np.full(craft, period), np.full(craft, STRAY_WIDTH_MAX_S)], axis=-1)
        stray = draws.stray[i] * scale[:, None, :]
        most = 4 * lit.shape[1] + stray.shape[1]
        photodiode = np.full((craft, most), -1, dtype=np.int16)
        rise, wide = np.zeros((craft, most), dtype=np.int64), np.zeros((craft, most), dtype=np.int32)
        total = np.zeros(craft, dtype=np.int32)
        pack_into(
            lit & ~draws.missed[i][:, None, :],
            instant,
            width,
            draws.lost[i],
            draws.strays[i],
            stray,
            flash,
            np.rint(flash_width).astype(np.int64),
            self.clock_offset_tick + frame * period / settings.tick_s,
            settings.tick_s,
            photodiode,
            rise,
            wide,
            total,
        )
        used = int(total.max(initial=0))
        return Pulses(photodiode[:, :used], rise[:, :used], wide[:, :used], total)

    def _stream(self, purpose: Purpose, *numbers: int) -> np.random.Generator:
        return random.stream(self._seed, purpose, *numbers)

    def _draw(self, block: int) -> _Draws:
        settings, present = self.settings, self.photodiodes.present
        craft, most = present.shape
        angle = np.zeros((BLOCK, craft, most, 2))
        missed = np.zeros((BLOCK, craft, 2), dtype=np.bool_)
        lost = np.zeros((BLOCK, craft, most, 2), dtype=np.bool_)
        strays = np.zeros((BLOCK, craft), dtype=np.int64)
        stray = []
        for i, key in enumerate(self._keys):
            own = (BLOCK, int(self._count[i]), 2)
            # Photodiodes come before the padding, and a slice is quicker than a mask.
            which = slice(own[1]) if present[i, : own[1]].all() else present[i]
            angle[:, i, which] = self._stream(Purpose.ANGLE, key, block).standard_normal(own)
            if settings.missed_sync_probability > 0:
                chance = self._stream(Purpose.MISSED_SYNC, key, block).random((BLOCK, 2))
                missed[:, i] = chance < settings.missed_sync_probability
            if settings.lost_pulse_probability > 0:
                chance = self._stream(Purpose.LOST_PULSE, key, block).random(own)
                lost[:, i, present[i]] = chance < settings.lost_pulse_probability
            if settings.stray_pulse_rate_hz > 0 and self._count[i] > 0:
                stream = self._stream(Purpose.STRAY_PULSE, key, block)
                strays[:, i] = stream.poisson(settings.stray_pulse_rate_hz / settings.rate_hz, BLOCK)
                stray.append((i, stream.random((BLOCK, int(strays[:, i].max()), 3))))
        padded = np.zeros((BLOCK, craft, int(strays.max(initial=0)), 3))
        for i, drawn in stray:
            padded[:, i, : drawn.shape[1]] = drawn
        return _Draws(
            self._stream(Purpose.ROTOR, block).standard_normal((BLOCK, 2)),
            self._stream(Purpose.SYNC, block).standard_normal((BLOCK, 2)),
            angle,
            missed,
            lost,
            strays,
            padded,
        )


def fans(station: Station) -> FanPair:
    """Return the systematic errors of both fans, X first."""
    return FanErrors(**station.fan_x.model_dump()), FanErrors(**station.fan_y.model_dump())
