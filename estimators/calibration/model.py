"""The model that a calibration fits: the measured angle (E) of `estimators.lighthouse.sweep` with its derivatives.

Photodiode w_p of a craft with pose R = R_l_b, t at the epoch is at p = Exp([w]x tau) R w_p + t + v tau at its angle's
own instant tau, lighthouse frame. The gibbous term is written linearly, so that it has a slope where it vanishes:

    measured = b + s sin b + c cos b + curve other_angle^2,   s = magnitude cos(gibbous phase), c = magnitude sin(...)
    b        = a - phase - asin(other tan(tilt) / r)                                                            (E)

A fan is therefore five numbers here, in this order: phase, tilt, curve, s, c.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.lighthouse.sweep import FanErrors, FanPair

FAN_PARAMETERS = ("phase_rad", "tilt_rad", "curve", "gibbous_sine", "gibbous_cosine")
"""The numbers of one fan, in order."""


class Slopes(NamedTuple):
    """M predicted angles from boresight (M,) [rad], and their derivatives.

    point: (M, 3), by the photodiode's place in the lighthouse frame. fan: (M, 5), by the numbers of the angle's fan.
    """

    angle: Floats
    point: Floats
    fan: Floats


def linear_fans(errors: FanPair) -> Floats:
    """Return the numbers (2, 5) of fans X and Y from their systematic errors."""
    return np.array(
        [
            (
                e.phase_rad,
                e.tilt_rad,
                e.curve,
                e.gibbous_magnitude * np.cos(e.gibbous_phase_rad),
                e.gibbous_magnitude * np.sin(e.gibbous_phase_rad),
            )
            for e in errors
        ]
    )


def fan_errors(fans: Floats) -> FanPair:
    """Return the systematic errors of both fans from their numbers (2, 5); the gibbous magnitude is not negative."""
    x, y = (
        FanErrors(float(f[0]), float(f[1]), float(f[2]), float(np.arctan2(f[4], f[3])), float(np.hypot(f[3], f[4])))
        for f in fans
    )
    return x, y


def gibbous_sigma(sine: float, cosine: float, covariance: Floats) -> tuple[float, float]:
    """Return the standard deviations of the gibbous phase [rad] and magnitude, to first order.

    A phase that is not known at all has pi / sqrt(3), the deviation of a uniform one.

    Args:
        sine: s.
        cosine: c.
        covariance: (2, 2), of s and c.
    """
    magnitude = np.hypot(sine, cosine)
    if magnitude == 0:
        return np.pi / np.sqrt(3), float(np.sqrt(np.trace(covariance) / 2))
    by_phase = np.array([-cosine, sine]) / magnitude**2
    by_magnitude = np.array([sine, cosine]) / magnitude
    phase = float(np.sqrt(by_phase @ covariance @ by_phase))
    return min(phase, np.pi / np.sqrt(3)), float(np.sqrt(by_magnitude @ covariance @ by_magnitude))


def predict(point: Floats, fan: Ints, fans: Floats) -> Slopes:
    """Return the angles that fans measure of points, with slopes; NaN where a fan never gets there.

    Args:
        point: (M, 3) [m], in front (z > 0).
        fan: (M,), 0 for X and 1 for Y.
        fans: (2, 5), the numbers of both fans.
    """
    row = np.arange(len(point))
    along, other, z = point[row, fan], point[row, 1 - fan], np.where(point[:, 2] > 0, point[:, 2], np.nan)
    phase, tilt, curve, sine, cosine = fans[fan].T
    square = along**2 + z**2
    r = np.sqrt(square)
    tangent = np.tan(tilt)
    argument = other * tangent / r
    argument = np.where(np.abs(argument) < 1, argument, np.nan)
    slope = 1 / np.sqrt(1 - argument**2)
    b = -np.arctan2(along, z) - phase - np.arcsin(argument)
    sin_b, cos_b = np.sin(b), np.cos(b)
    other_angle = np.arctan2(other, z)
    by_b = 1 + sine * cos_b - cosine * sin_b

    out = Slopes(
        b + sine * sin_b + cosine * cos_b + curve * other_angle**2, np.empty((len(point), 3)), np.empty((len(point), 5))
    )
    bend = 2 * curve * other_angle / (other**2 + z**2)
    out.point[row, fan] = by_b * (-z / square + slope * argument * along / square)
    out.point[row, 1 - fan] = -by_b * slope * tangent / r + bend * z
    out.point[:, 2] = by_b * (along / square + slope * argument * z / square) - bend * other
    out.fan[:, 0] = -by_b
    out.fan[:, 1] = -by_b * slope * other * (1 + tangent**2) / r
    out.fan[:, 2] = other_angle**2
    out.fan[:, 3] = sin_b
    out.fan[:, 4] = cos_b
    return out


def place(
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    angular_rate: Floats,
    velocity: Floats,
    offset_s: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Return the photodiodes at their angles' instants, p (M, 3), Exp([w]x tau) (M, 3, 3) and the arms R w_p (M, 3).

    Args:
        point_m: (M, 3) [m], photodiodes in the body frame.
        rotation: (M, 3, 3) R_l_b at the epoch.
        position: (M, 3) [m].
        angular_rate: (M, 3) [rad/s].
        velocity: (M, 3) [m/s].
        offset_s: (M,) [s], tau.
    """
    turn = rot.exp(angular_rate * offset_s[:, None])
    arm = np.einsum("mij,mj->mi", rotation, point_m)
    return np.einsum("mij,mj->mi", turn, arm) + position + velocity * offset_s[:, None], turn, arm
