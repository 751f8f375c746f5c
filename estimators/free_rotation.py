"""Rotation of a body without torque: Euler's equation over one step, and its derivatives.

In the frame in which the body turns, with the inertia L = R I R^T, I in the body frame,

    w' = f = -L^-1 (w x L w),   R' = [w]x R

integrated by the classic Runge-Kutta method in (t, w), R = Exp([t]x) R_0, t' = w - t x w / 2 + t x (t x w) / 12. A step
of a sixtieth of a second at 22 degrees a second errs by 1e-12 rad/s; with f held constant over it, 1e-6 rad/s every
step and always the same way, which a filter that trusts the motion for seconds takes for motion of its own.

An error (d, dw) of attitude and rate changes f by A_d d + A_w dw,

    A_w = -L^-1 ([w]x L - [L w]x),   A_d = -[f]x + A_w [w]x

so that beyond its way at constant rates the error becomes M (d, dw),

    M = I + (dt^2 / 2, dt)^T [A_d A_w] N + [f]x dt^2 / 2        the last term in the attitude's part

Here A is that of the middle of the step, and N leads from the error at constant
rates there: (d - (w x d + dw) dt / 2, dw + (A_d d + A_w dw) dt / 2).
Both f and A are zero for a body whose inertia is the same about every axis.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import exp_into, log_into, multiply_into


class FreeTurns(NamedTuple):
    """Motion of C bodies beyond turning at their present rates: zero, and the identity, where masked out.

    turn: (C, 3) [rad], R <- Exp([turn]x) R after the turn at a constant rate. rate: (C, 3) [rad/s], change of the
    angular rate. coupling: (C, 6, 6), M.
    """

    turn: Floats
    rate: Floats
    coupling: Floats


def free_turns(
    mask: Bools, rotation: Floats, angular_rate: Floats, inertia: Floats, inverse: Floats, dt: float
) -> FreeTurns:
    """Return the motion of bodies without torque over one step.

    Args:
        mask: (C,), the bodies concerned.
        rotation: (C, 3, 3), at the beginning.
        angular_rate: (C, 3) [rad/s], at the beginning.
        inertia: (C, 3, 3) [kg m^2], body frame.
        inverse: (C, 3, 3) [1 / (kg m^2)], its inverse.
        dt: the step [s].
    """
    turn, rate = np.zeros((2, len(mask), 3))
    out = FreeTurns(turn, rate, np.tile(np.eye(6), (len(mask), 1, 1)))
    _step_all(mask, rotation, angular_rate, inertia, inverse, dt, out)
    return out


@kernel
def _cross(a: Floats, b: Floats, out: Floats) -> None:
    """Write a x b into `out` (3,), which may be neither of them."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]


@kernel
def _times(a: Floats, b: Floats, out: Floats) -> None:
    """Write the product of a matrix (3, 3) and a vector (3,) into `out` (3,)."""
    for i in range(3):
        out[i] = a[i, 0] * b[0] + a[i, 1] * b[1] + a[i, 2] * b[2]


@kernel
def _skew_into(a: Floats, out: Floats) -> None:
    """Write [a]x into `out` (3, 3)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, i] = 0.0
        out[j, k], out[k, j] = -a[i], a[i]


@kernel
def _turned(rotation: Floats, inertia: Floats, out: Floats) -> None:
    """Write R I R^T into `out` (3, 3)."""
    half = np.empty((3, 3))
    multiply_into(rotation, inertia, half)
    multiply_into(half, rotation.T, out)


@kernel
def _slope(
    start: Floats, turn: Floats, rate: Floats, inertia: Floats, inverse: Floats, turning: Floats, out: Floats
) -> None:
    """Write t' and w' of one body.

    Args:
        start: (3, 3), R_0.
        turn: (3,) [rad], t.
        rate: (3,) [rad/s], w.
        inertia: (3, 3), I.
        inverse: (3, 3), its inverse.
        turning: (3,) [rad/s], receives t'.
        out: (3,) [rad/s^2], receives w'.
    """
    moved, rotation, tensor = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    once, twice = np.empty(3), np.empty(3)
    exp_into(turn, moved)
    multiply_into(moved, start, rotation)
    _turned(rotation, inertia, tensor)
    _times(tensor, rate, once)
    _cross(once, rate, twice)
    _turned(rotation, inverse, tensor)
    _times(tensor, twice, out)
    _cross(turn, rate, once)
    _cross(turn, once, twice)
    for i in range(3):
        turning[i] = rate[i] - once[i] / 2 + twice[i] / 12


@kernel
def _coupling_into(rotation: Floats, rate: Floats, inertia: Floats, inverse: Floats, dt: float, out: Floats) -> None:
    """Write M (6, 6) of one body.

    Args:
        rotation: (3, 3), R in the middle of the step.
        rate: (3,) [rad/s], w there.
        inertia: (3, 3), I.
        inverse: (3, 3), its inverse.
        dt: the step [s].
        out: (6, 6), the identity, receives M.
    """
    tensor, back, spin, skew = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    momentum, torque, gain = np.empty(3), np.empty(3), np.empty(3)
    by_rate, by_turn = np.empty((3, 3)), np.empty((3, 3))
    _turned(rotation, inertia, tensor)
    _turned(rotation, inverse, back)
    _times(tensor, rate, momentum)
    _cross(momentum, rate, torque)
    _times(back, torque, gain)
    _skew_into(rate, spin)
    multiply_into(spin, tensor, by_turn)
    _skew_into(momentum, skew)
    for i in range(3):
        for j in range(3):
            skew[i, j] -= by_turn[i, j]
    multiply_into(back, skew, by_rate)
    multiply_into(by_rate, spin, by_turn)
    _skew_into(gain, skew)
    for i in range(3):
        for j in range(3):
            by_turn[i, j] -= skew[i, j]
    multiply_into(by_turn, spin, skew)
    multiply_into(by_rate, by_turn, tensor)
    multiply_into(by_rate, by_rate, back)
    for i in range(3):
        for j in range(3):
            back_turn = by_turn[i, j] + (tensor[i, j] - skew[i, j]) * dt / 2
            back_rate = by_rate[i, j] + (back[i, j] - by_turn[i, j]) * dt / 2
            for column, change in ((j, back_turn), (3 + j, back_rate)):
                out[i, column] += change * dt * dt / 2
                out[3 + i, column] += change * dt
    for i in range(3):  # the error of the attitude goes along with the turn itself, by [f]x dt^2 / 2
        j, k = (i + 1) % 3, (i + 2) % 3
        out[j, k] -= gain[i] * dt * dt / 2
        out[k, j] += gain[i] * dt * dt / 2


@kernel
def _step_all(
    mask: Bools, rotation: Floats, angular_rate: Floats, inertia: Floats, inverse: Floats, dt: float, out: FreeTurns
) -> None:
    """Write the motion of the bodies of the mask."""
    turn, rate, whole = np.empty(3), np.empty(3), np.empty((2, 3))
    slope, before, after, end = np.empty((2, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(mask)):
        if not mask[c]:
            continue
        w = angular_rate[c]
        slope[:], whole[:] = 0.0, 0.0
        for part, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
            for i in range(3):
                turn[i], rate[i] = part * dt * slope[0, i], w[i] + part * dt * slope[1, i]
            _slope(rotation[c], turn, rate, inertia[c], inverse[c], slope[0], slope[1])
            for k in range(2):
                for i in range(3):
                    whole[k, i] += weight * dt / 6 * slope[k, i]
        exp_into(whole[0], after)
        for i in range(3):
            turn[i], rate[i] = w[i] * dt, w[i] + whole[1, i] / 2
            out.rate[c, i] = whole[1, i]
        exp_into(turn, before)
        multiply_into(after, before.T, end)
        log_into(end, out.turn[c])
        for i in range(3):
            turn[i] = whole[0, i] / 2
        exp_into(turn, after)
        multiply_into(after, rotation[c], end)
        _coupling_into(end, rate, inertia[c], inverse[c], dt, out.coupling[c])
