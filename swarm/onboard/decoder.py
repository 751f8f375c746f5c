"""Sweep angles from light pulses (1): the timing circuits of C craft side by side.

    theta_x = w (t_x - t_0),   theta_y = w (t_y - t_1),   w = 2 pi times the rotor's rate                        (1)

t_0 and t_1 are the rises of the sync flashes (`swarm.onboard.flashes` decides which are accepted), t_x and t_y the
middles of a photodiode's sweep pulses, all in ticks of the craft's own clock; no other clock is used. The epoch of a
period is half a turn after its X flash. Doubtful pulses do not become angles. The decoder rejects and counts:

- two pulses of one photodiode in one sweep: all but the one where the photodiode is expected, or all of them if none
  stands out (`swarm.onboard.rivals`);
- sweep pulses outside the field, or of a sweep whose flash is not known;
- flashes of no known code or not at their expected time; pulses of photodiodes that the craft does not have.

Two stations share the light as in Lighthouse 1.0 (modes b and c): both flash every half turn, the second 20 000 ticks
of 48 MHz after the first, and they take turns sweeping, one turn each; the skip bit marks the station that does not
sweep. A period is then two turns, and the decoder follows the station of one `slot`; the other's flashes and sweeps are
not counted.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from swarm.messages import SKIP_BIT, SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, Pulses
from swarm.onboard.flashes import MAX_FLASHES, Flashes, FlashRecord, Timing, follow, tell
from swarm.onboard.rivals import Hits, choose, clear, take

SLOT_S = 20000 / 48e6
"""Delay of the second station's flash after the first's [s]."""
SYNC_TOLERANCE_S = 150e-6
"""Largest deviation of a flash's rise from its expected instant [s]: real ones keep to 12 us, the next slot is 417 us
away.
"""
FIELD_HALF_ANGLE_RAD = 1.15
"""Half the field of 120 degrees, plus 6 degrees for the fans' systematic errors [rad]."""


Expect = Callable[[Ints], Floats]
"""Returns the angles at which the photodiodes of some craft are expected."""


class SweepAngles(NamedTuple):
    """Sweep angles of C craft in one period; see `swarm.onboard.decoder`.

    theta: angles of fans X and Y since the fan's own flash, NaN if not seen, (C, K, 2) [rad]. offset_s: instant of the
    angle minus the epoch, 0 if not seen, (C, K, 2) [s]. lit: photodiodes seen by both fans, (C, K). epoch_tick: epoch
    in the craft's own ticks, -1 before it has ever locked on, (C,). missed_sync: number of this period's flashes that a
    craft expected and did not see (0 to 2), (C,). rejected: number of rejected pulses, (C,).
    """

    theta: Floats
    offset_s: Floats
    lit: Bools
    epoch_tick: Ints
    missed_sync: Ints
    rejected: Ints


class _Room(NamedTuple):
    """Room for one craft at a time: its flashes, the fans whose sweeps can be read (2,), the number of pulses of each
    photodiode and the second nearest of them (K, 2).
    """

    flashes: Flashes
    swept: Bools
    pulses: Ints
    rival: Floats


def _room(photodiodes: int) -> _Room:
    """Return room for a craft with so many photodiodes."""
    flashes = Flashes(*np.empty((2, MAX_FLASHES)), *np.empty((3, MAX_FLASHES), np.int64))
    return _Room(flashes, np.empty(2, np.bool_), np.empty((photodiodes, 2), np.int64), np.empty((photodiodes, 2)))


class _Log(NamedTuple):
    """One craft's pulses in order of rise, (P,) each: photodiode, rise and width [ticks]."""

    photodiode: NDArray[np.int16]
    rise: Ints
    width: NDArray[np.int32]


@kernel
def _gather(log: _Log, present: Bools, timing: Timing, out: Flashes) -> tuple[int, int]:
    """Gather one craft's flashes, whose codes are still to be told; return their number, and that of rejected pulses.

    Args:
        log: its pulses; those of sweeps are passed over.
        present: photodiodes of the craft, (K,).
        timing: timing of the lighthouse.
        out: receives the flashes.
    """
    shortest, longest_pulse = np.ceil(timing.shortest_pulse), timing.code_zero + 7.5 * timing.code_step
    count = rejected = size = 0
    start = longest = -np.inf
    for i in range(len(log.width)):
        lasts = log.width[i]
        if lasts < int(shortest):
            continue
        # Without a sign, -1 is beyond the last photodiode.
        k = np.uint16(log.photodiode[i])
        if not (k < len(present) and present[k] and lasts <= longest_pulse):
            rejected += 1
        elif log.rise[i] - start <= longest:
            size, longest = size + 1, max(longest, float(lasts))
        elif count < MAX_FLASHES:
            if count > 0:
                out.size[count - 1], out.longest[count - 1] = size, longest
            start, longest, size = float(log.rise[i]), float(lasts), 1
            out.rise[count] = start
            count += 1
        else:
            rejected += 1
    if count > 0:
        out.size[count - 1], out.longest[count - 1] = size, longest
    return count, rejected


@kernel
def _read_sweeps(
    log: _Log, present: Bools, swept: Bools, timing: Timing, flash: Floats, epoch: int, tick: float, hits: Hits
) -> tuple[int, bool]:
    """Take a craft's sweep pulses into `hits`; return the number of others, and whether one photodiode got several.

    Args:
        log: its pulses; those of flashes are passed over.
        present: photodiodes of the craft, (K,).
        swept: fans whose sweeps can be read, (2,).
        timing: timing of the lighthouse.
        flash: each fan's flash, (2,) [ticks].
        epoch: its epoch [ticks].
        tick: of its clock [s].
        hits: receives them, their instants in seconds from the epoch.
    """
    shortest, two_stations = np.ceil(timing.shortest_pulse), timing.period > 3 * timing.half_turn
    zeros, readable = (flash[0], flash[1]), (swept[0], swept[1])
    second = zeros[0] + 2 * timing.half_turn
    rejected, most = 0, 0
    for i in range(len(log.width)):
        lasts = log.width[i]
        if lasts >= int(shortest):
            continue
        k, middle = np.uint16(log.photodiode[i]), float(log.rise[i]) + 0.5 * lasts
        if not (k < len(present) and present[k] and lasts >= 0):
            rejected += 1
            continue
        # With two stations, the second turn of the period belongs to the other one.
        belongs = two_stations and middle > second
        for fan in range(2):
            since = middle - zeros[fan]
            if readable[fan] and timing.sweep_first <= since <= timing.sweep_last:
                belongs = True
                most = max(most, take(hits, k, fan, np.pi * since / timing.half_turn, (middle - epoch) * tick))
        rejected += not belongs
    return rejected, most > 1


@kernel
def _decode(
    photodiode: NDArray[np.int16],
    rise: Ints,
    width: NDArray[np.int32],
    total: NDArray[np.int32],
    present: Bools,
    expected: Floats,
    timing: Timing,
    tick: float,
    last: Floats,
    seen: Floats,
    room: _Room,
    out: SweepAngles,
    several: Bools,
) -> None:
    """Decode one period of every craft into `out`.

    pulses: (C, P). present: (C, K). expected: (C, K, 2). last, seen: flashes that each craft remembers, (C, 2)
    [ticks]. tick: of the craft's clock [s]. several: receives the craft with a photodiode that got several pulses in a
    sweep, (C,).
    """
    two_stations, flashes = timing.period > 3 * timing.half_turn, room.flashes
    for c in range(len(total)):
        own = slice(0, min(max(total[c], 0), photodiode.shape[1]))
        log = _Log(photodiode[c, own], rise[c, own], width[c, own])
        count, rejected = _gather(log, present[c], timing, flashes)
        tell(count, timing, flashes)
        x, y, out.missed_sync[c] = follow(flashes, count, timing, FlashRecord(last[c], seen[c]), room.swept)
        if np.isnan(last[c, 0]):
            out.epoch_tick[c] = -1
        else:
            out.epoch_tick[c] = int(np.floor(last[c, 0] + timing.half_turn + 0.5))

        for i in range(count):
            foreign = flashes.mine[i] == 0 or flashes.code[i] & SKIP_BIT != 0
            if i != x and i != y and (flashes.code[i] < 0 or not (two_stations and foreign)):
                rejected += flashes.size[i]
        hits = Hits(expected[c], room.pulses, room.rival, out.theta[c], out.offset_s[c])
        clear(hits)
        others, several[c] = _read_sweeps(log, present[c], room.swept, timing, last[c], out.epoch_tick[c], tick, hits)
        rejected += others
        if several[c]:
            rejected += choose(hits)
        for k in range(present.shape[1]):
            out.lit[c, k] = np.isfinite(out.theta[c, k, 0]) and np.isfinite(out.theta[c, k, 1])
        out.rejected[c] = rejected


class PulseDecoder:
    """The timing circuits of C craft: `decode` takes each one's pulses of one period and returns its sweep angles.

    Between calls a craft remembers only its last flashes, predicted and seen, in its own ticks. turn_s: one turn of the
    rotor [s].
    """

    def __init__(
        self,
        present: Bools,
        tick_s: float,
        *,
        rate_hz: float = 60.0,
        frame_s: float | None = None,
        slot: int = 0,
        field_half_angle_rad: float = FIELD_HALF_ANGLE_RAD,
        coast_turns: int = 6,
    ) -> None:
        """Begin without any flash.

        Args:
            present: photodiodes of each craft, (C, K).
            tick_s: nominal tick of the craft's clocks [s].
            rate_hz: turns of the rotor per second [Hz].
            frame_s: time from one epoch to the next [s]: one turn (the default) with one station, two with two.
            slot: number of the station to follow, 0 for the one that flashes first.
            field_half_angle_rad: largest angle from boresight of an accepted sweep [rad].
            coast_turns: number of turns ahead for which a flash may be predicted; per turn, the prediction errs by 2 pi
                times the clock's relative error against the rotor (63 urad at 10 ppm).

        Raises:
            ValueError: a setting is out of its range.
        """
        self.turn_s = turn_s = 1 / rate_hz
        turns = 1 if frame_s is None else round(frame_s * rate_hz)
        if present.ndim != 2:
            raise ValueError(f"present must be (C, K), not {present.shape}")
        if not (tick_s > 0 and rate_hz > 0):
            raise ValueError(f"tick_s and rate_hz must be positive, not {tick_s} and {rate_hz}")
        if turns not in (1, 2) or (frame_s is not None and abs(frame_s * rate_hz - turns) > 1e-3):
            raise ValueError(f"frame_s must be one or two turns of {turn_s:.6f} s, not {frame_s}")
        if slot not in range(turns):
            raise ValueError(f"slot must be below {turns}, the number of stations, not {slot}")
        if not 0 < field_half_angle_rad < np.pi / 2:
            raise ValueError(f"field_half_angle_rad must lie between 0 and pi/2, not {field_half_angle_rad}")
        turn = turn_s / tick_s
        self._present = np.ascontiguousarray(present, dtype=np.bool_)
        self._tick_s = tick_s
        self._timing = Timing(
            half_turn=turn / 2,
            period=turns * turn,
            coast=(coast_turns + 0.5) * turn,  # Half a turn beyond the last one allowed, against jitter.
            slot_gap=SLOT_S / tick_s,
            tolerance=SYNC_TOLERANCE_S / tick_s,
            sweep_first=(0.25 - field_half_angle_rad / (2 * np.pi)) * turn,
            sweep_last=(0.25 + field_half_angle_rad / (2 * np.pi)) * turn,
            shortest_pulse=SYNC_WIDTH_S / tick_s / 2,
            code_zero=SYNC_WIDTH_S / tick_s,
            code_step=SYNC_WIDTH_STEP_S / tick_s,
            slot=float(slot),
        )
        self._last = np.full((len(present), 2), np.nan)
        self._seen = np.full((len(present), 2), np.nan)
        self._nowhere, self._room = np.full((*present.shape, 2), np.nan), _room(present.shape[1])

    def forget(self, mask: Bools) -> None:
        """Forget every flash of the craft of the mask (C,), as after a restart of their computers."""
        self._last[mask] = self._seen[mask] = np.nan

    def decode(self, pulses: Pulses, expected: Expect | None = None) -> SweepAngles:
        """Advance every craft by one period and read its sweeps; call it once in every period.

        Args:
            pulses: pulses of C craft in order of rise, from shortly before the period's X flash to shortly before the
                next one's; a craft without any still advances its epoch.
            expected: called with the indices (N,) of craft with a photodiode that got several pulses in a sweep, if
                there are any; returns the angles of fans X and Y at which each photodiode is expected, NaN where it is
                not, (N, K, 2) [rad].

        Raises:
            ValueError: the pulses or the expected angles are of another number of craft or photodiodes.
        """
        craft = len(self._present)
        if pulses.total.shape != (craft,) or pulses.rise_tick.shape[0] != craft:
            raise ValueError(f"pulses of {len(pulses.rise_tick)} craft, but the decoder has {craft}")
        before = self._last.copy(), self._seen.copy()
        out, several = self._decoded(pulses, self._present, self._nowhere, self._last, self._seen)
        if expected is not None and several.any():
            # Once more, with the flashes of before: what they become does not depend on what is expected.
            who = np.flatnonzero(several)
            some = Pulses._make(part[who] for part in pulses)
            again, _ = self._decoded(some, self._present[who], expected(who), before[0][who], before[1][who])
            for whole, own in zip(out, again, strict=True):
                whole[who] = own
        return out

    def _decoded(
        self, pulses: Pulses, present: Bools, expected: Floats, last: Floats, seen: Floats
    ) -> tuple[SweepAngles, Bools]:
        """Return the angles of craft, and which of them have a photodiode with several pulses in a sweep.

        Args:
            pulses: of C craft.
            present: their photodiodes, (C, K).
            expected: angles at which the photodiodes are expected, (C, K, 2) [rad].
            last: flashes that each craft remembers, predicted, (C, 2) [ticks], updated.
            seen: likewise, seen.
        """
        craft, photodiodes = present.shape
        if expected.shape != (craft, photodiodes, 2):
            raise ValueError(f"expected must be {(craft, photodiodes, 2)}, not {expected.shape}")
        angles, lit = np.empty((2, craft, photodiodes, 2)), np.empty((craft, photodiodes), dtype=np.bool_)
        out = SweepAngles(angles[0], angles[1], lit, *np.empty((3, craft), dtype=np.int64))
        several = np.empty(craft, dtype=np.bool_)
        _decode(
            np.ascontiguousarray(pulses.photodiode, dtype=np.int16),
            np.ascontiguousarray(pulses.rise_tick, dtype=np.int64),
            np.ascontiguousarray(pulses.width_tick, dtype=np.int32),
            np.ascontiguousarray(pulses.total, dtype=np.int32),
            present,
            np.ascontiguousarray(expected, dtype=np.float64),
            self._timing,
            self._tick_s,
            last,
            seen,
            self._room,
            out,
            several,
        )
        return out, several
