"""Kernels of the lighthouse: the instant at which a turning fan hits a moving photodiode, and the pulses in order.

Lighthouse frame. Instants are seconds after the start of the period. Between two knots a craft moves as in MuJoCo: its
origin along a straight line, its attitude at constant rate (slerp). The crossing is the root of

    g(t) = pi/2 + measured_angle(p(t)) + error - w (t - t_0)

found by secant steps, the first with the rotor's own slope -w, within a bracket that the steps may not leave.
"""

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.sweep import measured_angle

CONVERGED_S = 1e-13
"""The root is found when the rotor needs less than this for the angle that is left [s]."""
_ROUNDS = 60


@kernel
def rotate(q: Floats, v: Floats, out: Floats) -> None:
    """Write R(q) v into `out` (3,): quaternion (4,) wxyz, vector (3,)."""
    # t = 2 u x v; R v = v + w t + u x t, with u the vector part.
    tx = 2 * (q[2] * v[2] - q[3] * v[1])
    ty = 2 * (q[3] * v[0] - q[1] * v[2])
    tz = 2 * (q[1] * v[1] - q[2] * v[0])
    out[0] = v[0] + q[0] * tx + q[2] * tz - q[3] * ty
    out[1] = v[1] + q[0] * ty + q[3] * tx - q[1] * tz
    out[2] = v[2] + q[0] * tz + q[1] * ty - q[2] * tx


@kernel
def interpolate(
    t: float, knot: Floats, position: Floats, quaternion: Floats, craft: int, origin: Floats, q: Floats
) -> None:
    """Write one craft's pose at instant `t` into `origin` (3,) and `q` (4,) wxyz, from knots (n + 1, C, ...)."""
    j = 0
    while j < len(knot) - 2 and t >= knot[j + 1]:
        j += 1
    s = (t - knot[j]) / (knot[j + 1] - knot[j])
    for i in range(3):
        origin[i] = (1 - s) * position[j, craft, i] + s * position[j + 1, craft, i]
    cosine = 0.0
    for i in range(4):
        cosine += quaternion[j, craft, i] * quaternion[j + 1, craft, i]
    # q and -q are the same attitude: take the shorter way round.
    sign = -1.0 if cosine < 0 else 1.0
    angle = np.arccos(min(abs(cosine), 1.0))
    before, after = 1 - s, s
    # Below a microradian a chord and an arc differ by less than 1e-12 of it.
    if angle > 1e-6:
        before, after = np.sin((1 - s) * angle) / np.sin(angle), np.sin(s * angle) / np.sin(angle)
    for i in range(4):
        q[i] = before * quaternion[j, craft, i] + sign * after * quaternion[j + 1, craft, i]


@kernel
def cross_into(
    knot: Floats,
    position: Floats,
    quaternion: Floats,
    point: Floats,
    normal: Floats,
    lit: Bools,
    error: Floats,
    fan_errors: Floats,
    period: float,
    diameter: float,
    instant: Floats,
    width: Floats,
) -> None:
    """Write crossing instants and sweep widths (C, K, 2) [s] of the lit photodiodes; NaN where a fan finds none.

    knot (n + 1,) [s]; position (n + 1, C, 3); quaternion (n + 1, C, 4); point, normal (C, K, 3) in the body frame; lit,
    error [rad] (C, K, 2); fan_errors of `kernel_errors`; period [s]; diameter of a photodiode's face [m].
    """
    w = 2 * np.pi / period
    origin, q, p, n = np.empty(3), np.empty(4), np.empty(3), np.empty(3)
    for c in range(lit.shape[0]):
        for k in range(lit.shape[1]):
            for fan in range(2):
                instant[c, k, fan] = width[c, k, fan] = np.nan
                if not lit[c, k, fan]:
                    continue
                start = fan * period / 2
                low, high = start, start + period / 2
                t = start + period / 4
                last_t, last_g = t, 0.0
                for r in range(_ROUNDS):
                    interpolate(t, knot, position, quaternion, c, origin, q)
                    rotate(q, point[c, k], p)
                    for i in range(3):
                        p[i] += origin[i]
                    angle = np.pi / 2 + measured_angle(p[0], p[1], p[2], fan, fan_errors)
                    g = angle + error[c, k, fan] - w * (t - start)
                    if abs(g) <= w * CONVERGED_S:
                        instant[c, k, fan] = t
                        break
                    if g > 0:
                        low = t
                    else:
                        high = t
                    slope = -w if r == 0 else (g - last_g) / (t - last_t)
                    last_t, last_g = t, g
                    t -= g / slope
                    # Also where g or the step is NaN: the loop then ends without an answer.
                    if not (low < t < high):
                        t = (low + high) / 2
                if np.isnan(instant[c, k, fan]):
                    continue
                # The fan's own direction of motion at p; a disc's extent along it is its diameter foreshortened.
                rotate(q, normal[c, k], n)
                axis_distance = np.sqrt(p[fan] * p[fan] + p[2] * p[2])
                along = (n[fan] * p[2] - n[2] * p[fan]) / axis_distance
                width[c, k, fan] = diameter * np.sqrt(max(0.0, 1 - along * along)) / axis_distance / w


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
    """Write every craft's pulses in order of their rise (then as found: flashes, sweeps, strays) into rows of `out_*`.

    flashed (C, K, 2): sees the flash; instant, width (C, K, 2) [s], NaN: no sweep; lost (C, K, 2); strays (C,) of
    stray (C, S, 3): photodiode (rounded down), instant, width [s]; flash (2,) [s]; flash_width (2,) [ticks];
    start_tick (C,): the period's start on the craft's clock, not a whole number; tick [s].
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
    """Insert a pulse into the first `count` of a row in order of rise; the new count."""
    i = count
    while i > 0 and rises[i - 1] > rise:
        photodiodes[i], rises[i], widths[i] = photodiodes[i - 1], rises[i - 1], widths[i - 1]
        i -= 1
    photodiodes[i], rises[i], widths[i] = photodiode, rise, width
    return count + 1
