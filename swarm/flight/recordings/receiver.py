"""Receiver of a recording's light: from a window to the sweep angles that one object's navigation is given.

It does what depends on the recording as a whole, or on the track: photodiodes that are false throughout are left out,
and of two pulses of one photodiode in one sweep the decoder gets the angle at which the track expects it.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.sweep import FanPair, measured_theta
from estimators.state import State
from swarm.flight.recordings.framing import RATE_HZ
from swarm.flight.recordings.windows import Window, Windows
from swarm.onboard.decoder import PulseDecoder, SweepAngles

LARGEST_BLIND_S = 0.25
"""Age of an estimate [s] from which it predicts no angle."""


class Received(NamedTuple):
    """Angles of one period, and the number of photodiodes in them that were left out as false."""

    angles: SweepAngles
    left_out: int


class Receiver:
    """The timing circuit of one object in a recording."""

    def __init__(self, windows: Windows, point_m: Floats, fans: FanPair, false: Ints) -> None:
        """Begin before the first period.

        Args:
            windows: the recording.
            point_m: positions of the photodiodes as assumed, (1, K, 3) [m].
            fans: known errors of the fans.
            false: photodiodes to leave out.
        """
        present = windows.photodiodes.present
        self._decoder = PulseDecoder(present, windows.tick_s, frame_s=windows.frame_s, slot=windows.slot)
        self._point_m, self._fans, self._frame_s = point_m, fans, windows.frame_s
        self._false: Bools = np.zeros(present.shape, dtype=np.bool_)
        self._false[0, false] = True
        self._known: State | None = None
        self._age_s = 0.0

    def receive(self, window: Window) -> Received:
        """Return the angles of the next period."""
        if window.pulses is not None:
            angles = self._decoder.decode(window.pulses, self._expected())
        else:
            assert window.angles is not None
            angles = window.angles
        seen = angles.lit & self._false
        theta = np.where(self._false[..., None], np.nan, angles.theta)
        return Received(angles._replace(theta=theta, lit=angles.lit & ~self._false), int(np.count_nonzero(seen)))

    def learn(self, state: State, fresh: bool) -> None:
        """Take the estimate after the period; fresh: it is tracking."""
        if fresh:
            self._known, self._age_s = state, 0.0
        self._age_s += self._frame_s

    def _expected(self) -> Floats | None:
        """Return the angles (1, K, 2) at which the photodiodes are expected next, None without a track."""
        if self._known is None or self._age_s > LARGEST_BLIND_S:
            return None
        expected = np.empty((1, self._point_m.shape[1], 2))
        for fan, instant_s in enumerate((-0.25 / RATE_HZ, 0.25 / RATE_HZ)):
            after_s = self._age_s + instant_s
            turned = rot.exp(self._known.angular_rate * after_s) @ self._known.rotation
            at = self._known.position + self._known.velocity * after_s
            points = self._point_m @ np.swapaxes(turned, -1, -2) + at[:, None]
            expected[..., fan] = measured_theta(points, self._fans)[..., fan]
        return expected
