"""The light of several lighthouse stations: what every craft logs of their sweeps and flashes, period by period.

A station stands in the world, or rides on a craft; each has its own rays to the photodiodes (`visibility`) and planes
that pass over them (`passage`).

Lighthouse 2.0: a rotor of channel n turns once in the ticks of its channel, whatever the period of the simulation is,
from a phase that is drawn. A plane looks along the boresight when a third of a turn after the rotor's zero has passed
(the first), or two thirds (the second). Several sweeps of a plane may fall into a period, or none. `reception` says
which hits overlap, and which know their station.

Lighthouse 1.0: one station, or two in the modes b and c. Both flash every half turn, the second SLOT_S after the
first, and they take turns sweeping, one turn each; the skip bit marks the station that does not sweep. A period is as
many turns as there are stations.
"""

from collections.abc import Sequence
from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.frame import Frame
from estimators.kernel import kernel
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS, share_of
from estimators.lighthouse.sweep import Fan, kernel_fans
from estimators.rotation import matrix_from_quaternion, quaternion_from_matrix, quaternion_multiply
from swarm.draws import Keys, key_of, normals, uniforms
from swarm.messages import SKIP_BIT, SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, BeamHits, Bearers, Pulses
from swarm.random import Purpose
from swarm.sensors.light_draws import FLASH, LOST, MISSED, Strays, strays
from swarm.sensors.lighthouse import Lighthouse, Motion
from swarm.sensors.passage import Passages, Sweeps, no_passages, pass_into, segments
from swarm.sensors.reception import identified, in_order, overlapped
from swarm.sensors.visibility import Visibility

SLOT_S = 20000 / 48e6
"""Delay of the second Lighthouse 1.0 station's flash after the first's [s]."""


ONE_LOOK_S = 0.025
"""Longest time of Lighthouse 2.0 light for which one look at what is lit is enough: within half of it, a craft of 1 m/s
moves by as little as 12 mm."""


class Emitter(NamedTuple):
    """One station as it really is.

    name: its name. key: names its draws. channel: of Lighthouse 2.0, from 1; 0 for Lighthouse 1.0. fans: its planes
    with their errors. noise_rad: standard deviation of an angle. correlation: share of its variance that is the
    rotor's. beam_m: thickness of the planes [m]. phase: of the rotor at time 0 [turns]. craft: craft that it rides on;
    -1: none. frame: its frame in the world, or in that craft's. visibility: its rays.
    """

    name: str
    key: int
    channel: int
    fans: Sequence[Fan]
    noise_rad: float
    correlation: float
    beam_m: float
    phase: float
    craft: int
    frame: Frame
    visibility: Visibility


class Stations:
    """The light of S stations on C craft.

    overlaps: hits that each craft has lost in the period shone last to two beams at once, (C,); None: none can be.

    A draw depends on the seed, the station, the craft's key, the photodiode and the number of the sweep: not on what
    is lit, other craft or stations, or the strength of any error.
    """

    def __init__(
        self,
        receiver: Lighthouse,
        emitters: Sequence[Emitter],
        seed: int,
        craft_keys: Sequence[int],
        period_s: float,
    ) -> None:
        """Prepare the draws.

        Args:
            receiver: the photodiodes and timing circuits, which a single lighthouse's light reaches as well.
            emitters: the stations, all of one generation.
            seed: the run's seed.
            craft_keys: number that names each craft, (C,).
            period_s: length of a period [s].
        """
        self.settings, self.emitters, self._period_s = receiver.settings, tuple(emitters), period_s
        self.photodiodes, self.clock_offset_tick = receiver.photodiodes, receiver.clock_offset_tick
        self.second = emitters[0].channel > 0
        self._open_s = receiver.settings.listening_s
        # Lighthouse 2.0 sweeps at any time: the middle stands for a period of a turn or less, or of the listening.
        self.looks = 1 if self.second and (self._open_s or period_s) <= ONE_LOOK_S else 2
        self._fans = [kernel_fans(emitter.fans) for emitter in emitters]
        self._rotor_keys = [
            [key_of(seed, Purpose.LIGHT, e.key, plane) for plane in range(len(e.fans))] for e in emitters
        ]
        self._keys = [
            [
                np.array([key_of(seed, Purpose.LIGHT, e.key, plane, key) for key in craft_keys], dtype=np.uint64)
                for plane in range(len(e.fans))
            ]
            for e in emitters
        ]
        self._own_keys = receiver.keys
        self._share = [float(share) for share in share_of(np.zeros(2), np.arange(2))]
        self._count = self.photodiodes.present.sum(axis=1)
        self._still: dict[tuple[int, int], Floats] = {}  # the motions of stations that do not move
        self.overlaps: Ints | None = None

    def _knots(self, truth: Motion) -> tuple[int, ...]:
        """Return the knots at which the rays are cast: in the middle of the period, or of both its halves."""
        steps = len(truth.time_s) - 1
        return (steps // 2,) if self.looks == 1 else (steps // 4, 3 * steps // 4)

    def sight(self, truth: Motion) -> NDArray[np.int8]:
        """Return the `Sight` of every photodiode from every station at each look, (C, K, S * L)."""
        out = np.empty((*self.photodiodes.present.shape, len(self.emitters) * self.looks), dtype=np.int8)
        for s, emitter in enumerate(self.emitters):
            for look, knot in enumerate(self._knots(truth)):
                pose = truth.position[knot], truth.quaternion[knot]
                if emitter.craft >= 0:
                    emitter.visibility.move(_ridden(emitter, *pose))
                emitter.visibility.state_into(*pose, self.looks * s + look, out)
        return out

    def seen(self, sight: NDArray[np.int8]) -> NDArray[np.int8]:
        """Return the best `Sight` of every photodiode from any station, (C, K), from that of `sight`."""
        each = sight.reshape(*sight.shape[:2], len(self.emitters), self.looks).min(axis=-1)
        best: NDArray[np.int8] = each.max(axis=-1)
        return best

    def bearers(self, truth: Motion) -> Bearers | None:
        """Return the motion of the craft that stations ride on; None if none does."""
        craft = [emitter.craft for emitter in self.emitters if emitter.craft >= 0]
        if not craft:
            return None
        offset_s = truth.time_s - truth.time_s[len(truth.time_s) // 2]
        return Bearers(offset_s, matrix_from_quaternion(truth.quaternion[:, craft]), truth.position[:, craft])

    def shine(self, truth: Motion, frame: int, lit: Bools) -> tuple[Pulses, BeamHits | None]:
        """Return what every craft logs in one period, of either generation.

        Args:
            truth: true motion over the period.
            frame: number of the period.
            lit: photodiodes that the light reaches at each look, (C, K, S * L).

        Raises:
            ValueError: an array has a wrong shape.
        """
        shape = (*self.photodiodes.present.shape, len(self.emitters) * self.looks)
        if lit.shape != shape:
            raise ValueError(f"lit must have shape {shape}, not {lit.shape}")
        passages, count = self._passages(truth, frame, lit)
        if self.second:
            return no_pulses(len(lit)), self._beams(frame, passages, count)
        return self._pulses(frame, lit, passages, count), None

    def _passages(self, truth: Motion, frame: int, lit: Bools) -> tuple[Passages, int]:
        """Return the passages of all planes in the period, in order of station and plane, and their number."""
        settings, looks = self.settings, self.looks
        knot = np.ascontiguousarray(truth.time_s - truth.time_s[0])
        look_s = np.array([knot[k] for k in self._knots(truth)])
        plan = [
            (s, plane, self._sweeps(s, plane, frame, look_s))
            for s in range(len(self.emitters))
            for plane in range(len(self.emitters[s].fans))
        ]
        reached = np.ascontiguousarray(np.moveaxis(lit, -1, 0)).reshape(-1, looks, *lit.shape[:2])
        by_look = np.count_nonzero(reached, axis=(2, 3))
        out = no_passages(sum(int(by_look[s][sweeps.look].sum()) for s, _, sweeps in plan))
        craft = segments(knot, truth.position, truth.quaternion)
        station = [self._motion(emitter, knot, truth) for emitter in self.emitters]
        count = 0
        for s, plane, sweeps in plan:
            emitter, before = self.emitters[s], count
            rho, noise = emitter.correlation, emitter.noise_rad
            count = pass_into(
                knot,
                craft,
                station[s],
                self.photodiodes.point_m,
                self.photodiodes.normal,
                reached[s],
                sweeps,
                self._fans[s][plane],
                2 * np.pi / self._turn_s(emitter),
                self._rotor_keys[s][plane],
                self._keys[s][plane],
                noise * float(np.sqrt(1 - rho)),
                noise * float(np.sqrt(rho)),
                (settings.photodiode_diameter_m, emitter.beam_m),
                self._window(),
                count,
                out,
            )
            out.station[before:count], out.plane[before:count] = s, plane
        return out, count

    def _motion(self, emitter: Emitter, knot: Floats, truth: Motion) -> Floats:
        """Return the motion of a station between the knots, (n, SEGMENT)."""
        turn = np.broadcast_to(quaternion_from_matrix(emitter.frame.rotation), (len(knot), 1, 4))
        if emitter.craft < 0:
            name = emitter.key, len(knot)
            if name not in self._still:
                place = np.broadcast_to(emitter.frame.position, (len(knot), 1, 3))
                self._still[name] = segments(knot, place, turn)[:, 0]
            return self._still[name]
        own = slice(emitter.craft, emitter.craft + 1)
        position, quaternion = truth.position[:, own], truth.quaternion[:, own]
        arm = matrix_from_quaternion(quaternion) @ emitter.frame.position
        return segments(knot, position + arm, quaternion_multiply(quaternion, turn))[:, 0]

    def _window(self) -> tuple[float, float]:
        """Return the time within a period at which light is logged [s]."""
        middle, half = self._period_s / 2, (self._open_s or self._period_s) / 2
        return max(0.0, middle - half), min(self._period_s, middle + half)

    def _turn_s(self, emitter: Emitter) -> float:
        """Return the duration of a turn of a station's rotor [s]."""
        if self.second:
            return CHANNEL_TICKS[emitter.channel - 1] / CHANNEL_CLOCK_HZ
        return float(1 / self.settings.rate_hz)

    def _sweeps(self, station: int, plane: int, frame: int, look_s: Floats) -> Sweeps:
        """Return the sweeps of one plane that may meet a photodiode in front of the station within the period."""
        emitter, start_s = self.emitters[station], frame * self._period_s
        turn_s = self._turn_s(emitter)
        if self.second:
            share = self._share[plane] + emitter.phase
            # In front is a quarter of a turn to either side of the boresight.
            begin, end = self._window()
            first, last = ((start_s + begin) / turn_s - share - 0.25, (start_s + end) / turn_s - share + 0.25)
            numbers = range(ceil(first), floor(last) + 1)
            instants = [(number + share) * turn_s - start_s for number in numbers]
        else:
            numbers = range(frame, frame + 1)
            instants = [(station + plane / 2 + 0.25) * turn_s + station * SLOT_S]
        boresight_s, number = np.array(instants, dtype=np.float64), np.array(numbers, dtype=np.int64)
        if len(look_s) == 1:
            return Sweeps(boresight_s, number, np.zeros(len(number), dtype=np.int64))
        near = np.argmin(np.abs(boresight_s[:, None] - look_s), axis=1)
        return Sweeps(boresight_s, number, near.astype(np.int64))

    def _start_tick(self, frame: int) -> Floats:
        """Return the start of a period on each craft's clock, not a whole number, (C,) [ticks]."""
        out: Floats = self.clock_offset_tick + frame * self._period_s / self.settings.tick_s
        return out

    def _zero_s(self, passages: Passages, frame: int) -> Floats:
        """Return the instant of the rotor's zero before each passage, after the period's start [s]."""
        turn_s = np.array([self._turn_s(emitter) for emitter in self.emitters])[passages.station]
        phase = np.array([emitter.phase for emitter in self.emitters])[passages.station]
        out: Floats = (passages.sweep + phase) * turn_s - frame * self._period_s
        return out

    def _beams(self, frame: int, passages: Passages, count: int) -> BeamHits:
        """Return what the circuits log of the light of Lighthouse 2.0."""
        passages = Passages._make(part[:count] for part in passages)
        craft, tick_s = len(self._count), self.settings.tick_s
        lost = self._missed(passages)
        order, first = in_order(passages, count, craft)
        together = overlapped(passages, order, first)
        self.overlaps = np.bincount(passages.craft[together], minlength=craft)
        dark = together | lost
        known = identified(passages, dark, order, first)
        total = np.bincount(passages.craft[~dark], minlength=craft).astype(np.int32)
        most = int(total.max(initial=0))
        out = BeamHits(
            np.full((craft, most), -1, dtype=np.int16),
            np.zeros((craft, most), dtype=np.int64),
            np.zeros((craft, most), dtype=np.int32),
            np.zeros((craft, most), dtype=np.int16),
            np.full((craft, most), -1, dtype=np.int64),
            total,
            np.rint(self._start_tick(frame) + self._period_s / 2 / tick_s).astype(np.int64),
        )
        channel = np.array([emitter.channel for emitter in self.emitters], dtype=np.int16)
        zero_s = self._zero_s(passages, frame)
        _log(passages, order, first, dark, known, channel, zero_s, self._start_tick(frame), tick_s, out)
        return out

    def _missed(self, passages: Passages) -> Bools:
        """Return which passages a photodiode misses, by chance."""
        chance = self.settings.lost_pulse_probability
        out = np.zeros(len(passages.craft), dtype=np.bool_)
        if chance > 0:
            _draw_losses(self._own_keys, passages, chance, out)
        return out

    def _pulses(self, frame: int, lit: Bools, passages: Passages, count: int) -> Pulses:
        """Return what the circuits log of the sweeps and flashes of Lighthouse 1.0, and of stray light."""
        settings, stations, looks = self.settings, len(self.emitters), self.looks
        half_s = 1 / settings.rate_hz / 2
        flashes = [(h, s) for h in range(2 * stations) for s in range(stations)]
        jitter = np.array([normals(self._rotor_keys[s][0], 2 * stations * frame + h, 0, FLASH)[0] for h, s in flashes])
        rise_s = np.array([h * half_s + s * SLOT_S for h, s in flashes]) + settings.sync_jitter_s * jitter
        code = np.array([h % 2 + (0 if h // 2 == s else SKIP_BIT) for h, s in flashes])
        width = np.rint((SYNC_WIDTH_S + SYNC_WIDTH_STEP_S * code) / settings.tick_s).astype(np.int64)
        # A flash is seen at the look of its half of the period.
        columns = [looks * s + min(looks * h // (2 * stations), looks - 1) for h, s in flashes]
        stray = strays(self._own_keys, self._count, frame, settings.stray_pulse_rate_hz, self._period_s)
        room = np.bincount(passages.craft[:count], minlength=len(lit)) + lit[..., columns].sum(axis=(1, 2))
        most = int(room.max(initial=0)) + stray.pulse.shape[1]
        out = Pulses(
            np.full((len(lit), most), -1, dtype=np.int16),
            np.zeros((len(lit), most), dtype=np.int64),
            np.zeros((len(lit), most), dtype=np.int32),
            np.zeros(len(lit), dtype=np.int32),
        )
        passages = Passages._make(part[:count] for part in passages)
        _log_pulses(
            passages,
            self._missed(passages),
            np.ascontiguousarray(lit[..., columns]),
            (rise_s, width),
            self._own_keys,
            frame,
            settings.missed_sync_probability,
            stray,
            self._start_tick(frame),
            settings.tick_s,
            out,
        )
        _sort(out)
        used = int(out.total.max(initial=0))
        return Pulses(out.photodiode[:, :used], out.rise_tick[:, :used], out.width_tick[:, :used], out.total)


def no_pulses(craft: int) -> Pulses:
    """Return the pulses of craft that logged none."""
    return Pulses(
        np.empty((craft, 0), dtype=np.int16),
        np.empty((craft, 0), dtype=np.int64),
        np.empty((craft, 0), dtype=np.int32),
        np.zeros(craft, dtype=np.int32),
    )


def _ridden(emitter: Emitter, position: Floats, quaternion: Floats) -> Frame:
    """Return the frame in the world of a station that rides on a craft, from the poses of all craft."""
    rotation = matrix_from_quaternion(quaternion[emitter.craft])
    return Frame(rotation @ emitter.frame.rotation, position[emitter.craft] + rotation @ emitter.frame.position)


@kernel
def _draw_losses(keys: Keys, passages: Passages, chance: float, out: Bools) -> None:
    for i in range(len(out)):
        kind = LOST + 8 * (1 + passages.plane[i] + 8 * passages.station[i])
        out[i] = uniforms(keys[passages.craft[i]], passages.sweep[i], passages.photodiode[i], kind)[0] < chance


@kernel
def _log(
    passages: Passages,
    order: Ints,
    first: Ints,
    dark: Bools,
    known: Bools,
    channel: NDArray[np.int16],
    zero_s: Floats,
    start_tick: Floats,
    tick: float,
    out: BeamHits,
) -> None:
    """Write every craft's hits in order of time."""
    for c in range(len(first) - 1):
        m = 0
        for n in range(first[c], first[c + 1]):
            i = order[n]
            if dark[i]:
                continue
            ticks = max(1, int(np.rint(passages.width_s[i] / tick)))
            out.photodiode[c, m], out.width_tick[c, m] = passages.photodiode[i], ticks
            out.rise_tick[c, m] = int(np.rint(start_tick[c] + passages.instant_s[i] / tick - ticks / 2))
            if known[i]:
                out.channel[c, m] = channel[passages.station[i]]
                out.offset_tick[c, m] = int(np.rint((passages.instant_s[i] - zero_s[i]) / tick))
            m += 1


@kernel
def _log_pulses(
    passages: Passages,
    missed: Bools,
    flashed: Bools,
    flash: tuple[Floats, Ints],
    keys: Keys,
    frame: int,
    miss: float,
    stray: Strays,
    start_tick: Floats,
    tick: float,
    out: Pulses,
) -> None:
    """Write every craft's pulses: flashes, sweeps, strays.

    flashed: photodiodes that see each flash, (C, K, F). flash: rises [s] and widths [ticks], (F,). miss: probability of
    a missed flash.
    """
    for c in range(len(keys)):
        for f in range(flashed.shape[2]):
            if miss > 0 and uniforms(keys[c], frame, f, MISSED)[0] < miss:
                continue
            rise = int(np.rint(start_tick[c] + flash[0][f] / tick))
            for k in range(flashed.shape[1]):
                if flashed[c, k, f]:
                    _add(out, c, k, rise, flash[1][f])
        for n in range(stray.number[c]):
            rise = int(np.rint(start_tick[c] + stray.pulse[c, n, 1] / tick))
            wide = max(1, int(np.rint(stray.pulse[c, n, 2] / tick)))
            _add(out, c, int(stray.pulse[c, n, 0]), rise, wide)
    for i in range(len(missed)):
        if not missed[i]:
            c, ticks = passages.craft[i], max(1, int(np.rint(passages.width_s[i] / tick)))
            rise = int(np.rint(start_tick[c] + passages.instant_s[i] / tick - ticks / 2))
            _add(out, c, passages.photodiode[i], rise, ticks)


@kernel
def _add(out: Pulses, c: int, photodiode: int, rise: int, width: int) -> None:
    m = out.total[c]
    if m < out.photodiode.shape[1]:
        out.photodiode[c, m], out.rise_tick[c, m], out.width_tick[c, m] = photodiode, rise, width
        out.total[c] = m + 1


@kernel
def _sort(out: Pulses) -> None:
    """Sort each craft's pulses by rise; equal ones stay in their order."""
    for c in range(len(out.total)):
        for n in range(1, out.total[c]):
            photodiode, rise, width = out.photodiode[c, n], out.rise_tick[c, n], out.width_tick[c, n]
            m = n
            while m > 0 and out.rise_tick[c, m - 1] > rise:
                out.photodiode[c, m], out.rise_tick[c, m] = out.photodiode[c, m - 1], out.rise_tick[c, m - 1]
                out.width_tick[c, m] = out.width_tick[c, m - 1]
                m -= 1
            out.photodiode[c, m], out.rise_tick[c, m], out.width_tick[c, m] = photodiode, rise, width
