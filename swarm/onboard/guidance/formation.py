"""A formation that passes through figures: at given times every craft gets a place in the next one and flies there.

All craft fly in step, each from its place a(t) in the present figure to its place b(t) in the next one. With tau the
elapsed share of the transfer's time D,

    p(t) = a(t) + s(tau) (b(t) - a(t)),   s(tau) = 10 tau^3 - 15 tau^4 + 6 tau^5                                    (F1)

from rest to rest with the least jerk. The peak speed is 15/8 of the mean, so D = 15/8 max |b - a| / v for all craft.
Places are assigned by `assignment`, from the broadcasts that all craft have heard: every craft gets the same result.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.relative_orbit import RelativeOrbit
from estimators.state import Motion
from swarm.onboard.guidance.assignment import assign
from swarm.onboard.guidance.broadcast import Heard
from swarm.onboard.guidance.neighbours import Neighbours
from swarm.onboard.guidance.phase import Phase
from swarm.scenario import Formation as Table
from swarm.scenario.motions.shapes import Shape, shape_of

PEAK_TO_MEAN = 15 / 8


class Formation:
    """N craft that share a schedule of figures."""

    def __init__(
        self,
        craft: Ints,
        table: Table,
        orbit: RelativeOrbit | None = None,
        about: tuple[int, Floats] | None = None,
    ) -> None:
        """Begin in the first figure.

        Args:
            craft: indices of the craft, (N,).
            table: the scenario's table.
            orbit: the lighthouse's orbit; None in weightless space.
            about: index of the craft with which the figures move, and the place (3,) [m] from which on they do; None
                where they stay.

        Raises:
            SwarmError: a figure needs an orbit, and there is none.
        """
        self.craft, self._about = craft, about
        self._table = table
        self._shapes = [shape_of(figure, table.centre_m, orbit) for figure in table.figures]
        self._current = 0
        place = np.arange(len(craft))
        self._from, self._to = (self._shapes[0], place), (self._shapes[0], place)
        self._begun_s, self._length_s = 0.0, 0.0

    def at(self, time_s: float, heard: Heard, neighbours: Neighbours | None = None) -> Motion:
        """Return the reference motion of the formation's craft, (N, 3) each.

        Args:
            time_s: time [s].
            heard: broadcasts; when a figure ends, the places in the next one are assigned by their positions.
            neighbours: other craft as these know them; where the figures move with one, each adds how far it has come.
        """
        if self._about is None:
            return self._figure_at(time_s, heard)
        leader, start = self._about
        known = {} if neighbours is None else neighbours
        shift = np.zeros((2, len(self.craft), 3))
        for n, craft in enumerate(self.craft.tolist()):
            if (other := known.get((craft, leader))) is not None:
                shift[:, n] = other.state.position - start, other.state.velocity
        if heard.known[leader]:
            heard = heard._replace(position=heard.position - (heard.position[leader] - start))
        motion = self._figure_at(time_s, heard)
        return motion._replace(position=motion.position + shift[0], velocity=motion.velocity + shift[1])

    def _figure_at(self, time_s: float, heard: Heard) -> Motion:
        """Return the motion of the places in figures that stay."""
        after = self._current + 1
        if after < len(self._shapes) and time_s >= self._table.figures[after].at_s:
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
        """Return whether the craft are between two figures."""
        return time_s < self._begun_s + self._length_s

    def phase(self, time_s: float) -> Phase:
        """Return the phase, which all craft of the formation share."""
        return Phase.TRANSFER if self.transferring(time_s) else Phase.KEEP

    def _begin(self, time_s: float, heard: Heard) -> None:
        """Begin the transfer to the next figure."""
        self._current += 1
        shape = self._shapes[self._current]
        now = self.at_figure(time_s)
        there = shape.at(time_s, len(self.craft)).position
        # The others assume that a craft they do not hear keeps its place in the figure.
        believed = np.where(heard.known[self.craft, None], heard.position[self.craft], now)
        place = assign(believed, there)
        self._from, self._to = self._to, (shape, place)
        self._begun_s = time_s
        farthest = float(np.linalg.norm(there[place] - now, axis=1).max())
        self._length_s = PEAK_TO_MEAN * farthest / self._table.speed_m_s

    def at_figure(self, time_s: float) -> Floats:
        """Return the places (N, 3) [m] in the figure that was begun last."""
        shape, place = self._to
        return _taken(shape, place, time_s).position


def _taken(shape: Shape, place: Ints, time_s: float) -> Motion:
    """Return the motion of a shape's places, in the order of the craft assigned to them."""
    return Motion(*(part[place] for part in shape.at(time_s, len(place))))
