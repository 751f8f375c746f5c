"""Decoding of Lighthouse 2.0 light in recordings: raw hits and observed zeros of the rotors become `Hits`.

libsurvive writes both, each with its channel (`RotorLog`). The Crazyflie writes pulses (`FrameLog`), of which some have
the channel and the ticks since the rotor's zero. Its receiver learns them by comparing two photodiodes, so that the
first pulse of each sweep has no channel: pulses that come within 0.4 ms of each other are one sweep, a *block*, and
pulses without a channel are of the block's one station. Where two stations' sweeps meet in a block, none can tell.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS, Rotor, locate, planes, track
from swarm.flight.recordings.hits import Hits, Light, Lost, joined
from swarm.flight.recordings.object_clock import TICK_S

FRAME_HZ = 24e6
"""Clock of the Crazyflie's receiver [Hz]."""
BLOCK_TICKS = 10_000
"""Longest time between two pulses of one block [ticks of 24 MHz]."""


class RotorLog(NamedTuple):
    """libsurvive's Lighthouse 2.0 lines of one object; ticks are of 48 MHz, unwrapped.

    zero_channel, zero_tick: observed zeros of rotors (Y), (M,). hit_time_s, hit_channel, hit_photodiode, hit_tick: raw
    hits (W), (N,). own_time_s, own_channel, own_photodiode, own_tick, own_plane, own_angle: its own angles (B), (B,).
    Times are the host's [s].
    """

    zero_channel: Ints
    zero_tick: Floats
    hit_time_s: Floats
    hit_channel: Ints
    hit_photodiode: Ints
    hit_tick: Floats
    own_time_s: Floats
    own_channel: Ints
    own_photodiode: Ints
    own_tick: Floats
    own_plane: Ints
    own_angle: Floats

    def any(self) -> bool:
        """Return whether the object saw light of Lighthouse 2.0: whether there is a line of any of the three kinds."""
        return len(self.zero_tick) + len(self.hit_tick) + len(self.own_tick) > 0


class FrameLog(NamedTuple):
    """Pulses that a Crazyflie's receiver logged, (N,) each.

    time_s: time of logging [s]. photodiode: index. channel: of the station, -1 if the receiver did not find it. offset:
    ticks since the rotor's zero [ticks of 24 MHz], 0 if it did not find them. tick: instant [ticks of 24 MHz],
    unwrapped.
    """

    time_s: Floats
    photodiode: Ints
    channel: Ints
    offset: Ints
    tick: Floats


def decode_rotor_log(log: RotorLog, *, previous: bool = False) -> Light:
    """Return the hits of libsurvive's raw lines.

    Args:
        log: the lines.
        previous: divide by the duration of the turn before, as libsurvive does for its own angles.
    """
    rotors = _rotors(log.zero_channel, log.zero_tick, 1.0)
    return _decode(rotors, log.hit_channel, log.hit_photodiode, log.hit_tick, TICK_S, Lost(), previous=previous)


def decode_frames(log: FrameLog) -> Light:
    """Return the hits of a Crazyflie's pulses."""
    observed = (log.offset > 0) & (log.channel >= 0)
    scale = FRAME_HZ / CHANNEL_CLOCK_HZ
    rotors = _rotors(log.channel[observed], log.tick[observed] - log.offset[observed], scale)
    channel, shared = _of_blocks(log)
    used = channel >= 0
    lost = Lost(channel=int(np.count_nonzero(~used & ~shared)), shared=int(np.count_nonzero(shared)))
    return _decode(rotors, channel[used], log.photodiode[used], log.tick[used], 1 / FRAME_HZ, lost)


def _rotors(channel: Ints, zero: Floats, scale: float) -> dict[int, Rotor]:
    """Return the rotor of each channel; `scale` is the ratio of the clock's rate to the channels' 48 MHz."""
    return {int(c): track(zero[channel == c], CHANNEL_TICKS[c] * scale) for c in np.unique(channel)}


def _decode(
    rotors: dict[int, Rotor],
    channel: Ints,
    photodiode: Ints,
    tick: Floats,
    tick_s: float,
    lost: Lost,
    *,
    previous: bool = False,
) -> Light:
    """Return the hits of known channels (N,) as sweeps.

    Args:
        rotors: per channel.
        channel: of each hit, (N,).
        photodiode: (N,).
        tick: instants, (N,).
        tick_s: tick of the clock [s].
        lost: hits that are lost already.
        previous: as in `decode_rotor_log`.
    """
    parts: list[Hits] = []
    unplaced = doubtful = doubled = 0
    for number in map(int, np.unique(channel)):
        mine = np.flatnonzero(channel == number)
        located = locate(rotors.get(number, track(np.zeros(0), 1.0)), tick[mine], previous=previous)
        found = planes(located, photodiode[mine])
        timed, good = np.isfinite(located.share), found.plane >= 0
        unplaced += int(np.count_nonzero(~timed))
        doubtful += int(np.count_nonzero(timed & ~good))
        mine, plane = mine[good], found.plane[good]
        doubled += _doubled(located.turn[good], plane, photodiode[mine])
        parts.append(Hits(channel[mine], plane, photodiode[mine], tick[mine], found.angle[good]))
    zeros = sum(rotor.rejected for rotor in rotors.values())
    lost = lost._replace(zero=unplaced, plane=doubtful, doubled=doubled, zeros=zeros)
    return Light("2.0", tick_s, joined(parts), lost, {c: rotor.period * tick_s for c, rotor in rotors.items()})


def _of_blocks(log: FrameLog) -> tuple[Ints, Bools]:
    """Return the channel of each pulse by its block, -1 if not known, and which are lost because two stations met."""
    order = np.argsort(log.tick, kind="stable")
    block = np.zeros(len(order), dtype=np.int64)
    block[order] = np.concatenate([[0], np.cumsum(np.diff(log.tick[order]) > BLOCK_TICKS)])[: len(order)]
    blocks = int(block.max()) + 1 if len(block) else 0
    low, high = np.full(blocks, len(CHANNEL_TICKS)), np.full(blocks, -1)
    known = log.channel >= 0
    np.minimum.at(low, block[known], log.channel[known])
    np.maximum.at(high, block[known], log.channel[known])
    only = np.where(low == high, high, -1)
    shared = (high > low)[block] & ~known
    return np.where(known, log.channel, only[block]), shared


def _doubled(turn: Ints, fan: Ints, photodiode: Ints) -> int:
    """Return the number of one station's hits beyond the first of their turn, fan and photodiode.

    Args:
        turn: number of the turn of each hit, (N,).
        fan: (N,).
        photodiode: (N,).
    """
    rows = np.stack([turn, fan, photodiode], axis=1)
    return len(rows) - len(np.unique(rows, axis=0)) if len(rows) else 0
