"""Other craft as a craft knows them by relative navigation, and references in the axes of one that moves and turns.

With R, p, v, w the attitude, position, velocity and angular rate of the other craft, taken to be constant but for what
they do to a point q fixed or moving in its axes,

    position      p + R q
    velocity      v + w x R q + R q'
    acceleration  w x (w x R q) + 2 w x R q' + R q''

are those of the point in the world: the feed-forward of a craft that follows it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from estimators.rotation import skew
from estimators.state import State
from swarm.onboard.guidance.glideslope import Moving


class Neighbour(NamedTuple):
    """Another craft as one knows it.

    state: in the world, without the craft axis, at the beginning of the period, by the relative state and the craft's
    own. sigma_m: standard deviation of the relative position [m]. good: whether it is of the period that has ended, and
    the pair has no alert; if not, the state is carried on at constant rates.
    """

    state: State
    sigma_m: float
    good: bool

    def ahead(self, time_s: float) -> "Neighbour":
        """Return it `time_s` later, unheard."""
        return self._replace(state=self.state.ahead(time_s), good=False)


Neighbours = Mapping[tuple[int, int], Neighbour]
"""What craft know of others: by who knows and of whom."""


def carried(other: State, point: Moving) -> Moving:
    """Return a point that moves in the axes of another craft as it moves in the world.

    Args:
        other: state of the other craft in the world, without the craft axis.
        point: the point in its axes.
    """
    turn, spin = other.rotation, skew(other.angular_rate)
    arm, speed = turn @ point.position, turn @ point.velocity
    return Moving(
        other.position + arm,
        other.velocity + spin @ arm + speed,
        spin @ (spin @ arm + 2 * speed) + turn @ point.acceleration,
    )


def at_rest_in(other: State, position: tuple[float, float, float]) -> Moving:
    """Return a point (3,) [m] of the world, at rest there, as it moves in the axes of another craft."""
    turn, arm = other.rotation.T, np.array(position) - other.position
    return Moving(turn @ arm, turn @ (-other.velocity - skew(other.angular_rate) @ arm), np.zeros(3))
