"""A formation through its figures: at given times every craft gets a place in the next one and flies there in step.

From its place a(t) in the figure left to its place b(t) in the next one, with tau the share of the transfer's time D:

    p(t) = a(t) + s(tau) (b(t) - a(t)),   s(tau) = 10 tau^3 - 15 tau^4 + 6 tau^5                                    (F1)

from rest to rest with the least jerk; its peak speed is 15/8 of the mean, so D = 15/8 max |b - a| / v for all craft
alike. Places are shared out by `assignment`, from what all have heard of all: every craft finds the same.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.state import Motion
from swarm.onboard.guidance.assignment import assign
from swarm.onboard.guidance.broadcast import Heard
from swarm.onboard.guidance.phase import Phase
from swarm.onboard.guidance.shapes import Shape

PEAK_TO_MEAN = 15 / 8


class Figure(NamedTuple):
    """A shape, and from when on it is wanted [s]."""

    at_s: float
    shape: Shape


class Formation:
    """N craft that share a schedule of figures."""

    def __init__(self, craft: Ints, figures: Sequence[Figure], speed_m_s: float) -> None:
        """craft: (N,), which ones. figures: by time, the first from 0 on. speed_m_s: of a transfer, at most."""
        self.craft = craft
        self._figures, self._speed_m_s = list(figures), speed_m_s
        self._current = 0
        place = np.arange(len(craft))
        self._from, self._to = (figures[0].shape, place), (figures[0].shape, place)
        self._begun_s, self._length_s = 0.0, 0.0

    def at(self, time_s: float, heard: Heard) -> Motion:
        """Where the craft of the formation should be now, (N, 3) each. heard: decides places when a figure ends."""
        after = self._current + 1
        if after < len(self._figures) and time_s >= self._figures[after].at_s:
            self._begin(time_s, heard)
        a, b = (_taken(shape, place, time_s) for shape, place in (self._from, self._to))
        if not self.transferring(time_s):
            return b
        tau, length = (time_s - self._begun_s) / self._length_s, self._length_s
        s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
        ds = (30 * tau**2 - 60 * tau**3 + 30 * tau**4) / length
        dds = (60 * tau - 180 * tau**2 + 120 * tau**3) / length**2
        way, drift, pull = (y - x for x, y in zip(a, b, strict=True))
        return Motion(
            a.position + s * way,
            a.velocity + s * drift + ds * way,
            a.acceleration + s * pull + 2 * ds * drift + dds * way,
        )

    def transferring(self, time_s: float) -> bool:
        """Whether the craft are between two figures."""
        return time_s < self._begun_s + self._length_s

    def phase(self, time_s: float) -> Phase:
        """What all of them are doing."""
        return Phase.TRANSFER if self.transferring(time_s) else Phase.KEEP

    def _begin(self, time_s: float, heard: Heard) -> None:
        """Leave for the next figure."""
        self._current += 1
        shape = self._figures[self._current].shape
        now = self.at_figure(time_s)
        there = shape.at(time_s, len(self.craft)).position
        # Who is not heard keeps its place in the figure, as far as the others can know.
        believed = np.where(heard.known[self.craft, None], heard.position[self.craft], now)
        place = assign(believed, there)
        self._from, self._to = self._to, (shape, place)
        self._begun_s = time_s
        self._length_s = PEAK_TO_MEAN * float(np.linalg.norm(there[place] - now, axis=1).max()) / self._speed_m_s

    def at_figure(self, time_s: float) -> Floats:
        """The places (N, 3) [m] in the figure last wanted."""
        shape, place = self._to
        return _taken(shape, place, time_s).position


def _taken(shape: Shape, place: Ints, time_s: float) -> Motion:
    """The places of a shape, in the order of the craft that have taken them."""
    return Motion(*(part[place] for part in shape.at(time_s, len(place))))
