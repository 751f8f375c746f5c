"""Correction of a state by a large error, in coordinates in which what the light leaves open is straight.

With an error x = (d, dw, dp, dv), R_true = Exp([d]x) R and truth minus estimate for the rest, the plain correction
p + dp is right to first order in d. What one photodiode leaves open is a turn about itself, by any angle: to first
order it would leave its place, which the light knows to a tenth of a millimetre, and a filter would see in the misfit
what it cannot know. In the coordinates of the pivot, q = p + a and q* = v + w x a with a = R b,

    (d, dw, dq, dq*),   dq = dp + d x a,   dq* = dv + dw x a + w x (d x a)

those turns are straight lines. The correction is therefore, with a' = Exp([d]x) a and w' = w + dw,

    R' = Exp([d]x) R,   p' = q + dq - a',   v' = q* + dq* - w' x a'

and the error of the corrected state, which the covariance is of, is that of the pivot again, seen from there (the
factor J_l(d) on what remains of the attitude is left out, as everywhere):

    dp' = dp + (a' - a) x d,   dv' = dv + (a' - a) x dw + w x (d x a) - w' x (d x a')                 (shear)

Two photodiodes tell where the line between them is, which way it appears to lie and how long, and leave a turn about
the line open, and its tilt out of the image with its distance. With the pivot's direction n from the station and its
distance r, the line's direction e = R l / |l|, sin alpha = n.e, k = e x n / cos alpha and the rate n* of n, the
straight coordinates are those of the turn about n, then k, then e,

    d = psi n + alpha k + phi e,   w - n x n* = psi* n + alpha* k + phi* e

whose rates change by dw less alpha* psi n x k + phi* (psi n x e + alpha k x e); and along n, in the place of the
distance, the logarithm of the apparent length, whose sign is turned, and its rate

    L = ln r - ln cos alpha,   L* = r*/r + alpha* tan alpha

The turn is made by the three angles one after the other, r' and r*' are those of L + dL and L* + dL* at the turned
line, and the covariance's errors are carried over in these coordinates. n and n* stay as they are.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.rotation import exp_into, multiply_into
from estimators.state import STATES

WIDE_RAD = 0.01
"""Standard deviation of the attitude [rad], root of the trace, beyond which the shear matters: for an arm of 0.1 m, the
square of it bends the place by 10 um."""
PIVOT = 9
"""Numbers of a pivot: b and l [m], body frame, l zero where not two photodiodes are lit; the station's place [m]."""
_SPAN = 19
"""Numbers of the line between two photodiodes: n, k, e and n* (3 each), r, r*, sine and cosine of alpha, and the rates
psi*, alpha* and phi*."""
_RANGE, _AWAY, _SINE, _COSINE, _PSI, _ALPHA, _PHI = 12, 13, 14, 15, 16, 17, 18
"""Places of the numbers of a line behind its vectors."""
ARMS = 13 + 2 * _SPAN
"""Numbers that describe a turn about a pivot: a, a', w and w'; whether there are two photodiodes; their line before and
after."""
END_ON = 0.03
"""Square of the sine between the line of two photodiodes and the line of sight below which its length tells too
little of its distance."""


@kernel
def turn_about(
    rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, x: Floats, pivot: Floats, arms: Floats
) -> None:
    """Move one craft's state by the error x, in place.

    Args:
        rotation: (3, 3).
        angular_rate: (3,) [rad/s].
        position: (3,) [m].
        velocity: (3,) [m/s].
        x: (12,), the error.
        pivot: (PIVOT,).
        arms: (ARMS,), receives a and a' [m], w and w' [rad/s] and the line's numbers, for the shear.
    """
    turn, turned, bent = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:12]
    for i in range(3):
        a[i] = rotation[i, 0] * pivot[0] + rotation[i, 1] * pivot[1] + rotation[i, 2] * pivot[2]
        w[i] = angular_rate[i]
    two = pivot[3] != 0.0 or pivot[4] != 0.0 or pivot[5] != 0.0
    two = two and _turn_line(rotation, angular_rate, position, velocity, x, pivot, arms)
    arms[12] = 1.0 if two else 0.0
    if two:
        return
    exp_into(x[:3], turn)
    multiply_into(turn, rotation, turned)
    for i in range(3):
        rate[i] = angular_rate[i] + x[3 + i]
        after[i] = turn[i, 0] * a[0] + turn[i, 1] * a[1] + turn[i, 2] * a[2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        bent[i] = x[j] * a[k] - x[k] * a[j]
        position[i] += x[6 + i] + a[i] + bent[i] - after[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # w x a + dw x a + w x (d x a) - w' x a'
        change = rate[j] * a[k] - rate[k] * a[j] + w[j] * bent[k] - w[k] * bent[j]
        velocity[i] += x[9 + i] + change - (rate[j] * after[k] - rate[k] * after[j])
        angular_rate[i] = rate[i]
    rotation[:] = turned


@kernel
def _turn_line(
    rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, x: Floats, pivot: Floats, arms: Floats
) -> bool:
    """Move a state of which two photodiodes are lit by the error x, in place; False where their line is seen nearly
    end-on: nothing is moved then.

    Args:
        rotation: (3, 3).
        angular_rate: (3,) [rad/s].
        position: (3,) [m].
        velocity: (3,) [m/s].
        x: (12,), the error.
        pivot: (PIVOT,).
        arms: (ARMS,), with a and w; receives a', w' and both lines.
    """
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:12]
    line, then = arms[13 : 13 + _SPAN], arms[13 + _SPAN :]
    if not _line_into(rotation, w, position, velocity, a, pivot, line):
        return False
    step, axis = np.empty(STATES + 2), np.empty(3)
    _straight_into(x, a, w, line, step)
    turned, other, turn = rotation.copy(), np.empty((3, 3)), np.empty((3, 3))
    for which in range(3):
        # About e first, then k, then n: the former leave the latter in their places.
        for i in range(3):
            axis[i] = line[6 - 3 * which + i] * step[2 - which]
        exp_into(axis, turn)
        multiply_into(turn, turned, other)
        turned[:] = other
    moved, quickened = 0.0, 0.0
    for i in range(3):
        moved += line[i] * step[6 + i]
        quickened += line[i] * step[9 + i]
    place, speed, zero = np.empty(3), np.empty(3), np.zeros(3)
    for i in range(3):
        place[i] = pivot[6 + i] + (line[_RANGE] + moved) * line[i]
        speed[i] = (line[_AWAY] + quickened) * line[i] + (line[_RANGE] + moved) * line[9 + i]
    if not _line_into(turned, zero, place, speed, zero, pivot, then):
        return False
    for i in range(3):
        then[_PSI + i] = line[_PSI + i] + step[3 + i]
    far = line[_RANGE] * np.exp(step[STATES]) * then[_COSINE] / line[_COSINE]
    rise = line[_AWAY] / line[_RANGE] + line[_ALPHA] * line[_SINE] / line[_COSINE] + step[STATES + 1]
    toward = far * (rise - then[_ALPHA] * then[_SINE] / then[_COSINE])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rate[i] = then[_PSI] * then[i] + then[_ALPHA] * then[3 + i] + then[_PHI] * then[6 + i]
        rate[i] += then[j] * then[9 + k] - then[k] * then[9 + j]
        after[i] = turned[i, 0] * pivot[0] + turned[i, 1] * pivot[1] + turned[i, 2] * pivot[2]
        speed[i] = velocity[i] + w[j] * a[k] - w[k] * a[j] + step[9 + i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        position[i] += a[i] + step[6 + i] + (far - then[_RANGE]) * line[i] - after[i]
        velocity[i] = speed[i] + (toward - then[_AWAY]) * line[i] + (far - then[_RANGE]) * line[9 + i]
        velocity[i] -= rate[j] * after[k] - rate[k] * after[j]
        angular_rate[i] = rate[i]
    then[_RANGE], then[_AWAY] = far, toward
    rotation[:] = turned
    return True


@kernel
def _line_into(
    rotation: Floats, w: Floats, position: Floats, velocity: Floats, a: Floats, pivot: Floats, out: Floats
) -> bool:
    """Write the line between two photodiodes; False where it is seen nearly end-on.

    Args:
        rotation: (3, 3).
        w: (3,) [rad/s].
        position: (3,) [m].
        velocity: (3,) [m/s].
        a: (3,) [m], R b.
        pivot: (PIVOT,).
        out: (_SPAN,), receives it.
    """
    n, k, e, across = out[0:3], out[3:6], out[6:9], out[9:12]
    square, length = 0.0, 0.0
    for i in range(3):
        n[i] = position[i] + a[i] - pivot[6 + i]
        e[i] = rotation[i, 0] * pivot[3] + rotation[i, 1] * pivot[4] + rotation[i, 2] * pivot[5]
        square += n[i] * n[i]
        length += e[i] * e[i]
    if not square > 0.0:
        return False
    r, length, sine, away = np.sqrt(square), np.sqrt(length), 0.0, 0.0
    for i in range(3):
        n[i], e[i] = n[i] / r, e[i] / length
        sine += n[i] * e[i]
    cosine = np.sqrt(max(1.0 - sine * sine, 0.0))
    if not cosine * cosine > END_ON:
        return False
    for i in range(3):
        j, h = (i + 1) % 3, (i + 2) % 3
        k[i] = (e[j] * n[h] - e[h] * n[j]) / cosine
        across[i] = velocity[i] + w[j] * a[h] - w[h] * a[j]
        away += n[i] * across[i]
    own = np.empty(3)
    for i in range(3):
        across[i] = (across[i] - away * n[i]) / r
    for i in range(3):
        j, h = (i + 1) % 3, (i + 2) % 3
        own[i] = w[i] - (n[j] * across[h] - n[h] * across[j])
    out[_RANGE], out[_AWAY], out[_SINE], out[_COSINE] = r, away, sine, cosine
    _angles_into(own, out, out[_PSI:])
    return True


@kernel
def _angles_into(turn: Floats, line: Floats, out: Floats) -> None:
    """Write the parts of a turn (3,) about n, k and e of a line, (3,)."""
    about, along, out[1] = 0.0, 0.0, 0.0
    for i in range(3):
        about += turn[i] * line[i]
        along += turn[i] * line[6 + i]
        out[1] += turn[i] * line[3 + i]
    sine, square = line[_SINE], line[_COSINE] * line[_COSINE]
    out[0], out[2] = (about - sine * along) / square, (along - sine * about) / square


@kernel
def _swept(i: int, psi: float, alpha: float, line: Floats) -> float:
    """Return component i of what small turns psi and alpha make of alpha* k + phi* e."""
    j, h = (i + 1) % 3, (i + 2) % 3
    n, k, e = line[0:3], line[3:6], line[6:9]
    value: float = line[_ALPHA] * psi * (n[j] * k[h] - n[h] * k[j])
    value += line[_PHI] * (psi * (n[j] * e[h] - n[h] * e[j]) + alpha * (k[j] * e[h] - k[h] * e[j]))
    return value


@kernel
def _straight_into(x: Floats, a: Floats, w: Floats, line: Floats, out: Floats) -> None:
    """Write an error in the straight coordinates: the three angles and their rates, dq, dq*, dL and dL*.

    Args:
        x: (12,), the error.
        a: (3,) [m].
        w: (3,) [rad/s].
        line: (_SPAN,).
        out: (14,), receives them.
    """
    _angles_into(x[:3], line, out[0:3])
    change, bent = np.empty(3), np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        change[i] = x[3 + i] - _swept(i, out[0], out[1], line)
        bent[i] = x[j] * a[k] - x[k] * a[j]
    _angles_into(change, line, out[3:6])
    moved, quickened = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[6 + i] = x[6 + i] + bent[i]
        out[9 + i] = x[9 + i] + x[3 + j] * a[k] - x[3 + k] * a[j] + w[j] * bent[k] - w[k] * bent[j]
        moved += line[i] * out[6 + i]
        quickened += line[i] * out[9 + i]
    r, tangent = line[_RANGE], line[_SINE] / line[_COSINE]
    out[STATES] = moved / r + tangent * out[1]
    out[STATES + 1] = quickened / r - line[_AWAY] / (r * r) * moved
    out[STATES + 1] += tangent * out[4] + line[_ALPHA] * out[1] / (line[_COSINE] * line[_COSINE])


@kernel
def _carried_into(x: Floats, arms: Floats, out: Floats) -> None:
    """Write the error (12,) of the moved state that an error (12,) has become; arms: (ARMS,), of `turn_about`."""
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:12]
    line, then = arms[13 : 13 + _SPAN], arms[13 + _SPAN :]
    step, bent = np.empty(STATES + 2), np.empty(3)
    _straight_into(x, a, w, line, step)
    tangent, moved, quickened = then[_SINE] / then[_COSINE], 0.0, 0.0
    for i in range(3):
        moved += then[i] * step[6 + i]
        quickened += then[i] * step[9 + i]
        out[i] = step[0] * then[i] + step[1] * then[3 + i] + step[2] * then[6 + i]
        out[3 + i] = step[3] * then[i] + step[4] * then[3 + i] + step[5] * then[6 + i]
        out[3 + i] += _swept(i, step[0], step[1], then)
    far = then[_RANGE]
    place = far * (step[STATES] - tangent * step[1])
    quicker = step[STATES + 1] - tangent * step[4] - then[_ALPHA] * step[1] / (then[_COSINE] * then[_COSINE])
    speed = far * quicker + then[_AWAY] / far * place
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        bent[i] = out[j] * after[k] - out[k] * after[j]
        out[6 + i] = step[6 + i] + (place - moved) * then[i] - bent[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[9 + i] = step[9 + i] + (speed - quickened) * then[i] + (place - far / line[_RANGE] * moved) * then[9 + i]
        out[9 + i] -= out[3 + j] * after[k] - out[3 + k] * after[j] + rate[j] * bent[k] - rate[k] * bent[j]


@kernel
def is_wide(covariance: Floats) -> bool:
    """Return whether the attitude of a covariance (12, 12) is so wide that the shear matters."""
    wide: bool = not (covariance[0, 0] + covariance[1, 1] + covariance[2, 2] < WIDE_RAD * WIDE_RAD)
    return wide


@kernel
def shear_into(arms: Floats, out: Floats) -> None:
    """Write the matrix of (shear) into `out` (12, 12); arms: (ARMS,), of `turn_about`."""
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:12]
    if arms[12] != 0.0:
        x, carried = np.zeros(STATES), np.empty(STATES)
        for i in range(STATES):
            x[i] = 1.0
            _carried_into(x, arms, carried)
            x[i] = 0.0
            for k in range(STATES):
                out[k, i] = carried[k]
        return
    out[:] = 0.0
    for i in range(STATES):
        out[i, i] = 1.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for first, column in ((6, 0), (9, 3)):
            out[first + i, column + j] = -(after[k] - a[k])
            out[first + i, column + k] = after[j] - a[j]
    # w x (d x a) = (w.a I - a w^T) d, and the same of w' and a' taken off.
    inner, outer = 0.0, 0.0
    for i in range(3):
        inner += w[i] * a[i]
        outer += rate[i] * after[i]
    for i in range(3):
        for m in range(3):
            out[9 + i, m] = rate[m] * after[i] - w[m] * a[i]
        out[9 + i, i] += inner - outer


@kernel
def shear(covariance: Floats, arms: Floats) -> None:
    """Refer the covariance (12, 12) of an error to the state that has been moved, in place; arms: of `turn_about`."""
    s, half = np.empty((STATES, STATES)), np.empty((STATES, STATES))
    shear_into(arms, s)
    for i in range(STATES):
        for j in range(STATES):
            total = 0.0
            for k in range(STATES):
                total += s[i, k] * covariance[k, j]
            half[i, j] = total
    for i in range(STATES):
        for j in range(i + 1):
            total = 0.0
            for k in range(STATES):
                total += half[i, k] * s[j, k]
            covariance[i, j] = covariance[j, i] = total
