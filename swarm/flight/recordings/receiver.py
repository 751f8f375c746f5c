"""Receiver of a recording's light: from a window to the sweep angles that one object's navigation is given.

It does what depends on the recording as a whole, or on the track: photodiodes that are false throughout are left out,
and of two pulses of one photodiode in one sweep, raw or decoded, the one that the track expects is taken.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.flight.recordings.windows import Sweeps, Window, Windows
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.onboard.rivals import choose, no_hits, take


class Received(NamedTuple):
    """Angles of one period, and the number of photodiodes in them that were left out as false."""

    angles: SweepAngles
    left_out: int


class Receiver:
    """The timing circuit of one object in a recording. turn_s: one turn of the rotor [s]."""

    def __init__(self, windows: Windows, false: Ints) -> None:
        """Begin before the first period.

        Args:
            windows: the recording.
            false: photodiodes to leave out.
        """
        present = windows.photodiodes.present
        self._decoder = PulseDecoder(present, windows.tick_s, frame_s=windows.frame_s, slot=windows.slot)
        self.turn_s = self._decoder.turn_s
        self._false: Bools = np.zeros(present.shape, dtype=np.bool_)
        self._false[0, false] = True

    def receive(self, window: Window, expected: Floats) -> Received:
        """Return the angles of the next period.

        Args:
            window: the period.
            expected: angles at which its sweeps should meet the photodiodes, NaN where not known, (1, K, 2) [rad].
        """
        if window.pulses is not None:
            angles = self._decoder.decode(window.pulses, lambda who: expected[who])
        else:
            assert window.sweeps is not None
            angles = _choose(window.sweeps, expected[0])
        seen = angles.lit & self._false
        theta = np.where(self._false[..., None], np.nan, angles.theta)
        return Received(angles._replace(theta=theta, lit=angles.lit & ~self._false), int(np.count_nonzero(seen)))


def _choose(sweeps: Sweeps, expected: Floats) -> SweepAngles:
    """Return the angles of one period, of several of one photodiode and fan the one that the track expects (K, 2)."""
    hits = no_hits(expected)
    for k, fan, angle, offset in zip(*(column.tolist() for column in sweeps[1:]), strict=True):
        take(hits, k, fan, angle, offset)
    dropped, none = choose(hits), np.zeros(1, dtype=np.int64)
    theta = hits.theta[None]
    lit: Bools = np.isfinite(theta[..., 0]) & np.isfinite(theta[..., 1])
    return SweepAngles(theta, hits.instant[None], lit, none + sweeps.epoch_tick, none, none + dropped)
