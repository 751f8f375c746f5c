"""Correction of a state by a large error that turns the body about its pivot, a point of it, not its origin.

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
"""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.rotation import exp_into, multiply_into
from estimators.state import STATES

WIDE_RAD = 0.01
"""Standard deviation of the attitude [rad], root of the trace, beyond which the shear matters: for an arm of 0.1 m, the
square of it bends the place by 10 um."""
ARMS = 12
"""Numbers that describe a turn about a pivot: a, a', w and w'."""


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
        pivot: (3,) [m], b in the body frame.
        arms: (ARMS,), receives a and a' [m], w and w' [rad/s], for the shear.
    """
    turn, turned, bent = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:]
    exp_into(x[:3], turn)
    multiply_into(turn, rotation, turned)
    for i in range(3):
        a[i] = rotation[i, 0] * pivot[0] + rotation[i, 1] * pivot[1] + rotation[i, 2] * pivot[2]
        w[i], rate[i] = angular_rate[i], angular_rate[i] + x[3 + i]
    for i in range(3):
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
def is_wide(covariance: Floats) -> bool:
    """Return whether the attitude of a covariance (12, 12) is so wide that the shear matters."""
    wide: bool = not (covariance[0, 0] + covariance[1, 1] + covariance[2, 2] < WIDE_RAD * WIDE_RAD)
    return wide


@kernel
def shear_into(arms: Floats, out: Floats) -> None:
    """Write the matrix of (shear) into `out` (12, 12); arms: (ARMS,), of `turn_about`."""
    a, after, w, rate = arms[:3], arms[3:6], arms[6:9], arms[9:]
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
            for k in range(i + 1):
                total += s[i, k] * covariance[k, j]
            half[i, j] = total
    for i in range(STATES):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += half[i, k] * s[j, k]
            covariance[i, j] = covariance[j, i] = total
