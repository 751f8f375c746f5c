"""Paths of one craft as functions of time, described by a few numbers; `swarm.world.motion.paths` evaluates them.

Nothing here imports numpy before a path needs it: loading a scenario does without.

Three kinds serve every motion: a circle with centre c, unit vectors e1, e2 in its plane, phase a and rate w,

    p = c + r (cos(a + w t) e1 + sin(a + w t) e2)

pieces of polynomials of degree 5, p = sum_n c_n (t - t_i)^n for t_i <= t < t_(i+1), the first also before t_0, and sums
of random tones (`swarm.scenario.motions.tones`).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from estimators.arrays import Floats
    from swarm.scenario.motions.tones import Tones

Vector = tuple[float, float, float]
DEGREE = 5
RAMP_SHARE = 0.25
"""Time of a corridor's speeding up, and of its slowing down, as a share of length / cruising speed."""


class Circle(NamedTuple):
    """A circle that turns right-handed about its axis, the z axis turned about the x axis by `tilt` [rad].

    centre [m], radius [m], rate [rad/s]. phase [rad]: from the x axis, at time 0.
    """

    centre: Vector
    radius: float
    rate: float
    tilt: float
    phase: float


class Pieces(NamedTuple):
    """A piecewise polynomial. start: N times [s]. coefficient: per piece up to 6 vectors, ascending in the time since
    its start; those that are left out are zero.
    """

    start: Sequence[float]
    coefficient: "Sequence[Sequence[Vector | Floats]]"


class Wandering(NamedTuple):
    """A random motion about a centre (3,) [m] by three signals [m], and a turn by three more [rad]."""

    centre: Vector
    offset: "Tones"
    turn: "Tones"


Path = Circle | Pieces | Wandering
"""Every kind of path."""


def line(origin: Vector, velocity: Vector = (0.0, 0.0, 0.0)) -> Pieces:
    """Return the path of a point that is at `origin` [m] at time 0 and moves steadily [m/s]."""
    return Pieces([0.0], [[origin, velocity]])


def smooth_through(points: Sequence[Vector], times: Sequence[float]) -> Pieces:
    """Return the path through points [m] at increasing times [s], at rest before the first and after the last.

    Quintic Hermite pieces with zero acceleration at every point, hence continuous acceleration. The velocity at an
    inner point is, per coordinate, the harmonic mean of the mean velocities before and after it, and zero where they
    differ in sign. It is at most twice the smaller of them, which keeps every coordinate monotone between neighbouring
    points: nothing is overshot. Through two points it is the minimum-jerk motion.
    """
    import numpy as np

    if len(points) == 1:
        return Pieces([0.0], [[points[0]]])
    knot, value = np.array(times, dtype=np.float64), np.array(points, dtype=np.float64)
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
    return Pieces([knot[0] - 1.0, *knot], [[value[0]], *moving, [value[-1]]])


def corridor(origin: Vector, target: Vector, start_s: float, speed: float) -> Pieces:
    """Return a straight path with a smooth start and stop.

    The speed rises and falls as 3 s^2 - 2 s^3 over a quarter of length / speed each, so that the acceleration is
    continuous; the whole takes 1.25 length / speed.

    Args:
        origin: The point of the start [m].
        target: The point of the stop [m].
        start_s: The time of the start [s].
        speed: The cruising speed [m/s].
    """
    import numpy as np

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
    return Pieces(starts.tolist(), pieces)
