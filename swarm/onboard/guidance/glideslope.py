"""The closing speed as a function of distance: a glideslope with a soft end, limited in speed and acceleration.

With rho the distance to go, a > 0 its slope and v_e the speed wanted at the end, the glideslope (Hablani, Tapper and
Dana-Bashian, J. Guidance, Control and Dynamics 25(3), 2002) is the line

    v(rho) = a rho + v_e,     flown from rho to the end in   t = ln(1 + a rho / v_e) / a                            (G1)

It is flown at no more than v_max, and at no more than the speed from which an acceleration u can still brake to v_e:

    v(rho) = min(v_max, a rho + v_e, sqrt(v_e^2 + 2 u rho))                                                         (G2)

The reference is a point that moves towards its goal at that speed, its velocity changing by at most u T per period T.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats


@dataclass(frozen=True)
class Glideslope:
    """Parameters of (G2).

    slope_per_s: slope a [1/s]. speed_m_s: v_max [m/s]. acceleration_m_s2: u [m/s^2].
    """

    slope_per_s: float
    speed_m_s: float
    acceleration_m_s2: float

    def speed(self, distance_m: float, end_speed_m_s: float = 0.0) -> float:
        """Return the closing speed (G2) [m/s] at `distance_m` from the goal."""
        braking = np.sqrt(end_speed_m_s**2 + 2 * self.acceleration_m_s2 * distance_m)
        return float(min(self.speed_m_s, self.slope_per_s * distance_m + end_speed_m_s, braking))


class Moving(NamedTuple):
    """A point in motion, (3,) each: position [m], velocity [m/s], and its acceleration in the period before [m/s^2]."""

    position: Floats
    velocity: Floats
    acceleration: Floats


def at_rest(position: Floats) -> Moving:
    """Return a point at rest at `position` (3,) [m]."""
    return Moving(np.array(position, dtype=np.float64), np.zeros(3), np.zeros(3))


def towards(now: Moving, goal: Floats, profile: Glideslope, period_s: float) -> Moving:
    """Return the point one period later, on its way to rest at the goal.

    The acceleration is held during the period, and leads exactly to the returned position and velocity.

    Args:
        now: the point.
        goal: (3,) [m].
        profile: limits of speed and acceleration.
        period_s: length of the period [s].
    """
    way = goal - now.position
    distance = float(np.linalg.norm(way))
    wanted = way * (profile.speed(distance) / distance) if distance > 0 else np.zeros(3)
    return _steer(now, wanted, profile.acceleration_m_s2, period_s)


def through(now: Moving, goal: Floats, end_velocity: Floats, profile: Glideslope, period_s: float) -> Moving:
    """Return the point one period later, on its way through the goal and beyond it with a given velocity.

    The point approaches the line through the goal along the end velocity.

    Args:
        now: the point.
        goal: (3,) [m].
        end_velocity: velocity at the goal and beyond it, (3,) [m/s], not zero.
        profile: limits of speed and acceleration.
        period_s: length of the period [s].
    """
    way, speed = goal - now.position, float(np.linalg.norm(end_velocity))
    direction = end_velocity / speed
    along = float(way @ direction)
    wanted = direction * profile.speed(max(along, 0.0), speed) + profile.slope_per_s * (way - along * direction)
    return _steer(now, wanted, profile.acceleration_m_s2, period_s)


def brake(now: Moving, limit_m_s2: float, period_s: float) -> Moving:
    """Return the point one period later, on its way to rest.

    Args:
        now: the point.
        limit_m_s2: largest acceleration [m/s^2].
        period_s: length of the period [s].
    """
    return _steer(now, np.zeros(3), limit_m_s2, period_s)


def _steer(now: Moving, wanted: Floats, limit_m_s2: float, period_s: float) -> Moving:
    """Change the velocity towards `wanted` (3,) [m/s], by no more than the limit allows."""
    change = (wanted - now.velocity) / period_s
    size = float(np.linalg.norm(change))
    acceleration = change * min(1.0, limit_m_s2 / size) if size > 0 else change
    position = now.position + now.velocity * period_s + acceleration * period_s**2 / 2
    return Moving(position, now.velocity + acceleration * period_s, acceleration)
