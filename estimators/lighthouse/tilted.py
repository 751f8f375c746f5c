"""The error terms of Lighthouse 2.0's tilted planes, which bend them other than (E) of `sweep` bends straight fans.

With across, up and ahead, az, r and tilt T as in `sweep`, n = sqrt(r^2 + up^2), and the factory's curve c, ogee o at
the phase omega, and gibbous g at the phase gamma,

    k    = up tan(T) / r                                    the ideal plane is met at az + asin(k)
    beta = asin(up / (n cos T))                             the angle from the rotor's axis of symmetry, in the plane
    w    = c + o cos(az + asin(k) + omega)
    S    = 0.0076069798 beta^2 + 5.3685e-6 beta^3 + 0.0028679863 beta^4 - 8.0108e-6 beta^5
    b    = az + asin(k - w S / (cos T + w S' sin T))
    measured = b - phase + g cos(b + gamma)                                                                        (T)

S is the manufacturer's series, as libsurvive has it: a plane is bent by up to 1 mrad although c and o are as large as
0.4, because S is 0.001 at 20 degrees. Bitcraze's firmware leaves c and o out. docs/lighthouse-2.md has the evidence
that they belong there, with these signs. A point that a plane never meets (|beta| or |k| beyond a right angle) is NaN.
"""

from typing import Any, NamedTuple

import numpy as np

from estimators.kernel import formula
from estimators.state import Vector

Number = Any
"""A float in a kernel, an array elsewhere."""

S2, S3, S4, S5 = 0.0076069798, 5.3685255e-06, 0.0028679863, -8.0108022e-06
"""Coefficients of the series S by power of beta."""
TILT_RAD = np.pi / 6
"""Nominal tilt of the planes against the rotor's axis [rad]: -TILT_RAD of the first one, +TILT_RAD of the second."""


class TiltedErrors(NamedTuple):
    """Systematic errors of one tilted plane, as in (T); all zero: a perfect plane. tilt_rad: off the nominal tilt."""

    phase_rad: float = 0.0
    tilt_rad: float = 0.0
    curve: float = 0.0
    gibbous_phase_rad: float = 0.0
    gibbous_magnitude: float = 0.0
    ogee_phase_rad: float = 0.0
    ogee_magnitude: float = 0.0


def from_station(
    phase: float,
    tilt: float,
    curve: float,
    gibbous_phase: float,
    gibbous_magnitude: float,
    ogee_phase: float,
    ogee_magnitude: float,
) -> TiltedErrors:
    """Return the errors of a plane from the values that a station sends, in libsurvive's files and Bitcraze's alike.

    Their tilt counts against the sense of ours.

    Args:
        phase: [rad].
        tilt: [rad], off the nominal one.
        curve: factor of S.
        gibbous_phase: [rad].
        gibbous_magnitude: [rad].
        ogee_phase: [rad].
        ogee_magnitude: factor of S.
    """
    return TiltedErrors(phase, -tilt, curve, gibbous_phase, gibbous_magnitude, ogee_phase, ogee_magnitude)


@formula
def _series(beta: Number) -> tuple[Number, Number]:
    """Return S and S' at beta [rad]."""
    series = beta * beta * (S2 + beta * (S3 + beta * (S4 + beta * S5)))
    slope = beta * (2 * S2 + beta * (3 * S3 + beta * (4 * S4 + beta * 5 * S5)))
    return series, slope


@formula
def tilted_angle(
    across: Number,
    up: Number,
    ahead: Number,
    tangent: Number,
    phase: Number,
    curve: Number,
    gibbous_phase: Number,
    gibbous_magnitude: Number,
    ogee_phase: Number,
    ogee_magnitude: Number,
) -> Number:
    """Return (T) [rad] of points.

    Args:
        across: [m], where the plane turns to at boresight.
        up: [m], along the rotor's axis.
        ahead: [m].
        tangent: tan T.
        phase: [rad], and the other terms as in `TiltedErrors`.
        curve: factor of S.
        gibbous_phase: [rad].
        gibbous_magnitude: [rad].
        ogee_phase: [rad].
        ogee_magnitude: factor of S.
    """
    square = across * across + ahead * ahead
    cosine = 1 / np.sqrt(1 + tangent * tangent)
    azimuth = np.arctan2(across, ahead)
    k = up * tangent / np.sqrt(square)
    beta = np.arcsin(up / (np.sqrt(square + up * up) * cosine))
    w = curve + ogee_magnitude * np.cos(azimuth + np.arcsin(k) + ogee_phase)
    series, slope = _series(beta)
    b = azimuth + np.arcsin(k - w * series / (cosine * (1 + w * slope * tangent)))
    return b - phase + gibbous_magnitude * np.cos(b + gibbous_phase)


@formula
def plain_angle(across: Number, up: Number, ahead: Number, tangent: Number, phase: Number) -> Number:
    """Return `tilted_angle` of a plane with no error but in phase and tilt, bit for bit.

    Args:
        across: [m], where the plane turns to at boresight.
        up: [m], along the rotor's axis.
        ahead: [m].
        tangent: tan T.
        phase: [rad].
    """
    k = up * tangent / np.sqrt(across * across + ahead * ahead)
    return np.arctan2(across, ahead) + np.arcsin(k) - phase


@formula
def plain_gradient(across: float, up: float, ahead: float, tangent: float) -> Vector:
    """Return the derivatives of `plain_angle` by across, up and ahead [rad/m], of the same arguments but the phase.

    Args:
        across: [m].
        up: [m].
        ahead: [m].
        tangent: tan T.
    """
    square = across * across + ahead * ahead
    r = np.sqrt(square)
    k = up * tangent / r
    steep = 1 / np.sqrt(1 - k * k)
    return (
        ahead / square + steep * (-k * across / square),
        steep * (tangent / r),
        -across / square + steep * (-k * ahead / square),
    )


@formula
def tilted_gradient(
    across: float,
    up: float,
    ahead: float,
    tangent: float,
    curve: float,
    gibbous_phase: float,
    gibbous_magnitude: float,
    ogee_phase: float,
    ogee_magnitude: float,
) -> Vector:
    """Return the derivatives of `tilted_angle` by across, up and ahead [rad/m], of the same arguments but the phase.

    Args:
        across: [m].
        up: [m].
        ahead: [m].
        tangent: tan T.
        curve: factor of S.
        gibbous_phase: [rad].
        gibbous_magnitude: [rad].
        ogee_phase: [rad].
        ogee_magnitude: factor of S.
    """
    square = across * across + ahead * ahead
    r, n = np.sqrt(square), np.sqrt(square + up * up)
    cosine = 1 / np.sqrt(1 + tangent * tangent)
    k, u = up * tangent / r, up / (n * cosine)
    beta, azimuth = np.arcsin(u), np.arctan2(across, ahead)
    turned = azimuth + np.arcsin(k) + ogee_phase
    w = curve + ogee_magnitude * np.cos(turned)
    series, slope = _series(beta)
    bend = 2 * S2 + beta * (6 * S3 + beta * (12 * S4 + beta * 20 * S5))
    divisor = cosine * (1 + w * slope * tangent)
    k2 = k - w * series / divisor
    # By beta and by az + asin(k), of w S / (cos T + w S' sin T).
    by_w = (series - w * series / divisor * cosine * slope * tangent) / divisor
    by_beta = w * (slope - series / divisor * cosine * w * bend * tangent) / divisor
    by_turned = -by_w * ogee_magnitude * np.sin(turned)
    steep, steep_2 = 1 / np.sqrt(1 - k * k), 1 / np.sqrt(1 - k2 * k2)
    of_beta = 1 / (np.sqrt(1 - u * u) * n * n * n * cosine)
    by_b = 1 - gibbous_magnitude * np.sin(azimuth + np.arcsin(k2) + gibbous_phase)
    # Along across, up and ahead: of az, of k, of beta.
    az_across, az_ahead = ahead / square, -across / square
    k_across, k_up, k_ahead = -k * across / square, tangent / r, -k * ahead / square
    beta_across, beta_up, beta_ahead = -up * across * of_beta, square * of_beta, -up * ahead * of_beta
    down_across = by_beta * beta_across + by_turned * (az_across + steep * k_across)
    down_up = by_beta * beta_up + by_turned * steep * k_up
    down_ahead = by_beta * beta_ahead + by_turned * (az_ahead + steep * k_ahead)
    return (
        by_b * (az_across + steep_2 * (k_across - down_across)),
        by_b * steep_2 * (k_up - down_up),
        by_b * (az_ahead + steep_2 * (k_ahead - down_ahead)),
    )
