"""Paths of one craft as functions of time, described by a few numbers; `swarm.world.motion.paths` evaluates them.

Three kinds serve every motion: a circle with centre c, unit vectors e1, e2 in its plane, phase a and rate w,

    p = c + r (cos(a + w t) e1 + sin(a + w t) e2)

pieces of polynomials of degree 5, p = sum_n c_n (t - t_i)^n for t_i <= t < t_(i+1), the first also before t_0, and sums
of random tones (`swarm.scenario.motions.tones`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from swarm.scenario.motions.tones import Tones

Vector = tuple[float, float, float]
DEGREE = 5
RAMP_SHARE = 0.25
"""Time of a corridor's speeding up, and of its slowing down, as a share of length / cruising speed."""


class Circle(NamedTuple):
    """One circle: centre (3,) [m], first and second (3,) unit vectors of its plane, radius [m], phase [rad], rate."""

    centre: Floats
    first: Floats
    second: Floats
    radius: float
    phase: float
    rate: float


class Pieces(NamedTuple):
    """One piecewise polynomial: start (N,) [s], coefficient (N, 6, 3), ascending, of the time since `start`."""

    start: Floats
    coefficient: Floats


class Wandering(NamedTuple):
    """One craft that wanders about its centre (3,) [m] by three signals [m], and turns by three more [rad]."""

    centre: Floats
    offset: Tones
    turn: Tones


Path = Circle | Pieces | Wandering
"""Every kind of path."""


def line(origin: Vector, velocity: Vector) -> Pieces:
    """A point [m] at time 0 that moves steadily [m/s]."""
    return Pieces(np.zeros(1), _coefficients([[origin, velocity]]))


def circle(centre: Vector, radius: float, rate: float, tilt: float, phase: float) -> Circle:
    """A circle [m], right-handed at `rate` [rad/s] about z turned by `tilt` [rad] about x; at `phase` [rad] from x."""
    second = np.array([0.0, np.cos(tilt), np.sin(tilt)])
    return Circle(np.array(centre), np.array([1.0, 0.0, 0.0]), second, radius, phase, rate)


def smooth_through(points: tuple[Vector, ...], times: tuple[float, ...]) -> Pieces:
    """Through points [m] at increasing times [s], at rest before the first and after the last.

    Quintic Hermite pieces with zero acceleration at every point, hence continuous acceleration. The velocity at an
    inner point is, per coordinate, the harmonic mean of the mean velocities before and after it, and zero where they
    differ in sign. It is at most twice the smaller of them, which keeps every coordinate monotone between neighbouring
    points: nothing is overshot. Through two points it is the minimum-jerk motion.
    """
    knot, value = np.array(times, dtype=np.float64), np.array(points, dtype=np.float64)
    still = _coefficients([[value[0]], [value[-1]]])
    if len(points) == 1:
        return Pieces(np.zeros(1), still[:1])
    length, way = np.diff(knot)[:, None], np.diff(value, axis=0)
    mean = way / length
    before, after = mean[:-1], mean[1:]
    same = before * after > 0
    velocity = np.zeros_like(value)
    velocity[1:-1] = np.where(same, 2 * before * after / np.where(same, before + after, 1.0), 0.0)
    v0, v1 = velocity[:-1] * length, velocity[1:] * length
    unscaled = [
        value[:-1],
        v0,
        0 * way,
        10 * way - 6 * v0 - 4 * v1,
        -15 * way + 8 * v0 + 7 * v1,
        6 * way - 3 * (v0 + v1),
    ]
    moving = np.stack([c / length**n for n, c in enumerate(unscaled)], axis=1)
    start = np.concatenate([[knot[0] - 1.0], knot])
    return Pieces(start, np.concatenate([still[:1], moving, still[1:]]))


def corridor(origin: Vector, target: Vector, start_s: float, speed: float) -> Pieces:
    """Straight from `origin` to `target` [m], starting at `start_s` [s], cruising at `speed` [m/s].

    The speed rises and falls as 3 s^2 - 2 s^3 over a quarter of length / speed each, so that the acceleration is
    continuous; the whole takes 1.25 length / speed.
    """
    a, b = np.array(origin, dtype=np.float64), np.array(target, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    v = speed * (b - a) / length
    ramp = RAMP_SHARE * length / speed
    cruise = length / speed - ramp
    zero = np.zeros(3)
    up = [zero, zero, zero, v / ramp**2, -v / (2 * ramp**3)]
    down = [zero, v, zero, -v / ramp**2, v / (2 * ramp**3)]
    starts = start_s + np.array([-1.0, 0.0, ramp, ramp + cruise, 2 * ramp + cruise])
    pieces = [[a], [a + up[0], *up[1:]], [a + v * ramp / 2, v], [b - v * ramp / 2, *down[1:]], [b]]
    return Pieces(starts, _coefficients(pieces))


def _coefficients(pieces: Sequence[Sequence[Vector | Floats]]) -> Floats:
    out = np.zeros((len(pieces), DEGREE + 1, 3))
    for i, piece in enumerate(pieces):
        out[i, : len(piece)] = piece
    return out
