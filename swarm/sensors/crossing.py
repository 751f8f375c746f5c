"""Kernels of the lighthouse: the instant at which a turning fan crosses a moving photodiode, and the sorted pulses.

Lighthouse frame. Instants are seconds after the start of the period. Between two knots a craft moves as in MuJoCo: its
origin along a straight line, its attitude at constant rate, R(t) = Exp([w_c]x (t - t_j)) R_j. The crossing is the root
of

    g(t) = pi/2 + measured_angle(p(t)) + error - w (t - t_0)

found by Newton steps, with the slope of a fan without systematic errors, within a bracket that the steps may not leave.
The steps start at the crossing of the craft's previous photodiode, some microseconds away: for a perfect fan, whose
slope is exact, the error of the first step is then already below the limit.
"""

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.sweep import TERMS, measured_angle
from estimators.rotation import quaternion_between, quaternion_rows, turned

CONVERGED_S = 1e-13
"""Convergence limit: the time in which the rotor turns by the angle that remains [s]."""
_ROUNDS = 60


_POSITION, _VELOCITY, _RATE, _ROTATION, SEGMENT = 0, 3, 6, 9, 18
"""Offsets in a segment, one craft's motion between two knots (first pose and constant rates), and its length."""


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
    sine = np.sqrt(x * x + y * y + z * z)
    # asin(s)/s = 1 + s^2/6: the next term is below rounding at s = 1e-4.
    half = np.arctan2(sine, abs(w)) / sine if sine > 1e-4 else 1 + sine * sine / 6
    scale = 2 * half / step if w >= 0 else -2 * half / step
    out[6], out[7], out[8] = scale * x, scale * y, scale * z
    turn = quaternion_rows(a[0], a[1], a[2], a[3])
    for i in range(3):
        out[9 + 3 * i], out[10 + 3 * i], out[11 + 3 * i] = turn[i]
    for i in range(3):
        out[i] = from_m[i]
        out[3 + i] = (to_m[i] - from_m[i]) / step


@kernel
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
    ready, segment = np.empty(intervals, np.bool_), np.empty((intervals, SEGMENT))
    w = 2 * np.pi / period
    perfect = True
    for fan in range(2):
        for term in range(TERMS, fans.shape[1]):
            perfect = perfect and fans[fan, term] == 0
    for c in range(lit.shape[0]):
        ready[:] = False
        for fan in range(2):
            start = fan * period / 2
            guess, warm = start + period / 4, False
            last_across = last_ahead = last_error = 0.0
            for k in range(lit.shape[1]):
                instant[c, k, fan] = width[c, k, fan] = np.nan
                if not lit[c, k, fan]:
                    continue
                px, py, pz = point[c, k, 0], point[c, k, 1], point[c, k, 2]
                low, high = start, start + period / 2
                t, found, j = guess, False, 0
                across = ahead = 1.0
                for r in range(_ROUNDS):
                    j = 0
                    while j < intervals - 1 and t >= knot[j + 1]:
                        j += 1
                    if not ready[j]:
                        pose = quaternion[j, c], quaternion[j + 1, c], position[j, c], position[j + 1, c]
                        segment_into(*pose, knot[j + 1] - knot[j], segment[j])
                        ready[j] = True
                    s = t - knot[j]
                    a, b, d = segment[j, 6], segment[j, 7], segment[j, 8]
                    x, y, z = turned(
                        a * s,
                        b * s,
                        d * s,
                        segment[j, 9] * px + segment[j, 10] * py + segment[j, 11] * pz,
                        segment[j, 12] * px + segment[j, 13] * py + segment[j, 14] * pz,
                        segment[j, 15] * px + segment[j, 16] * py + segment[j, 17] * pz,
                    )
                    # The point's velocity, along the fan's motion (`along`) and along z (`closing`).
                    along = segment[j, 3 + fan] + (b * z - d * y if fan == 0 else d * x - a * z)
                    closing = segment[j, 5] + a * y - b * x
                    x += segment[j, 0] + segment[j, 3] * s
                    y += segment[j, 1] + segment[j, 4] * s
                    z += segment[j, 2] + segment[j, 5] * s
                    across, ahead = x if fan == 0 else y, z
                    # The previous photodiode's direction at its crossing is the fan's: only the small angle from there
                    # is unknown, and four terms of its arc tangent leave an error of 2e-15 rad at 0.03 rad.
                    turn = 1.0
                    if r == 0 and warm:
                        turn = (across * last_ahead - z * last_across) / (across * last_across + z * last_ahead)
                    if abs(turn) < 0.03:
                        square = turn * turn
                        g = (
                            error[c, k, fan]
                            - last_error
                            - turn * (1 - square * (1 / 3 - square * (1 / 5 - square / 7)))
                        )
                    else:
                        angle = measured_angle(x, y, z, fans[fan])
                        g = np.pi / 2 + angle + error[c, k, fan] - w * (t - start)
                    if abs(g) <= w * CONVERGED_S:
                        found = True
                        break
                    if g > 0:
                        low = t
                    else:
                        high = t
                    over = 1 / (across * across + z * z)
                    step = -g / ((across * closing - along * z) * over - w)
                    t += step
                    # Bound on the angle's second derivative, half of which times step^2 remains of g after the step:
                    # at most 2 (speed / distance)^2 from the point's velocity, and |w_c|^2 r / distance from its
                    # acceleration, with x <= (1 + x^2) / 2.
                    bend = 2 * (along * along + closing * closing) * over
                    bend += (a * a + b * b + d * d) * (1 + (px * px + py * py + pz * pz) * over) / 2
                    stays = low < t < high and knot[j] <= t < knot[j + 1]
                    if perfect and stays and bend * step * step < w * CONVERGED_S:
                        across, ahead, found = across + along * step, ahead + closing * step, True
                        break
                    # This holds also where g or the step is NaN: the loop then ends without an answer.
                    if not (low < t < high):
                        t = (low + high) / 2
                if not found:
                    continue
                instant[c, k, fan] = guess = t
                last_across, last_ahead, last_error, warm = across, ahead, error[c, k, fan], perfect
                # The extent of the disc along the fan's direction of motion at p is its foreshortened diameter.
                s, nx, ny, nz = t - knot[j], normal[c, k, 0], normal[c, k, 1], normal[c, k, 2]
                x, y, z = turned(
                    segment[j, 6] * s,
                    segment[j, 7] * s,
                    segment[j, 8] * s,
                    segment[j, 9] * nx + segment[j, 10] * ny + segment[j, 11] * nz,
                    segment[j, 12] * nx + segment[j, 13] * ny + segment[j, 14] * nz,
                    segment[j, 15] * nx + segment[j, 16] * ny + segment[j, 17] * nz,
                )
                square = across * across + ahead * ahead
                slant = (x if fan == 0 else y) * ahead - z * across
                width[c, k, fan] = diameter * np.sqrt(max(0.0, square - slant * slant)) / square / w


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
        m = 0
        for fan in range(2):
            rise = int(np.rint(start_tick[c] + flash[fan] / tick))
            for k in range(flashed.shape[1]):
                if flashed[c, k, fan]:
                    m = _insert(m, k, rise, flash_width[fan], out_photodiode[c], out_rise[c], out_width[c])
        for fan in range(2):
            for k in range(flashed.shape[1]):
                if not np.isnan(instant[c, k, fan]) and not lost[c, k, fan]:
                    ticks = max(1, int(np.rint(width[c, k, fan] / tick)))
                    rise = int(np.rint(start_tick[c] + instant[c, k, fan] / tick - ticks / 2))
                    m = _insert(m, k, rise, ticks, out_photodiode[c], out_rise[c], out_width[c])
        for s in range(strays[c]):
            ticks = max(1, int(np.rint(stray[c, s, 2] / tick)))
            rise = int(np.rint(start_tick[c] + stray[c, s, 1] / tick))
            m = _insert(m, int(stray[c, s, 0]), rise, ticks, out_photodiode[c], out_rise[c], out_width[c])
        total[c] = m


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
