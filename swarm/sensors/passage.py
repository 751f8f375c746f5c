"""Kernel of the stations' light: when a plane of light passes over photodiodes, and for how long it stays on them.

Any plane of any station, in the world or riding on a craft. Craft and station move as in MuJoCo between two knots,
along a straight line and at a constant turn rate, so that a photodiode is at

    q(t) = R_s(t)^T (p(t) + R(t) b - t_s(t))                        in the station's frame

A sweep is named by the instant t_b at which its plane looks along the boresight; it passes the photodiode at the root
of

    g(t) = measured_angle(q(t)) + error - w (t - t_b)                (E) or (T) of `estimators.lighthouse`

found by Newton steps: g' differs from -w by the craft's motion alone, some thousandths of it. With u the gradient of
the angle by q, the plane moves over the place of the photodiode at w / |u| [m/s]. It is on a disc of diameter D and
normal n while it is within half of the disc's extent across the plane, and half of its own thickness B:

    width = |u| (D sqrt(1 - (n . u / |u|)^2) + B) / w
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.sweep import angle_gradient, measured_angle
from estimators.rotation import turned
from swarm.draws import Keys, normals
from swarm.sensors.crossing import SEGMENT, segment_into, turned_at
from swarm.sensors.light_draws import ANGLE

NEAR_S = 1e-11
"""Convergence limit: the time in which the rotor turns by the angle that remains [s]; steps converge quadratically."""
_ROUNDS = 12
"""Newton steps at most; three are usual."""


class Sweeps(NamedTuple):
    """Sweeps of one plane, in order of time, (N,) each.

    boresight_s: instant at which the plane looks along the boresight, after the period's start [s]. number: number of
    the sweep since the run began, which names its draws. look: index of the look at what is lit, of the nearest time.
    """

    boresight_s: Floats
    number: Ints
    look: Ints


class Passages(NamedTuple):
    """Photodiodes that planes of light pass over in a period, (N,) each.

    craft, photodiode: which. station, plane: whose light. sweep: number of the sweep since the run began. instant_s:
    after the period's start [s]. width_s: time for which the light stays [s].
    """

    craft: Ints
    photodiode: Ints
    station: Ints
    plane: Ints
    sweep: Ints
    instant_s: Floats
    width_s: Floats


def no_passages(count: int) -> Passages:
    """Return room for `count` passages."""
    return Passages(*np.zeros((5, count), dtype=np.int64), *np.zeros((2, count)))


def segments(knot: Floats, position: Floats, quaternion: Floats) -> Floats:
    """Return the motions of C bodies between n + 1 knots, (n, C, SEGMENT).

    Args:
        knot: times of the knots, (n + 1,) [s].
        position: positions at the knots, (n + 1, C, 3) [m].
        quaternion: attitudes at the knots, (n + 1, C, 4) wxyz.
    """
    out = np.empty((len(knot) - 1, position.shape[1], SEGMENT))
    _segments_into(knot, np.ascontiguousarray(position), np.ascontiguousarray(quaternion), out)
    return out


@kernel
def _segments_into(knot: Floats, position: Floats, quaternion: Floats, out: Floats) -> None:
    for j in range(out.shape[0]):
        for c in range(out.shape[1]):
            pose = quaternion[j, c], quaternion[j + 1, c], position[j, c], position[j + 1, c]
            segment_into(*pose, knot[j + 1] - knot[j], out[j, c])


@kernel
def pass_into(
    knot: Floats,
    craft: Floats,
    station: Floats,
    point: Floats,
    normal_of: Floats,
    lit: Bools,
    sweeps: Sweeps,
    fan: Floats,
    turn_rate: float,
    key: np.uint64,
    keys: Keys,
    own: float,
    shared: float,
    extent: tuple[float, float],
    window: tuple[float, float],
    count: int,
    out: Passages,
) -> int:
    """Write the passages of one plane of one station within the period; return the number in `out` after them.

    Args:
        knot: times of the knots, from the period's start, (n + 1,) [s].
        craft: motions of the craft between the knots, (n, C, SEGMENT).
        station: motion of the station, (n, SEGMENT).
        point: positions of the photodiodes, (C, K, 3) [m], body frame.
        normal_of: normals of the photodiodes, (C, K, 3), body frame.
        lit: photodiodes that the light reaches, by look, (L, C, K).
        sweeps: sweeps that may meet a photodiode within the period.
        fan: the plane, as `kernel_fans` packs it, (FAN,).
        turn_rate: w, of the rotor [rad/s].
        key: key of the rotor's draws; the number of the sweep follows.
        keys: keys of the draws of each craft before this plane, (C,); sweep and photodiode follow.
        own: standard deviation of an angle by itself [rad].
        shared: standard deviation of what all angles of a sweep have in common [rad].
        extent: diameter of a photodiode, and thickness of the plane [m].
        window: time within the period at which light is logged [s]; from its beginning to before its end.
        count: number of passages that are in `out` already.
        out: output; has room for all that are lit.
    """
    intervals = len(knot) - 1
    q, n, rotor = np.empty((2, 3)), np.empty(3), np.empty(len(sweeps.number))
    for b in range(len(rotor)):
        rotor[b] = shared * normals(key, sweeps.number[b], 0, ANGLE)[0]
    for c in range(lit.shape[1]):
        for b in range(len(rotor)):
            begin, number = sweeps.boresight_s[b], sweeps.number[b]
            guess = begin
            for k in range(lit.shape[2]):
                if not lit[sweeps.look[b], c, k]:
                    continue
                error = rotor[b] + own * normals(keys[c], number, k, ANGLE)[0]
                t, found, j = guess, False, 0
                for _ in range(_ROUNDS):
                    j = 0
                    while j < intervals - 1 and t >= knot[j + 1]:
                        j += 1
                    _place_into(craft[j, c], station[j], t - knot[j], point[c, k], q)
                    if not q[0, 2] > 0:
                        break
                    g = measured_angle(q[0, 0], q[0, 1], q[0, 2], fan) + error - turn_rate * (t - begin)
                    if abs(g) <= turn_rate * NEAR_S:
                        found = True
                        break
                    u = angle_gradient(q[0, 0], q[0, 1], q[0, 2], fan)
                    t -= g / (u[0] * q[1, 0] + u[1] * q[1, 1] + u[2] * q[1, 2] - turn_rate)
                if found:
                    guess = t
                if not found or not window[0] <= t < window[1]:
                    continue
                u = angle_gradient(q[0, 0], q[0, 1], q[0, 2], fan)
                _turn_into(craft[j, c], station[j], t - knot[j], normal_of[c, k], n)
                steep = np.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
                across = (n[0] * u[0] + n[1] * u[1] + n[2] * u[2]) / steep
                out.craft[count], out.photodiode[count], out.sweep[count] = c, k, number
                out.instant_s[count] = t
                seen = extent[0] * np.sqrt(max(0.0, 1 - across * across)) + extent[1]
                out.width_s[count] = steep * seen / turn_rate
                count += 1
    return count


@kernel
def _into_station(theirs: Floats, s: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a world vector in the station's frame, `s` seconds into its segment."""
    a, b, c = turned(-theirs[6] * s, -theirs[7] * s, -theirs[8] * s, x, y, z)
    return (
        theirs[9] * a + theirs[12] * b + theirs[15] * c,
        theirs[10] * a + theirs[13] * b + theirs[16] * c,
        theirs[11] * a + theirs[14] * b + theirs[17] * c,
    )


@kernel
def _turn_into(mine: Floats, theirs: Floats, s: float, vector: Floats, out: Floats) -> None:
    """Write a body vector (3,) in the station's frame."""
    x, y, z = turned_at(mine, s, vector)
    out[0], out[1], out[2] = _into_station(theirs, s, x, y, z)


@kernel
def _place_into(mine: Floats, theirs: Floats, s: float, p: Floats, out: Floats) -> None:
    """Write the place of a photodiode p (3,) in the station's frame, and its velocity there, (2, 3)."""
    x, y, z = turned_at(mine, s, p)
    dx = mine[0] - theirs[0] + (mine[3] - theirs[3]) * s + x
    dy = mine[1] - theirs[1] + (mine[4] - theirs[4]) * s + y
    dz = mine[2] - theirs[2] + (mine[5] - theirs[5]) * s + z
    vx = mine[3] - theirs[3] + mine[7] * z - mine[8] * y - (theirs[7] * dz - theirs[8] * dy)
    vy = mine[4] - theirs[4] + mine[8] * x - mine[6] * z - (theirs[8] * dx - theirs[6] * dz)
    vz = mine[5] - theirs[5] + mine[6] * y - mine[7] * x - (theirs[6] * dy - theirs[7] * dx)
    out[0, 0], out[0, 1], out[0, 2] = _into_station(theirs, s, dx, dy, dz)
    out[1, 0], out[1, 1], out[1, 2] = _into_station(theirs, s, vx, vy, vz)
