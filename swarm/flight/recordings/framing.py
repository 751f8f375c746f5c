"""Framing of a recording: the ticks at which one station's periods begin, its X flashes that announce a sweep.

Two stations alternate: each sweeps X and Y in one rotor turn, then the other does in the next, and a period is two
turns. libsurvive's number 1 flashes first, its number 0 follows 20 000 ticks later; with one station there is only
number 0. Where flashes are missing, the periods between are placed at equal distances, so that none is left out.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from swarm.flight.recordings.libsurvive import AngleLog, PulseLog
from swarm.flight.recordings.object_clock import TICK_S
from swarm.messages import FAN_BIT, SKIP_BIT, SYNC_WIDTH_S, SYNC_WIDTH_STEP_S
from swarm.onboard.decoder import SLOT_S, SYNC_TOLERANCE_S

RATE_HZ = 60.0
"""Turns of a Lighthouse 1.0 rotor per second [Hz]."""
TURN_TICKS = 1 / RATE_HZ / TICK_S
_TOLERANCE = SYNC_TOLERANCE_S / TICK_S
_DRIFT = 1e-4
"""Largest relative error of an object's clock: four times that of the worst one seen."""


class Framing(NamedTuple):
    """Periods of one station.

    start: X flash of each period, (N,) [ticks]. turns: rotor turns per period: 2 if two stations share, else 1.
    """

    start: Floats
    turns: int


def frame_pulses(pulses: PulseLog, lighthouse: int) -> Framing:
    """Return the periods of a station among raw pulses; none if its flashes are not among them."""
    rise, code = _flashes(pulses)
    # Slot within a pair: 0 with a partner after it, 1 with one before it, -1 without.
    gap, slot = SLOT_S / TICK_S, np.full(len(rise), -1)
    follows = np.flatnonzero((np.abs(np.diff(rise) - gap) < _TOLERANCE) & (((code[1:] ^ code[:-1]) & FAN_BIT) == 0))
    slot[follows], slot[follows + 1] = 0, 1
    turns = 2 if 2 * len(follows) > 0.5 * len(rise) else 1
    mine = slot == 1 - lighthouse if turns == 2 else np.full(len(rise), lighthouse == 0)
    announced = (code >= 0) & (code & (FAN_BIT | SKIP_BIT) == 0)
    return Framing(_fill(rise[mine & announced], turns * TURN_TICKS), turns)


def frame_angles(angles: AngleLog, lighthouse: int) -> Framing:
    """Return the periods of a station among decoded sweeps; none if it has no sweep."""
    mine = angles.lighthouse == lighthouse
    flash, fan = x_flash(angles)[mine], angles.fan[mine]
    order = np.argsort(flash, kind="stable")
    flash, fan = flash[order], fan[order]
    groups = np.split(np.arange(len(flash)), np.flatnonzero(np.diff(flash) > TURN_TICKS / 4) + 1)
    mark = np.array([np.median(flash[g][fan[g] == fan[g].min()]) for g in groups if len(g)])
    turns = 2 if len(mark) > 1 and np.median(np.diff(mark)) > 1.5 * TURN_TICKS else 1
    return Framing(_fill(mark, turns * TURN_TICKS), turns)


def x_flash(angles: AngleLog) -> Floats:
    """Return the tick of the X flash that each angle implies, (N,).

    For fan Y it is accurate to 12 us, because the Y flash is not exactly half a turn later.
    """
    since_own_flash = (angles.angle_rad + np.pi / 2) / (2 * np.pi) * TURN_TICKS
    out: Floats = angles.middle_tick - since_own_flash - 0.5 * TURN_TICKS * angles.fan
    return out


def _flashes(pulses: PulseLog) -> tuple[Floats, Ints]:
    """Return rise [ticks] and code (-1: none) of every flash.

    Overlapping pulses of a flash's length are one flash, as on board.
    """
    wide = pulses.width_tick >= SYNC_WIDTH_S / TICK_S / 2
    wide &= pulses.width_tick <= (SYNC_WIDTH_S + 7.5 * SYNC_WIDTH_STEP_S) / TICK_S
    rise: list[int] = []
    longest: list[int] = []
    for t, width in zip(pulses.rise_tick[wide].tolist(), pulses.width_tick[wide].tolist(), strict=True):
        if rise and t - rise[-1] <= longest[-1]:
            longest[-1] = max(longest[-1], width)
        else:
            rise.append(t)
            longest.append(width)
    code = np.floor((np.array(longest) * TICK_S - SYNC_WIDTH_S) / SYNC_WIDTH_STEP_S + 0.5).astype(np.int64)
    return np.array(rise, dtype=np.float64), np.maximum(code, -1)


def _fill(mark: Floats, period: float) -> Floats:
    """Return marks a whole number of periods apart, with missing ones inserted and those that do not fit left out.

    A mark fits if it lies whole periods after the last one, or if the next mark confirms it: then the rhythm changed.
    """
    start: list[float] = []
    for i, tick in enumerate(mark.tolist()):
        confirmed = i + 1 < len(mark) and abs(mark[i + 1] - tick - period) < _TOLERANCE
        if not start:
            if confirmed:
                start.append(tick)
            continue
        gap = tick - start[-1]
        periods = round(gap / period)
        if periods < 1 or not (confirmed or abs(gap - periods * period) < _TOLERANCE + _DRIFT * gap):
            continue
        begin = start[-1]
        start += [begin + gap * j / periods for j in range(1, periods)]
        start.append(tick)
    return np.array(start)
