"""Kernels of the lighthouse: the instant at which a turning fan crosses a moving photodiode, and how long that takes.

Lighthouse frame. Instants are seconds after the start of the period. Between two knots a craft moves as in MuJoCo: its
origin along a straight line, its attitude at constant rate, R(t) = Exp([w_c]x (t - t_j)) R_j. The crossing is the root
of

    g(t) = pi/2 + measured_angle(p(t)) + error - w (t - t_0)

A fan without systematic errors measures -phi, phi = atan2(across, z). It crosses all photodiodes of a craft within some
tenths of a millisecond of the instant t_c at which it points at their middle, and meanwhile phi hardly bends:

    g(t_c + d) = g(t_c) - (w + phi_1) d - phi_2 d^2 / 2 - phi_3 d^3 / 6                                           (K)

with the derivatives phi_n at t_c (phi_3 somewhere in between) is solved for d without its last term, for a photodiode
each of WIDE craft at once. With velocity, acceleration and jerk of the photodiode over its distance, u, a and j,
|phi_3| <= 2 |u|^3 + 3 |u| |a| + |j|. Where that leaves more than half of the limit, where the next knot comes in
between, and for fans with errors, Newton steps find the root of one photodiode at a time, with the slope of a fan
without errors, within a bracket that they may not leave.
"""

from typing import NamedTuple

import numpy as np

from estimators.arc_tangent import arc_tangent
from estimators.arrays import Bools, Floats
from estimators.kernel import inlined, kernel
from estimators.lanes import WIDE, alike, all_of, lane, select, wide_in, width, with_lane
from estimators.lighthouse.sweep import TERMS, measured_angle
from estimators.rotation import Row, Rows, exp_rows, quaternion_between, quaternion_rows, turned
from estimators.scratch import scratch

CONVERGED_S = 1e-13
"""Convergence limit: the time in which the rotor turns by the angle that remains [s]."""
_ROUNDS = 60
_NARROW = 0.1
"""Tangent of an angle below which seven terms of the arc tangent's series leave an error of 1e-16 rad."""
_SMALL_TURN_RAD = 1e-3
"""Turn of a craft within d, below which two terms of its series leave 2e-10 of a sweep's width."""

_POSITION, _VELOCITY, _RATE, _ROTATION, SEGMENT = 0, 3, 6, 9, 18
"""Offsets in a segment, one craft's motion between two knots (first pose and constant rates), and its length."""


class _Aim(NamedTuple):
    """Craft at t_c, along the axes (across, beside, ahead), in lanes.

    instant: t_c [s]. direction: across and ahead of a point that the fan points at [m]. rest: its g(t_c) [rad].
    rotation: of the craft. position, velocity, rate: of the craft [m], [m/s], [rad/s]. low, high: the motion is this
    one between them [s].
    """

    instant: float
    direction: tuple[float, float]
    rest: float
    rotation: Rows
    position: Row
    velocity: Row
    rate: Row
    low: float
    high: float


@kernel
def turn_rate(a: Floats, b: Floats, step: float) -> Row:
    """Return the constant rate of the shorter turn between two attitudes [rad/s], of numbers or lanes.

    Args:
        a: attitude at the first knot, (4,) wxyz.
        b: attitude at the second, (4,).
        step: time between them [s].
    """
    # b = d a, so d = b a*; q and -q are the same attitude.
    w, x, y, z = quaternion_between(b, a)
    # The next term of asin(s)/s is below rounding at s = 0.05.
    square = x * x + y * y + z * z
    sine = np.sqrt(square)
    half = 1 + square * (1 / 6 + square * (3 / 40 + square * (5 / 112 + square * (35 / 1152 + square * (63 / 2816)))))
    if not all_of(sine <= 0.05):
        for i in range(width(sine)):
            one = lane(sine, i)
            if not one <= 0.05:
                half = with_lane(half, i, np.arctan2(one, abs(lane(w, i))) / one)
    scale = select(w >= 0, 2 * half, -2 * half) / step
    return scale * x, scale * y, scale * z


@kernel
def segment_into(a: Floats, b: Floats, from_m: Floats, to_m: Floats, step: float, out: Floats) -> None:
    """Write the motion between two knots as a segment: position, velocity, rate, and rotation by rows.

    Args:
        a: attitude at the first knot, (4,) wxyz.
        b: attitude at the second, (4,).
        from_m: position at the first knot, (3,) [m].
        to_m: position at the second, (3,) [m].
        step: time between them [s].
        out: output, (SEGMENT,).
    """
    out[6], out[7], out[8] = turn_rate(a, b, step)
    turn = quaternion_rows(a[0], a[1], a[2], a[3])
    for i in range(3):
        out[9 + 3 * i], out[10 + 3 * i], out[11 + 3 * i] = turn[i]
    for i in range(3):
        out[i] = from_m[i]
        out[3 + i] = (to_m[i] - from_m[i]) / step


@kernel
def turned_at(segment: Floats, s: float, vector: Floats) -> Row:
    """Return a vector of the body in the frame of the segment's poses.

    Args:
        segment: the body's motion, (SEGMENT,).
        s: time since the segment's beginning [s].
        vector: in the body frame, (3,).
    """
    m, x, y, z = segment, vector[0], vector[1], vector[2]
    return turned(
        m[6] * s,
        m[7] * s,
        m[8] * s,
        m[9] * x + m[10] * y + m[11] * z,
        m[12] * x + m[13] * y + m[14] * z,
        m[15] * x + m[16] * y + m[17] * z,
    )


class Knots(NamedTuple):
    """Motion of C craft in a period, as MuJoCo moves between knots.

    knot: times of the knots, from the period's start, (n + 1,) [s]. position: positions at the knots, (n + 1, C, 3)
    [m]. quaternion: attitudes at the knots, (n + 1, C, 4) wxyz. segment, ready: room for one craft's segments, as far
    as they are asked for, (n, SEGMENT), and which there are, (n,).
    """

    knot: Floats
    position: Floats
    quaternion: Floats
    segment: Floats
    ready: Bools


class _Room(NamedTuple):
    """Room for WIDE craft side by side.

    knots: position, attitude and time at two knots, (2, 8, WIDE). time: instants between them, (1, WIDE).
    """

    knots: Floats
    time: Floats


def knots_of(time_s: Floats, position: Floats, quaternion: Floats) -> Knots:
    """Return the motion of C craft between knots.

    Args:
        time_s: times of the knots, from the period's start, (n + 1,) [s].
        position: positions at the knots, (n + 1, C, 3) [m].
        quaternion: attitudes at the knots, (n + 1, C, 4) wxyz.
    """
    parts = np.ascontiguousarray(time_s), np.ascontiguousarray(position), np.ascontiguousarray(quaternion)
    return Knots(*parts, np.empty((len(time_s) - 1, SEGMENT)), np.empty(len(time_s) - 1, np.bool_))


def side_by_side(values: Floats) -> Floats:
    """Return values of C craft's photodiodes (C, K, n) with WIDE craft side by side, (G, n, K, WIDE).

    Places behind the last craft hold its values again.
    """
    groups = -(-len(values) // WIDE)
    whole = np.concatenate([values, np.repeat(values[-1:], groups * WIDE - len(values), axis=0)])
    return np.ascontiguousarray(whole.reshape(groups, WIDE, *values.shape[1:]).transpose(0, 3, 2, 1))


def row_by_row(values: Floats, craft: int) -> Floats:
    """Return values (G, n, K, WIDE) of craft side by side as those of each, (C, K, n)."""
    groups, parts, photodiodes, _ = values.shape
    return np.ascontiguousarray(values.transpose(0, 3, 2, 1).reshape(groups * WIDE, photodiodes, parts)[:craft])


@kernel
def _interval(knot: Floats, t: float) -> int:
    """Return the number of the interval between knots that holds an instant, or the nearest one."""
    j = 0
    while j < len(knot) - 2 and t >= knot[j + 1]:
        j += 1
    return j


@kernel
def _segment_at(motion: Knots, c: int, t: float) -> int:
    """Return the number of the craft's segment at an instant, which is there then."""
    j = _interval(motion.knot, t)
    if not motion.ready[j]:
        segment_into(
            motion.quaternion[j, c],
            motion.quaternion[j + 1, c],
            motion.position[j, c],
            motion.position[j + 1, c],
            motion.knot[j + 1] - motion.knot[j],
            motion.segment[j],
        )
        motion.ready[j] = True
    return j


@kernel
def cross_into(
    motion: Knots,
    point: Floats,
    normal: Floats,
    error: Floats,
    fans: Floats,
    period: float,
    diameter: float,
    instant: Floats,
    width: Floats,
) -> None:
    """Write the crossing instants and sweep widths of the lit photodiodes; NaN where a fan finds no crossing.

    Photodiodes are those of WIDE craft side by side, as `side_by_side` brings them.

    Args:
        motion: motion of the craft.
        point: positions of the photodiodes, (G, 3, K, WIDE) [m], body frame.
        normal: normals of the photodiodes, (G, 3, K, WIDE), body frame.
        error: random error of each angle, NaN where a fan does not light the photodiode, (G, 2, K, WIDE) [rad].
        fans: fans as `kernel_fans` packs them, (2, FAN).
        period: length of one turn of the rotor [s].
        diameter: diameter of a photodiode's face [m].
        instant: output, crossing instants, (G, 2, K, WIDE) [s].
        width: output, sweep widths, (G, 2, K, WIDE) [s].
    """
    craft, w = motion.position.shape[1], 2 * np.pi / period
    room = _Room(scratch(0.0, 2, 8, WIDE), scratch(0.0, 1, WIDE))
    for g in range(len(point)):
        count = min(WIDE, craft - g * WIDE)
        for fan in range(2):
            start, perfect, found = fan * np.pi / w, True, False
            for term in range(TERMS, fans.shape[1]):
                perfect = perfect and fans[fan, term] == 0
            if perfect:
                found = _cross_together(
                    motion, g, count, fan, start, w, diameter, room, point, normal, error, instant, width
                )
            else:
                instant[g, fan] = np.nan
                width[g, fan] = np.nan
            if not found:
                for i in range(count):
                    _search_missing(motion, g, i, point, normal, error, fans, fan, start, w, diameter, instant, width)


@kernel
def _cross_together(
    motion: Knots,
    g: int,
    count: int,
    fan: int,
    start: float,
    w: float,
    diameter: float,
    room: _Room,
    point: Floats,
    normal: Floats,
    error: Floats,
    instant: Floats,
    width: Floats,
) -> bool:
    """Write one fan's crossings of WIDE craft, NaN where the limit is not kept; return whether all keep it.

    Lanes beyond `count` craft repeat the last one.
    """
    points, normals, errors = wide_in(point)[g], wide_in(normal)[g], wide_in(error)[g, fan]
    instants, widths = wide_in(instant)[g, fan], wide_in(width)[g, fan]
    x = y = z = number = alike(errors[0], 0.0)
    for k in range(len(errors)):
        lit = errors[k] == errors[k]
        x, y = x + select(lit, points[0, k], 0.0), y + select(lit, points[1, k], 0.0)
        z = z + select(lit, points[2, k], 0.0)
        number += select(lit, 1.0, 0.0)
    aim = _aimed(motion, g * WIDE, count, (x / number, y / number, z / number), fan, start, w, room)
    found = number == number
    for k in range(len(errors)):
        p, n = (points[0, k], points[1, k], points[2, k]), (normals[0, k], normals[1, k], normals[2, k])
        after, wide, sure = _solved(aim, p, n, errors[k], w, diameter)
        t = aim.instant + after
        sure = sure & (aim.low < t) & (t < aim.high)
        instants[k], widths[k] = select(sure, t, np.nan), select(sure, wide, np.nan)
        found = found & (sure | (errors[k] != errors[k]))
    return all_of(found)


@kernel
def _search_missing(
    motion: Knots,
    g: int,
    i: int,
    point: Floats,
    normal: Floats,
    error: Floats,
    fans: Floats,
    fan: int,
    start: float,
    w: float,
    diameter: float,
    instant: Floats,
    width: Floats,
) -> None:
    """Write those crossings of a craft, lane i, by one fan that are missing, each from the one before it."""
    guess, face = start + 0.5 * np.pi / w, scratch(0.0, 2, 3)
    motion.ready[:] = False
    for k in range(error.shape[2]):
        if not np.isnan(error[g, fan, k, i]) and np.isnan(instant[g, fan, k, i]):
            for axis in range(3):
                face[0, axis], face[1, axis] = point[g, axis, k, i], normal[g, axis, k, i]
            instant[g, fan, k, i], width[g, fan, k, i] = _searched(
                motion, g * WIDE + i, face, error[g, fan, k, i], fans, fan, guess, start, w, diameter
            )
        if not np.isnan(instant[g, fan, k, i]):
            guess = instant[g, fan, k, i]


@kernel
def _bring_knots(motion: Knots, first: int, count: int, room: _Room) -> None:
    """Write the two knots about each craft's instant side by side."""
    for i in range(WIDE):
        c, j = first + min(i, count - 1), _interval(motion.knot, room.time[0, i])
        for side in range(2):
            for axis in range(3):
                room.knots[side, axis, i] = motion.position[j + side, c, axis]
            for part in range(4):
                room.knots[side, 3 + part, i] = motion.quaternion[j + side, c, part]
            room.knots[side, 7, i] = motion.knot[j + side]


@inlined
def _aimed(motion: Knots, first: int, count: int, p: Row, fan: int, start: float, w: float, room: _Room) -> _Aim:
    """Return WIDE craft as a fan points at a point of each, p [m]."""
    times, knots = wide_in(room.time), wide_in(room.knots)
    a, b = knots[0], knots[1]
    times[0] = alike(p[0], start + 0.5 * np.pi / w)
    _bring_knots(motion, first, count, room)
    share = (times[0] - a[7]) / (b[7] - a[7])
    arm = _times(quaternion_rows(a[3], a[4], a[5], a[6]), p[0], p[1], p[2])
    across = a[fan] + share * (b[fan] - a[fan]) + (arm[0] if fan == 0 else arm[1])
    ahead = a[2] + share * (b[2] - a[2]) + arm[2]
    angle = 0.5 * np.pi - select(ahead > 0, arc_tangent(across, ahead), np.nan)
    t = start + angle / w
    times[0] = t
    _bring_knots(motion, first, count, room)
    step, s = b[7] - a[7], t - a[7]
    rate = turn_rate(a[3:], b[3:], step)
    r = _product(exp_rows(rate[0] * s, rate[1] * s, rate[2] * s), quaternion_rows(a[3], a[4], a[5], a[6]))
    v = (b[0] - a[0]) / step, (b[1] - a[1]) / step, (b[2] - a[2]) / step
    p = a[0] + v[0] * s, a[1] + v[1] * s, a[2] + v[2] * s
    if fan == 1:  # turned about z: y is across, and -x beside
        r = r[1], (-r[0][0], -r[0][1], -r[0][2]), r[2]
        p, v, rate = (p[1], -p[0], p[2]), (v[1], -v[0], v[2]), (rate[1], -rate[0], rate[2])
    rest = angle - w * (t - start)
    return _Aim(t, (across, ahead), rest, r, p, v, rate, max(a[7], start), min(b[7], start + np.pi / w))


@kernel
def _product(a: Rows, b: Rows) -> Rows:
    """Return the product of two matrices."""
    return (
        _combined(a[0], b),
        _combined(a[1], b),
        _combined(a[2], b),
    )


@kernel
def _combined(weight: Row, rows: Rows) -> Row:
    """Return the sum of three rows, each times its weight."""
    a, b, c = rows
    return (
        weight[0] * a[0] + weight[1] * b[0] + weight[2] * c[0],
        weight[0] * a[1] + weight[1] * b[1] + weight[2] * c[1],
        weight[0] * a[2] + weight[1] * b[2] + weight[2] * c[2],
    )


@kernel
def _times(r: Rows, x: float, y: float, z: float) -> Row:
    """Return the product of a matrix and a vector."""
    return (
        r[0][0] * x + r[0][1] * y + r[0][2] * z,
        r[1][0] * x + r[1][1] * y + r[1][2] * z,
        r[2][0] * x + r[2][1] * y + r[2][2] * z,
    )


@kernel
def _cross(a: Row, b: Row) -> Row:
    """Return the cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _solved(aim: _Aim, point: Row, normal: Row, error: float, w: float, diameter: float) -> tuple[float, float, bool]:
    """Return d and the width of the sweep [s] of one photodiode or four, and whether the limit is kept (K)."""
    rate = aim.rate
    q = _times(aim.rotation, point[0], point[1], point[2])
    u = _cross(rate, q)
    a = _cross(rate, u)
    x, z, vx, vz = aim.position[0] + q[0], aim.position[2] + q[2], aim.velocity[0] + u[0], aim.velocity[2] + u[2]
    over = 1 / (x * x + z * z)
    ahead = x * aim.direction[0] + z * aim.direction[1]
    turn = (x * aim.direction[1] - z * aim.direction[0]) / ahead
    square = turn * turn
    odd = square * (1 / 5 - square * (1 / 7 - square * (1 / 9 - square * (1 / 11 - square * (1 / 13)))))
    g = aim.rest + error - turn * (1 - square * (1 / 3 - odd))
    speed, closing = (vx * z - x * vz) * over, (x * vx + z * vz) * over
    bend = (a[0] * z - x * a[2]) * over - 2 * closing * speed
    slope = 1 / (w + speed)
    step = g * slope
    share = 0.5 * bend * step * slope
    d = step * (1 - share)
    # Sums of coordinates bound lengths.
    near = (abs(x) + abs(z)) * over * abs(d)
    first, second = (abs(vx) + abs(vz)) * near, (abs(a[0]) + abs(a[2])) * near * abs(d)
    spin = rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]
    turned_square = spin * (d * d)
    third = turned_square * ((abs(u[0]) + abs(u[2])) * near)
    left = first * (2 * first * first + 3 * second) + third + 12 * w * abs(step) * share * share
    sure = (
        (left < 3 * w * CONVERGED_S)
        & (square < _NARROW * _NARROW)
        & (turned_square < _SMALL_TURN_RAD * _SMALL_TURN_RAD)
        & (ahead > 0)
    )
    x, z = x + d * (vx + 0.5 * d * a[0]), z + d * (vz + 0.5 * d * a[2])
    n = _times(aim.rotation, normal[0], normal[1], normal[2])
    u = _cross(rate, n)
    a = _cross(rate, u)
    across, ahead = n[0] + d * (u[0] + 0.5 * d * a[0]), n[2] + d * (u[2] + 0.5 * d * a[2])
    return d, _duration(x, z, across, ahead, w, diameter), sure


@inlined
def _duration(x: float, z: float, across: float, ahead: float, w: float, diameter: float) -> float:
    """Return the time [s] that a fan takes to pass a disc at x, z [m] with this normal, by numbers or in lanes.

    The extent of the disc along the fan's motion is its foreshortened diameter.
    """
    square, slant = x * x + z * z, across * z - ahead * x
    duration: float = diameter * np.sqrt(max(0.0, square - slant * slant)) / (square * w)
    return duration


@kernel
def _searched(
    motion: Knots,
    c: int,
    face: Floats,
    error: float,
    fans: Floats,
    fan: int,
    guess: float,
    start: float,
    w: float,
    diameter: float,
) -> tuple[float, float]:
    """Return the crossing and the width of one photodiode by Newton steps from a guess; NaN where there is none.

    A crossing is sought within the fan's half turn. face: position and normal of the photodiode, (2, 3).
    """
    low, high, t = start, start + np.pi / w, guess
    for _ in range(_ROUNDS):
        j = _segment_at(motion, c, t)
        m, s = motion.segment[j], t - motion.knot[j]
        a, b, d = m[6], m[7], m[8]
        x, y, z = turned_at(m, s, face[0])
        # The point's velocity, along the fan's motion (`along`) and along z (`closing`).
        along = m[3 + fan] + (b * z - d * y if fan == 0 else d * x - a * z)
        closing = m[5] + a * y - b * x
        x, y, z = x + m[0] + m[3] * s, y + m[1] + m[4] * s, z + m[2] + m[5] * s
        across = x if fan == 0 else y
        square = across * across + z * z
        g = np.pi / 2 + measured_angle(x, y, z, fans[fan]) + error - w * (t - start)
        if abs(g) <= w * CONVERGED_S:
            nx, ny, nz = turned_at(m, s, face[1])
            return t, _duration(across, z, nx if fan == 0 else ny, nz, w, diameter)
        if g > 0:
            low = t
        else:
            high = t
        t -= g / ((across * closing - along * z) / square - w)
        # This holds also where g or the step is NaN: the loop then ends without an answer.
        if not (low < t < high):
            t = (low + high) / 2
    return np.nan, np.nan
