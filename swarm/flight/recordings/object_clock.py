"""The clock of a tracked object: its 32-bit counter of 48 MHz, which wraps every 89.5 s, made one line of ticks.

The host's time decides the number of wraps. Both clocks run on by the same amount from one event to the next, except
that the host logs events up to some tenths of a second late; an event that contradicts this is damaged. Where several
agree with each other but not with what came before, the object was dark for long, or its counter started again, as
after a reconnection: then the ticks go on as the host's time does.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.errors import SwarmError

TICK_S = 1 / 48e6
"""Nominal tick of the objects' clocks [s]."""
WRAP = 1 << 32
LATENESS_S = 1.0
"""Largest difference between what the two clocks tell of two events [s]: three times that of the worst host seen."""
STEP_S = 5.0
"""Time between neighbouring events [s] beyond which the host's time has to be confirmed by others."""
AGREE = 8
"""Events that must agree before they begin a stretch."""
DOUBTFUL = 64
"""Events in doubt that are kept."""
LONGEST_DARK_S = 3600.0
"""Longest time without light inside a recording [s]: each period of it is a row of telemetry."""
_DRIFT = 2e-4
_FOLLOW = 0.02

Commit = Callable[[int], None]


class _Event(NamedTuple):
    time_s: float
    counter: int
    commit: Commit


class ObjectClock:
    """One object's clock.

    damaged: number of events that contradicted it. restarts: of the counter. last, newest: tick of the last event that
    was taken, and the latest tick; None before the first.
    """

    def __init__(self, what: str) -> None:
        """Begin without a tick; `what` names recording and object in messages."""
        self._what = what
        self._doubtful: list[_Event] = []
        self._base: int | None = None
        self._offset_s = self._time_s = 0.0
        self.damaged = self.restarts = 0
        self.last: int | None = None
        self.newest: int | None = None

    def add(self, time_s: float, counter: int, commit: Commit) -> None:
        """Take the next event of the file.

        Args:
            time_s: host's time [s].
            counter: object's counter, 0 to 2^32 - 1.
            commit: function that gets the event's tick, now or later; never if the event is damaged.

        Raises:
            SwarmError: the object was dark for longer than `LONGEST_DARK_S`, or another recording begins.
        """
        event = _Event(time_s, counter, commit)
        if self._base is not None and abs(time_s - self._time_s) < STEP_S and self._fits(event):
            self.damaged += len(self._doubtful)
            self._doubtful.clear()
            self._accept(event)
            return
        same = [other for other in self._doubtful if _agree(event, other)]
        self._doubtful.append(event)
        if len(same) + 1 >= AGREE:
            self.damaged += len(self._doubtful) - len(same) - 1
            self._doubtful.clear()
            self._begin([*same, event])
        elif len(self._doubtful) > DOUBTFUL:
            self._doubtful.pop(0)
            self.damaged += 1

    def tick(self, time_s: float, counter: int) -> int | None:
        """Return the tick of an event that tells nothing of the clock itself, None where that contradicts it.

        Args:
            time_s: host's time [s].
            counter: object's counter, 0 to 2^32 - 1.
        """
        event = _Event(time_s, counter, lambda _: None)
        return self._tick(event) if self._base is not None and self._fits(event) else None

    def time_s(self, tick: Floats) -> Floats:
        """Return the host's times [s] of ticks near the latest one, any shape."""
        return np.asarray(tick, dtype=np.float64) * TICK_S + self._offset_s

    def close(self) -> None:
        """Decide about the events still in doubt: of a recording of a few events, all that agree are taken."""
        if self._base is None and self._doubtful:
            best = max(([e for e in self._doubtful if _agree(e, one)] for one in self._doubtful), key=len)
            self.damaged += len(self._doubtful) - len(best)
            self._begin(best)
        else:
            self.damaged += len(self._doubtful)
        self._doubtful.clear()

    def _begin(self, events: list[_Event]) -> None:
        """Begin a stretch with events that agree."""
        first = events[0]
        if self._base is None:
            self._base = 0
            self._offset_s = first.time_s - first.counter * TICK_S
        elif abs(first.time_s - self._time_s) > LONGEST_DARK_S:
            raise SwarmError(
                f"{self._what}: no light from {self._time_s:.1f} s to {first.time_s:.1f} s, longer than "
                f"{LONGEST_DARK_S:.0f} s: cut the recording there"
            )
        elif not self._fits(first) and first.time_s < self._time_s - STEP_S:
            raise SwarmError(
                f"{self._what}: the host's time goes back from {self._time_s:.1f} s to {first.time_s:.1f} s: these are "
                "two recordings in one file, replay them one by one"
            )
        elif not self._fits(first):
            self.restarts += 1
            self._base = round((first.time_s - self._offset_s) / TICK_S) - first.counter
        self._time_s = first.time_s
        for event in events:
            self._accept(event)

    def _fits(self, event: _Event) -> bool:
        away_s = self._tick(event) * TICK_S + self._offset_s - event.time_s
        return abs(away_s) < LATENESS_S + _DRIFT * abs(event.time_s - self._time_s)

    def _tick(self, event: _Event) -> int:
        """Return the tick, of all that the counter may stand for, that is nearest to the host's time."""
        tick = event.counter + (self._base or 0)
        return tick + WRAP * round(((event.time_s - self._offset_s) / TICK_S - tick) / WRAP)

    def _accept(self, event: _Event) -> None:
        tick = self._tick(event)
        self._offset_s += _FOLLOW * (event.time_s - tick * TICK_S - self._offset_s)
        self._time_s = event.time_s
        self.last, self.newest = tick, tick if self.newest is None else max(self.newest, tick)
        event.commit(tick)


def _agree(one: _Event, other: _Event) -> bool:
    host_s = one.time_s - other.time_s
    ticks = (one.counter - other.counter + WRAP // 2) % WRAP - WRAP // 2
    return abs(host_s) < STEP_S and abs(ticks * TICK_S - host_s) < LATENESS_S
