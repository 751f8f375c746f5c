"""Lighthouse 2.0 lines of a libsurvive recording, of one object.

    Y channel timecode slow_bit flag           a rotor's zero as the object found it; the flag may be missing
    W channel sensor timecode half             a raw hit; half says that it came half a tick later, and may be missing
    B channel sensor timecode plane angle      libsurvive's own angle [rad] from boresight, by plane

Ticks are of the object's 48 MHz clock, which wraps at 32 bits. Sensors are indices of photodiodes. Newer libsurvive
adds the half tick; at rest the hits scatter alike with it and without (14.8 and 14.6 urad), and it is not added here.
"""

import math
from array import array

import numpy as np

from estimators.lighthouse.rotor import CHANNEL_TICKS
from swarm.flight.recordings.line_values import as_rows, finite, in_order, keep_from, once, within
from swarm.flight.recordings.object_clock import WRAP, ObjectClock
from swarm.flight.recordings.rotor_light import RotorLog

TOKENS = {"Y": (6, 7), "W": (6, 7), "B": (8,)}
"""Numbers of words that a line of each operation may have."""


class RotorLines:
    """Collector of one object's lines."""

    def __init__(self, clock: ObjectClock) -> None:
        """Begin without a line; `clock` is the object's."""
        self._clock = clock
        self._zeros, self._hits, self._angles = array("d"), array("d"), array("d")

    def add(self, time_s: float, op: str, token: list[str]) -> None:
        """Take a line; raise ValueError if it is damaged.

        Args:
            time_s: host's time [s].
            op: "Y", "W" or "B".
            token: all words of the line.
        """
        channel = within(int(token[3]), 0, len(CHANNEL_TICKS))
        if op == "Y":
            tick = within(int(token[4]), 0, WRAP)
            self._clock.add(time_s, tick, lambda at: self._zeros.extend((channel, at)))
            return
        photodiode, tick = within(int(token[4]), 0, 1 << 15), within(int(token[5]), 0, WRAP)
        if op == "W":
            self._clock.add(time_s, tick, lambda at: self._hits.extend((time_s, channel, photodiode, at)))
            return
        plane, angle = within(int(token[6]), 0, 2), finite(token[7])
        if abs(angle) > math.pi:
            raise ValueError
        self._clock.add(time_s, tick, lambda at: self._angles.extend((time_s, channel, photodiode, at, plane, angle)))

    def forget(self, zeros: float, hits: float) -> None:
        """Forget zeros, and all other light, before two ticks."""
        keep_from(self._zeros, 2, 1, zeros)
        keep_from(self._hits, 4, 3, hits)
        keep_from(self._angles, 6, 3, hits)

    def log(self, photodiodes: int) -> tuple[RotorLog, int, int]:
        """Return the lines, the number of those with a photodiode that does not exist, and of repeated ones."""
        zeros, zeros_twice = once(as_rows(self._zeros, 2), (0, 1))
        hits, hits_twice = once(as_rows(self._hits, 4), (1, 2, 3))
        angles, angles_twice = once(as_rows(self._angles, 6), range(1, 6))
        real, own = hits[:, 2] < photodiodes, angles[:, 2] < photodiodes
        unknown = int(np.count_nonzero(~real) + np.count_nonzero(~own))
        hits, angles = in_order(hits[real], 3), in_order(angles[own], 3)
        zeros = in_order(zeros, 1)
        log = RotorLog(
            zeros[:, 0].astype(np.int64),
            zeros[:, 1],
            hits[:, 0],
            hits[:, 1].astype(np.int64),
            hits[:, 2].astype(np.int64),
            hits[:, 3],
            angles[:, 0],
            angles[:, 1].astype(np.int64),
            angles[:, 2].astype(np.int64),
            angles[:, 3],
            angles[:, 4].astype(np.int64),
            angles[:, 5],
        )
        return log, unknown, zeros_twice + hits_twice + angles_twice
