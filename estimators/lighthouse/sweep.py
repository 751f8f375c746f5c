"""Sweep angles: what the turning fans of a station measure of a point, ideally and with systematic errors.

A *fan* is a laser plane on a rotor: an axis, a tilt against that axis, and error terms. The station looks along +z.
With the point's coordinates `up` along the axis, `ahead` along z and `across` where the fan turns to at boresight,

    az       = atan2(across, ahead),  r = sqrt(across^2 + ahead^2)
    b        = az - phase + asin(up tan(tilt) / r)
    measured = b + gibbous_magnitude sin(b + gibbous_phase) + curve atan2(up, ahead)^2                          (E)

is the angle from boresight; `tilt` is the fan's nominal one plus the error's. This is the one place where the model is
written (`_measured`), for kernels and arrays alike. A fan with `TiltedErrors` follows (T) of `tilted` instead of (E).
The gibbous term is evaluated at b, as in libsurvive, so that `from_libsurvive` is exact; evaluated at az it differs by
at most gibbous_magnitude times |az - b|.

Lighthouse 1.0 (`lighthouse_1`): x right, y down. Two straight fans turn at w = 2 pi rate, fan X about the y axis and
fan Y about the x axis, and each flashes when it passes its zero position (source 1, equations 1 and 2):

    theta = w (t - t_flash),    x/z = cot(theta_x),    y/z = cot(theta_y)

From boresight the sweep angle is a = theta - pi/2: a_x = -atan2(x, z), a_y = -atan2(y, z). `up` is -y for fan X and -x
for fan Y. So a positive `phase` lowers the measured angle, a positive `tilt` lowers it where the other coordinate is
positive, and a positive `curve` raises it at both ends of the fan: libsurvive's sign (Bitcraze's is the other one).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import formula, kernel
from estimators.lighthouse.tilted import (
    TILT_RAD,
    Number,
    TiltedErrors,
    plain_angle,
    plain_gradient,
    tilted_angle,
    tilted_gradient,
)
from estimators.state import Vector

HALF_PI = np.pi / 2
_ROUNDS = 100
"""Rounds of `correct` at most; the terms' slopes (0.02 in real stations) make ten enough."""
_UNIT = 1e-9
"""Rounding that a unit vector's square may have: well above that of sines and cosines given with ten digits."""
_CONVERGED = 1e-14
"""Step [rad] at which `correct` is done: a few rounding errors of an angle."""


class FanErrors(NamedTuple):
    """Systematic errors of one fan, as in (E); all zero: a perfect fan."""

    phase_rad: float = 0.0
    tilt_rad: float = 0.0
    curve: float = 0.0
    gibbous_phase_rad: float = 0.0
    gibbous_magnitude: float = 0.0


FanPair = tuple[FanErrors, FanErrors]
"""Errors of fan X, fan Y."""


class Fan(NamedTuple):
    """One laser plane of a station, in the station's frame.

    axis: unit vector along the rotor's axis, perpendicular to z. tilt_rad: nominal tilt of the plane against the axis.
    errors: deviations from it, by the terms of either generation. sense: 1 where the fan turns right-handed about the
    axis, -1 where left-handed.
    """

    axis: Vector
    tilt_rad: float = 0.0
    errors: FanErrors | TiltedErrors = FanErrors()
    sense: int = 1


def lighthouse_1(fan_x: FanErrors, fan_y: FanErrors) -> tuple[Fan, Fan]:
    """Return the two straight fans of a Lighthouse 1.0 station with these errors."""
    return Fan((0.0, -1.0, 0.0), errors=fan_x), Fan((-1.0, 0.0, 0.0), errors=fan_y, sense=-1)


LIGHTHOUSE_1 = lighthouse_1(FanErrors(), FanErrors())
"""The two straight fans of a perfect Lighthouse 1.0 station."""


def lighthouse_2(first: TiltedErrors, second: TiltedErrors) -> tuple[Fan, Fan]:
    """Return the two tilted planes of a Lighthouse 2.0 station with these errors, on one rotor whose axis points up."""
    up = (0.0, -1.0, 0.0)
    return Fan(up, -TILT_RAD, first), Fan(up, TILT_RAD, second)


LIGHTHOUSE_2 = lighthouse_2(TiltedErrors(), TiltedErrors())
"""The two tilted planes of a perfect Lighthouse 2.0 station."""

ACROSS, UP, TERMS, TILTED, FAN = 0, 3, 6, 13, 14
"""A fan as kernels take it is a row of FAN numbers: ACROSS and UP, the directions (3) of `across` and `up`; TERMS,
tan(tilt), phase, curve, gibbous phase and magnitude, ogee phase and magnitude; TILTED, 1 where they are of (T), 0 where
they are of (E) and the last two are zero."""


def kernel_fans(fans: Sequence[Fan]) -> Floats:
    """Return fans as kernels take them, (F, FAN).

    Raises ValueError where an axis is not a unit vector perpendicular to z.
    """
    out = np.empty((len(fans), FAN))
    for row, fan in zip(out, fans, strict=True):
        x, y, z = fan.axis
        if z != 0 or abs(x * x + y * y - 1) > _UNIT:
            raise ValueError(f"axis {fan.axis} is not a unit vector perpendicular to z")
        errors = fan.errors
        # across = sense axis x z
        row[ACROSS:UP] = fan.sense * y, -fan.sense * x, 0.0
        row[UP:TERMS] = x, y, 0.0
        tangent = np.tan(fan.tilt_rad + errors.tilt_rad)
        row[TERMS:] = 0.0
        row[TERMS : TERMS + 5] = (
            *(tangent, errors.phase_rad, errors.curve),
            *(errors.gibbous_phase_rad, errors.gibbous_magnitude),
        )
        if isinstance(errors, TiltedErrors):
            row[TERMS + 5 :] = errors.ogee_phase_rad, errors.ogee_magnitude, 1.0
    return out


def theta_from_time(elapsed_s: Floats, rate_hz: float) -> Floats:
    """Return the sweep angle theta [rad] at instants [s] after the fan's flash (1), any shape."""
    return 2 * np.pi * rate_hz * elapsed_s


def time_from_theta(theta: Floats, rate_hz: float) -> Floats:
    """Return the instant [s] after the fan's flash at which it stands at theta [rad] (1), any shape."""
    return theta / (2 * np.pi * rate_hz)


@formula
def _systematic(
    azimuth: Number,
    shift: Number,
    elevation: Number,
    phase: Number,
    curve: Number,
    gibbous_phase: Number,
    gibbous_magnitude: Number,
) -> Number:
    """Return (E) from az, the tilt's shift asin(...) and atan2(up, ahead), all [rad], and the error terms."""
    b = azimuth - phase + shift
    return b + gibbous_magnitude * np.sin(b + gibbous_phase) + curve * elevation**2


@formula
def _measured(
    across: Number,
    up: Number,
    ahead: Number,
    tangent: Number,
    phase: Number,
    curve: Number,
    gibbous_phase: Number,
    gibbous_magnitude: Number,
) -> Number:
    """Return (E) of points; NaN where a fan tilted so far never reaches it (|asin argument| > 1)."""
    shift = np.arcsin(up * tangent / np.sqrt(across * across + ahead * ahead))
    azimuth, elevation = np.arctan2(across, ahead), np.arctan2(up, ahead)
    return _systematic(azimuth, shift, elevation, phase, curve, gibbous_phase, gibbous_magnitude)


def measured_angles(points: Floats, fans: Sequence[Fan]) -> Floats:
    """Return the angles from boresight (..., F) [rad] that fans measure of points (..., 3) [m], station frame (E), (T).

    NaN where the point is not in front (z > 0), or a fan tilted so far never reaches it. Raises ValueError where the
    last axis of `points` is not 3.
    """
    if points.shape[-1:] != (3,):
        raise ValueError(f"points must have shape (..., 3), not {points.shape}")
    x, y, z = points[..., 0], points[..., 1], np.where(points[..., 2] > 0, points[..., 2], np.nan)
    out = np.empty((*points.shape[:-1], len(fans)))
    with np.errstate(invalid="ignore"):
        for i, row in enumerate(kernel_fans(fans)):
            across, up = row[ACROSS] * x + row[ACROSS + 1] * y, row[UP] * x + row[UP + 1] * y
            if row[TILTED]:
                out[..., i] = tilted_angle(across, up, z, *row[TERMS:TILTED])
            else:
                out[..., i] = _measured(across, up, z, *row[TERMS : TERMS + 5])
    return out


@kernel
def measured_angle(x: float, y: float, z: float, fan: Floats) -> float:
    """Return the angle from boresight [rad] that one fan measures of a point in front (E), (T).

    Args:
        x: the point's x [m], station frame.
        y: its y [m].
        z: its z [m].
        fan: (FAN,), a row of `kernel_fans`.
    """
    across, up = fan[0] * x + fan[1] * y, fan[3] * x + fan[4] * y
    tangent, phase, curve, gibbous_phase, gibbous_magnitude = fan[6], fan[7], fan[8], fan[9], fan[10]
    if fan[13] != 0.0 and curve == 0.0 and gibbous_magnitude == 0.0 and fan[12] == 0.0:
        angle: float = plain_angle(across, up, z, tangent, phase)
    elif fan[13] != 0.0:
        angle = tilted_angle(across, up, z, tangent, phase, curve, gibbous_phase, gibbous_magnitude, fan[11], fan[12])
    elif tangent == 0.0 and curve == 0.0 and gibbous_magnitude == 0.0:
        angle = np.arctan2(across, z) - phase
    else:
        angle = _measured(across, up, z, tangent, phase, curve, gibbous_phase, gibbous_magnitude)
    return angle


@kernel
def is_perfect(fan: Floats) -> bool:
    """Return whether an upright fan (FAN,) has no error but its phase."""
    perfect: bool = fan[13] == 0.0 and fan[6] == 0.0 and fan[8] == 0.0 and fan[10] == 0.0
    return perfect


@kernel
def perfect_gradient(across: float, z: float, fan: Floats) -> Vector:
    """Return `angle_gradient` of a perfect fan, of numbers or of lanes.

    Args:
        across: the point's coordinate across the fan [m].
        z: its z [m].
        fan: (FAN,).
    """
    square = across * across + z * z
    return fan[0] * (z / square), fan[1] * (z / square), -across / square


@kernel
def angle_gradient(x: float, y: float, z: float, fan: Floats) -> Vector:
    """Return the gradient (3) [rad/m] of `measured_angle` by the point, of the same arguments.

    Args:
        x: the point's x [m], station frame.
        y: its y [m].
        z: its z [m].
        fan: (FAN,), a row of `kernel_fans`.
    """
    across, up = fan[0] * x + fan[1] * y, fan[3] * x + fan[4] * y
    square = across * across + z * z
    tangent, phase, curve, gibbous_phase, gibbous_magnitude = fan[6], fan[7], fan[8], fan[9], fan[10]
    if fan[13] != 0.0:
        if curve == 0.0 and gibbous_magnitude == 0.0 and fan[12] == 0.0:
            by_across, by_up, by_ahead = plain_gradient(across, up, z, tangent)
        else:
            by_across, by_up, by_ahead = tilted_gradient(
                across, up, z, tangent, curve, gibbous_phase, gibbous_magnitude, fan[11], fan[12]
            )
        return fan[0] * by_across + fan[3] * by_up, fan[1] * by_across + fan[4] * by_up, by_ahead
    if is_perfect(fan):  # what follows, without its trigonometry
        return perfect_gradient(across, z, fan)
    argument = up * tangent / np.sqrt(square)
    steep = 1 / np.sqrt(1 - argument * argument)
    b = np.arctan2(across, z) - phase + np.arcsin(argument)
    by_b = 1 + gibbous_magnitude * np.cos(b + gibbous_phase)
    bend = 2 * curve * np.arctan2(up, z) / (up * up + z * z)
    by_across = by_b * (z - steep * argument * across) / square
    by_up = by_b * steep * tangent / np.sqrt(square) + bend * z
    by_ahead = -by_b * (across + steep * argument * z) / square - bend * up
    return fan[0] * by_across + fan[3] * by_up, fan[1] * by_across + fan[4] * by_up, by_ahead


def ideal_theta(points: Floats) -> Floats:
    """Return angles theta (..., 2) [rad] of points (..., 3) [m] (2); NaN where the point is not in front (z > 0)."""
    return HALF_PI + measured_angles(points, LIGHTHOUSE_1)


def direction(theta: Floats) -> Floats:
    """Return the points (cot theta_x, cot theta_y, 1), (..., 3), at z = 1 of ideal angles (..., 2) [rad] (2)."""
    _check_pair(theta)
    # tan(pi/2 - theta) is finite and exact at boresight, where 1/tan(theta) would divide by infinity.
    return np.concatenate([np.tan(HALF_PI - theta), np.ones_like(theta[..., :1])], axis=-1)


def measured_theta(points: Floats, errors: FanPair) -> Floats:
    """Return the angles (..., 2) [rad] that Lighthouse 1.0 fans with `errors` measure of points (..., 3) [m] (E).

    NaN where the point is not in front (z > 0), or a fan tilted so far never reaches it (|asin argument| > 1).
    """
    return HALF_PI + measured_angles(points, lighthouse_1(*errors))


def correct(theta: Floats, errors: FanPair) -> Floats:
    """Return the ideal angles (..., 2) [rad] of measured ones (..., 2): the inverse of (E), by fixed-point iteration.

    The error of each fan depends on the other's angle, so both are needed: NaN where either is NaN, where the direction
    is not in front of the lighthouse, or where the errors are too large for the iteration to settle. Where the craft
    moves between its two sweeps, the other angle is old by half a period, which matters to second order only.
    """
    _check_pair(theta)
    if all(error == FanErrors() for error in errors):
        out = np.ascontiguousarray(theta, dtype=np.float64).copy()
        _keep_front(out.reshape(-1, 2))
        return out
    measured = theta - HALF_PI
    a = measured
    step = np.full_like(a, np.inf)
    for _ in range(_ROUNDS):
        a = np.where(np.all(np.abs(a) < HALF_PI, axis=-1, keepdims=True), a, np.nan)
        shift = np.stack([_tilt_term(a[..., i], a[..., 1 - i], errors[i]) for i in (0, 1)], axis=-1)
        step = measured - _distort(a, shift, errors)
        a = a + step
        if not np.any(np.abs(step) > _CONVERGED):
            break
    settled = np.all(np.abs(step) <= _CONVERGED, axis=-1, keepdims=True)
    return np.where(settled, HALF_PI + a, np.nan)


@kernel
def _keep_front(theta: Floats) -> None:
    """Make pairs of angles (N, 2) NaN where either is, or where the direction is not in front."""
    for i in range(len(theta)):
        if not (abs(theta[i, 0] - HALF_PI) < HALF_PI and abs(theta[i, 1] - HALF_PI) < HALF_PI):
            theta[i, 0] = theta[i, 1] = np.nan


def from_libsurvive(
    phase: tuple[float, float],
    tilt: tuple[float, float],
    curve: tuple[float, float],
    gibbous_phase: tuple[float, float],
    gibbous_magnitude: tuple[float, float],
) -> FanPair:
    """Return the errors of both fans from libsurvive's `fcal*` values.

    libsurvive stores the tangent of the tilt, and its frame looks along -z with y up: ours turned by pi about x. So y
    changes sign, and with it fan X's tilt; fan Y's other coordinate is x, which does not.

    Args:
        phase: [rad], X sweep, then Y sweep.
        tilt: tangents, likewise.
        curve: likewise.
        gibbous_phase: [rad], likewise.
        gibbous_magnitude: likewise.
    """
    tangent = (-tilt[0], tilt[1])
    x, y = (
        FanErrors(phase[i], float(np.arctan(tangent[i])), curve[i], gibbous_phase[i], gibbous_magnitude[i])
        for i in (0, 1)
    )
    return x, y


def _check_pair(theta: Floats) -> None:
    if theta.shape[-1:] != (2,):
        raise ValueError(f"angles must have shape (..., 2), fan X then fan Y, not {theta.shape}")


def _tilt_term(a: Floats, other: Floats, errors: FanErrors) -> Floats:
    """Return asin(up tan(tilt) / r) from the two ideal angles: at depth 1, up = tan(a_other), r = 1 / cos(a)."""
    argument = np.tan(other) * np.cos(a) * np.tan(errors.tilt_rad)
    shift: Floats = np.arcsin(np.where(np.abs(argument) <= 1, argument, np.nan))
    return shift


def _distort(a: Floats, shift: Floats, errors: FanPair) -> Floats:
    """Return (E) from ideal angles a and tilt terms, both (..., 2)."""
    phase, _, curve, gibbous_phase, magnitude = np.array(errors).T
    out: Floats = _systematic(a, shift, a[..., ::-1], phase, curve, gibbous_phase, magnitude)
    return out
