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
from swarm.onboard.flashes import MAX_FLASHES, Flashes, FlashRecord, Timing, follow, group
from swarm.onboard.rivals import Hits, choose, take

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
    photodiode and the second nearest of them (K, 2), and what it takes of its pulses (3, P).
    """

    flashes: Flashes
    swept: Bools
    pulses: Ints
    rival: Floats
    own: Ints


def _room(photodiodes: int, pulses: int) -> _Room:
    """Return room for a craft with so many photodiodes and pulses."""
    flashes = Flashes(np.empty(MAX_FLASHES), *np.empty((3, MAX_FLASHES), np.int64))
    counts, rival = np.empty((photodiodes, 2), np.int64), np.empty((photodiodes, 2))
    return _Room(flashes, np.empty(2, np.bool_), counts, rival, np.empty((3, pulses), np.int64))


@kernel
def _read_sweeps(pulses: Ints, timing: Timing, flash: Floats, swept: Bools, epoch: int, hits: Hits) -> int:
    """Take one craft's sweep pulses into `hits`, their instants in ticks from the epoch; return the number of others.

    pulses: photodiode, rise and width, (3, P). flash, swept: each fan's flash and whether its sweep can be read, (2,).
    """
    two_stations = timing.period > 3 * timing.half_turn
    rejected = 0
    for i in range(pulses.shape[1]):
        k, rise, width = pulses[0, i], pulses[1, i], pulses[2, i]
        if width >= timing.shortest_pulse:
            continue
        middle = float(rise) + 0.5 * width
        # With two stations, the second turn of the period belongs to the other one.
        belongs = two_stations and middle > flash[0] + 2 * timing.half_turn
        for fan in range(2):
            since = middle - flash[fan]
            if swept[fan] and timing.sweep_first <= since <= timing.sweep_last:
                belongs = True
                take(hits, k, fan, np.pi * since / timing.half_turn, middle - epoch)
        if not belongs:
            rejected += 1
    return rejected


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
    two_stations = timing.period > 3 * timing.half_turn
    longest_pulse = timing.code_zero + 7.5 * timing.code_step
    flashes, swept, pulses_of, rival, own = room
    for c in range(len(total)):
        p = 0
        for i in range(min(max(total[c], 0), photodiode.shape[1])):
            k = photodiode[c, i]
            if 0 <= k < present.shape[1] and present[c, k] and 0 <= width[c, i] <= longest_pulse:
                own[0, p], own[1, p], own[2, p] = k, rise[c, i], width[c, i]
                p += 1
            else:
                out.rejected[c] += 1

        count, rejected = group(own[1, :p], own[2, :p], timing, flashes)
        out.rejected[c] += rejected
        x, y, out.missed_sync[c] = follow(flashes, count, timing, FlashRecord(last[c], seen[c]), swept)
        if np.isnan(last[c, 0]):
            out.epoch_tick[c] = -1
        else:
            out.epoch_tick[c] = int(np.floor(last[c, 0] + timing.half_turn + 0.5))

        for i in range(count):
            foreign = flashes.mine[i] == 0 or flashes.code[i] & SKIP_BIT != 0
            if i != x and i != y and (flashes.code[i] < 0 or not (two_stations and foreign)):
                out.rejected[c] += flashes.size[i]
        pulses_of[:] = 0
        rival[:] = np.inf
        hits = Hits(expected[c], pulses_of, rival, out.theta[c], out.offset_s[c])
        out.rejected[c] += _read_sweeps(own[:, :p], timing, last[c], swept, out.epoch_tick[c], hits)
        out.rejected[c] += choose(hits)
        most = 0
        for k in range(present.shape[1]):
            out.lit[c, k] = np.isfinite(out.theta[c, k, 0]) and np.isfinite(out.theta[c, k, 1])
            for fan in range(2):
                out.offset_s[c, k, fan] *= tick
                most = max(most, pulses_of[k, fan])
        several[c] = most > 1


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
        craft, photodiodes = self._present.shape
        if pulses.total.shape != (craft,) or pulses.rise_tick.shape[0] != craft:
            raise ValueError(f"pulses of {len(pulses.rise_tick)} craft, but the decoder has {craft}")
        before = self._last.copy(), self._seen.copy()
        nowhere = np.full((craft, photodiodes, 2), np.nan)
        out, several = self._decoded(pulses, self._present, nowhere, self._last, self._seen)
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
        theta, offset = np.full((craft, photodiodes, 2), np.nan), np.zeros((craft, photodiodes, 2))
        epoch, missed, rejected = (np.zeros(craft, dtype=np.int64) for _ in range(3))
        out = SweepAngles(theta, offset, np.zeros((craft, photodiodes), dtype=np.bool_), epoch, missed, rejected)
        several = np.zeros(craft, dtype=np.bool_)
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
            _room(photodiodes, pulses.photodiode.shape[1]),
            out,
            several,
        )
        return out, several
