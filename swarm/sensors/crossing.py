"""Kernels of the lighthouse: the instant at which a turning fan crosses a moving photodiode, and the sorted pulses.

Lighthouse frame. Instants are seconds after the start of the period. Between two knots a craft moves as in MuJoCo: its
origin along a straight line, its attitude at constant rate, R(t) = Exp([w_c]x (t - t_j)) R_j. The crossing is the root
of

    g(t) = pi/2 + measured_angle(p(t)) + error - w (t - t_0)

A fan without systematic errors measures -phi, phi = atan2(across, z). It crosses all photodiodes of a craft within some
tenths of a millisecond of the instant t_c at which it points at their middle, and meanwhile phi hardly bends:

    g(t_c + d) = g(t_c) - (w + phi_1) d - phi_2 d^2 / 2 - phi_3 d^3 / 6                                           (K)

with the derivatives phi_n at t_c (phi_3 somewhere in between) is solved for d without its last term, for four
photodiodes at once. With velocity, acceleration and jerk of the photodiode over its distance, u, a and j,
|phi_3| <= 2 |u|^3 + 3 |u| |a| + |j|. Where that leaves more than half of the limit, where the next knot comes in
between, and for fans with errors, Newton steps find the root of one photodiode at a time, with the slope of a fan
without errors, within a bracket that they may not leave.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import LANES, lane, pack
from estimators.lighthouse.sweep import TERMS, measured_angle
from estimators.rotation import Row, Rows, exp_rows, quaternion_between, quaternion_rows, turned

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
    """A craft at t_c, along the axes (across, beside, ahead).

    instant: t_c [s]. direction: across and ahead of a point that the fan points at [m]. rest: its g(t_c) [rad].
    rotation: of the craft. position, velocity, rate: of the craft [m], [m/s], [rad/s].
    """

    instant: float
    direction: tuple[float, float]
    rest: float
    rotation: Rows
    position: Row
    velocity: Row
    rate: Row


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
    # b = d a, so d = b a*; q and -q are the same attitude: the shorter turn is taken.
    w, x, y, z = quaternion_between(b, a)
    # The next term of asin(s)/s is below rounding at s = 0.05.
    square = x * x + y * y + z * z
    sine = np.sqrt(square)
    half = 1 + square * (1 / 6 + square * (3 / 40 + square * (5 / 112 + square * (35 / 1152 + square * (63 / 2816)))))
    if sine > 0.05:
        half = np.arctan2(sine, abs(w)) / sine
    scale = 2 * half / step if w >= 0 else -2 * half / step
    out[6], out[7], out[8] = scale * x, scale * y, scale * z
    turn = quaternion_rows(a[0], a[1], a[2], a[3])
    for i in range(3):
        out[9 + 3 * i], out[10 + 3 * i], out[11 + 3 * i] = turn[i]
    for i in range(3):
        out[i] = from_m[i]
        out[3 + i] = (to_m[i] - from_m[i]) / step


class _Motion(NamedTuple):
    """Motion of a swarm in a period: `cross_into`'s knots, and one craft's segments, as far as they were asked for.

    segment: (n, SEGMENT). ready: which there are, (n,).
    """

    knot: Floats
    position: Floats
    quaternion: Floats
    segment: Floats
    ready: Bools


@kernel
def _segment_at(motion: _Motion, c: int, t: float) -> int:
    """Return the number of the craft's segment at an instant, which is there then."""
    j = 0
    while j < len(motion.ready) - 1 and t >= motion.knot[j + 1]:
        j += 1
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


def cross_into(
    knot: Floats,
    position: Floats,
    quaternion: Floats,
    point: Floats,
    normal: Floats,
    lit: Bools,
    error: Floats,
    fans: Floats,
    period: float,
    diameter: float,
    instant: Floats,
    width: Floats,
) -> None:
    """Write the crossing instants and sweep widths of the lit photodiodes; NaN where a fan finds no crossing.

    Args:
        knot: times of the knots, from the period's start, (n + 1,) [s].
        position: positions of the craft at the knots, (n + 1, C, 3) [m].
        quaternion: attitudes of the craft at the knots, (n + 1, C, 4) wxyz.
        point: positions of the photodiodes, (C, K, 3) [m], body frame.
        normal: normals of the photodiodes, (C, K, 3), body frame.
        lit: photodiodes that are lit as each fan sweeps, (C, K, 2).
        error: random error of each angle, (C, K, 2) [rad].
        fans: fans as `kernel_fans` packs them, (2, FAN).
        period: length of one turn of the rotor [s].
        diameter: diameter of a photodiode's face [m].
        instant: output, crossing instants, (C, K, 2) [s].
        width: output, sweep widths, (C, K, 2) [s].
    """
    intervals = len(knot) - 1
    motion = _Motion(knot, position, quaternion, np.empty((intervals, SEGMENT)), np.empty(intervals, np.bool_))
    who, w = np.empty(lit.shape[1], np.int64), 2 * np.pi / period
    _cross_into(motion, point, normal, lit, error, fans, w, diameter, who, instant, width)


@kernel
def _cross_into(
    motion: _Motion,
    point: Floats,
    normal: Floats,
    lit: Bools,
    error: Floats,
    fans: Floats,
    w: float,
    diameter: float,
    who: Ints,
    instant: Floats,
    width: Floats,
) -> None:
    """Do the work of `cross_into`; without arrays of its own, it counts no references. who: room, (K,)."""
    for c in range(lit.shape[0]):
        motion.ready[:] = False
        for fan in range(2):
            count, x, y, z = 0, 0.0, 0.0, 0.0
            for k in range(lit.shape[1]):
                instant[c, k, fan] = width[c, k, fan] = np.nan
                if lit[c, k, fan]:
                    who[count] = k
                    count += 1
                    x, y, z = x + point[c, k, 0], y + point[c, k, 1], z + point[c, k, 2]
            if count == 0:
                continue
            start, perfect, found = fan * np.pi / w, True, 0
            for term in range(TERMS, fans.shape[1]):
                perfect = perfect and fans[fan, term] == 0
            if perfect:
                aim, j = _aimed(motion, c, x / count, y / count, z / count, fan, start, w)
                low, high = max(start, motion.knot[j]), min(start + np.pi / w, motion.knot[j + 1])
                for first in range(0, count, LANES):
                    last = count - 1
                    a, b = who[first], who[min(first + 1, last)]
                    d, e = who[min(first + 2, last)], who[min(first + 3, last)]
                    four = pack(error[c, a, fan], error[c, b, fan], error[c, d, fan], error[c, e, fan])
                    place, face = _gathered(point[c], a, b, d, e), _gathered(normal[c], a, b, d, e)
                    after, wide, sure = _solved(aim, place, face, four, w, diameter)
                    for i in range(min(LANES, count - first)):
                        t = aim.instant + lane(after, i)
                        if lane(sure, i) and low < t < high:
                            instant[c, who[first + i], fan], width[c, who[first + i], fan] = t, lane(wide, i)
                            found += 1
            guess = start + 0.5 * np.pi / w
            for i in range(count if found < count else 0):
                k = who[i]
                if np.isnan(instant[c, k, fan]):
                    _search(motion, c, k, point, normal, error, fans, fan, guess, start, w, diameter, instant, width)
                if not np.isnan(instant[c, k, fan]):
                    guess = instant[c, k, fan]


@kernel
def _aimed(motion: _Motion, c: int, x: float, y: float, z: float, fan: int, start: float, w: float) -> tuple[_Aim, int]:
    """Return the craft as a fan points at a point of it (x, y, z) [m], and the number of its segment then."""
    t = start + 0.5 * np.pi / w
    j = _segment_at(motion, c, t)
    m, s = motion.segment[j], t - motion.knot[j]
    across = m[fan] + m[3 + fan] * s + m[9 + 3 * fan] * x + m[10 + 3 * fan] * y + m[11 + 3 * fan] * z
    ahead = m[2] + m[5] * s + m[15] * x + m[16] * y + m[17] * z
    angle = 0.5 * np.pi - np.arctan2(across, ahead)
    t = start + angle / w
    j = _segment_at(motion, c, t)
    m, s = motion.segment[j], t - motion.knot[j]
    turn = exp_rows(m[6] * s, m[7] * s, m[8] * s)
    r = (
        _row(turn[0], m),
        _row(turn[1], m),
        _row(turn[2], m),
    )
    p = m[0] + m[3] * s, m[1] + m[4] * s, m[2] + m[5] * s
    v, rate = (m[3], m[4], m[5]), (m[6], m[7], m[8])
    if fan == 1:  # turned about z: y is across, and -x beside
        r = r[1], (-r[0][0], -r[0][1], -r[0][2]), r[2]
        p, v, rate = (p[1], -p[0], p[2]), (v[1], -v[0], v[2]), (rate[1], -rate[0], rate[2])
    return _Aim(t, (across, ahead), angle - w * (t - start), r, p, v, rate), j


@kernel
def _row(row: Row, segment: Floats) -> Row:
    """Return the product of a row and the rotation of a segment."""
    a, b, d = row
    m = segment
    return (
        a * m[9] + b * m[12] + d * m[15],
        a * m[10] + b * m[13] + d * m[16],
        a * m[11] + b * m[14] + d * m[17],
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


@kernel
def _gathered(of: Floats, a: int, b: int, d: int, e: int) -> Row:
    """Return the vectors (K, 3) of four photodiodes, lane by lane."""
    return (
        pack(of[a, 0], of[b, 0], of[d, 0], of[e, 0]),
        pack(of[a, 1], of[b, 1], of[d, 1], of[e, 1]),
        pack(of[a, 2], of[b, 2], of[d, 2], of[e, 2]),
    )


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
    # The extent of the disc along the fan's motion at the crossing is its foreshortened diameter.
    x, z = x + d * (vx + 0.5 * d * a[0]), z + d * (vz + 0.5 * d * a[2])
    n = _times(aim.rotation, normal[0], normal[1], normal[2])
    u = _cross(rate, n)
    a = _cross(rate, u)
    square = x * x + z * z
    slant = (n[0] + d * (u[0] + 0.5 * d * a[0])) * z - (n[2] + d * (u[2] + 0.5 * d * a[2])) * x
    return d, diameter * np.sqrt(max(0.0, square - slant * slant)) / (square * w), sure


@kernel
def _search(
    motion: _Motion,
    c: int,
    k: int,
    point: Floats,
    normal: Floats,
    error: Floats,
    fans: Floats,
    fan: int,
    guess: float,
    start: float,
    w: float,
    diameter: float,
    instant: Floats,
    width: Floats,
) -> None:
    """Write the crossing of one photodiode by Newton steps from a guess, if there is one within the fan's half turn."""
    px, py, pz = point[c, k, 0], point[c, k, 1], point[c, k, 2]
    low, high, t = start, start + np.pi / w, guess
    for _ in range(_ROUNDS):
        j = _segment_at(motion, c, t)
        m, s = motion.segment[j], t - motion.knot[j]
        a, b, d = m[6], m[7], m[8]
        x, y, z = turned(
            a * s,
            b * s,
            d * s,
            m[9] * px + m[10] * py + m[11] * pz,
            m[12] * px + m[13] * py + m[14] * pz,
            m[15] * px + m[16] * py + m[17] * pz,
        )
        # The point's velocity, along the fan's motion (`along`) and along z (`closing`).
        along = m[3 + fan] + (b * z - d * y if fan == 0 else d * x - a * z)
        closing = m[5] + a * y - b * x
        x, y, z = x + m[0] + m[3] * s, y + m[1] + m[4] * s, z + m[2] + m[5] * s
        across = x if fan == 0 else y
        square = across * across + z * z
        g = np.pi / 2 + measured_angle(x, y, z, fans[fan]) + error[c, k, fan] - w * (t - start)
        if abs(g) <= w * CONVERGED_S:
            nx, ny, nz = normal[c, k, 0], normal[c, k, 1], normal[c, k, 2]
            nx, ny, nz = turned(
                a * s,
                b * s,
                d * s,
                m[9] * nx + m[10] * ny + m[11] * nz,
                m[12] * nx + m[13] * ny + m[14] * nz,
                m[15] * nx + m[16] * ny + m[17] * nz,
            )
            # The extent of the disc along the fan's direction of motion at p is its foreshortened diameter.
            slant = (nx if fan == 0 else ny) * z - nz * across
            instant[c, k, fan] = t
            width[c, k, fan] = diameter * np.sqrt(max(0.0, square - slant * slant)) / square / w
            return
        if g > 0:
            low = t
        else:
            high = t
        t -= g / ((across * closing - along * z) / square - w)
        # This holds also where g or the step is NaN: the loop then ends without an answer.
        if not (low < t < high):
            t = (low + high) / 2


@kernel
def pack_into(
    flashed: Bools,
    instant: Floats,
    width: Floats,
    lost: Bools,
    strays: Ints,
    stray: Floats,
    flash: Floats,
    flash_width: Ints,
    start_tick: Floats,
    tick: float,
    out_photodiode: NDArray[np.int16],
    out_rise: Ints,
    out_width: NDArray[np.int32],
    total: NDArray[np.int32],
) -> None:
    """Write every craft's pulses in order of rise; pulses of equal rise stay in the order flashes, sweeps, strays.
    Behind the last one, photodiode is -1 and the rest 0.

    Args:
        flashed: photodiodes that see each fan's flash, (C, K, 2).
        instant: crossing instants, (C, K, 2) [s], NaN where there is no sweep.
        width: sweep widths, (C, K, 2) [s].
        lost: sweeps whose pulse is lost, (C, K, 2).
        strays: numbers of stray pulses, (C,).
        stray: photodiode (rounded down), instant [s] and width [s] of the stray pulses, (C, S, 3).
        flash: instants at which the flashes rise, (2,) [s].
        flash_width: widths of the flashes, (2,) [ticks].
        start_tick: start of the period on each craft's clock, not a whole number, (C,) [ticks].
        tick: length of a tick [s].
        out_photodiode: output, photodiode of each pulse, (C, P).
        out_rise: output, rise of each pulse, (C, P) [ticks].
        out_width: output, width of each pulse, (C, P) [ticks].
        total: output, number of pulses per craft, (C,).
    """
    for c in range(flashed.shape[0]):
        photodiodes, rises, widths, m = out_photodiode[c], out_rise[c], out_width[c], 0
        for fan in range(2):
            # A flash comes after all sweeps before it, and before those of the same tick.
            rise, seen = int(np.rint(start_tick[c] + flash[fan] / tick)), 0
            for k in range(flashed.shape[1]):
                seen += flashed[c, k, fan]
            i = m
            while i > 0 and rises[i - 1] >= rise:
                i -= 1
                photodiodes[i + seen], rises[i + seen], widths[i + seen] = photodiodes[i], rises[i], widths[i]
            for k in range(flashed.shape[1]):
                if flashed[c, k, fan]:
                    photodiodes[i], rises[i], widths[i] = k, rise, flash_width[fan]
                    i += 1
            m += seen
            for k in range(flashed.shape[1]):
                if not np.isnan(instant[c, k, fan]) and not lost[c, k, fan]:
                    ticks = max(1, int(np.rint(width[c, k, fan] / tick)))
                    rise = int(np.rint(start_tick[c] + instant[c, k, fan] / tick - ticks / 2))
                    m = _insert(m, k, rise, ticks, photodiodes, rises, widths)
        for s in range(strays[c]):
            ticks = max(1, int(np.rint(stray[c, s, 2] / tick)))
            rise = int(np.rint(start_tick[c] + stray[c, s, 1] / tick))
            m = _insert(m, int(stray[c, s, 0]), rise, ticks, photodiodes, rises, widths)
        total[c] = m
        for i in range(m, len(rises)):
            photodiodes[i], rises[i], widths[i] = -1, 0, 0


@kernel
def _insert(
    count: int,
    photodiode: int,
    rise: int,
    width: int,
    photodiodes: NDArray[np.int16],
    rises: Ints,
    widths: NDArray[np.int32],
) -> int:
    """Insert a pulse into the first `count` entries of a row, sorted by rise; return the new count."""
    i = count
    while i > 0 and rises[i - 1] > rise:
        photodiodes[i], rises[i], widths[i] = photodiodes[i - 1], rises[i - 1], widths[i - 1]
        i -= 1
    photodiodes[i], rises[i], widths[i] = photodiode, rise, width
    return count + 1
