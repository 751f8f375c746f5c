"""Sweep angles: what a lighthouse's two turning fans measure of a point, ideally and with systematic errors.

Lighthouse frame: x right, y down, looking along +z. Fan X turns about the Y axis, fan Y about the X axis, both at
w = 2 pi rate, and each flashes when it passes its zero position (source 1, equations 1 and 2):

    theta = w (t - t_flash),    x/z = cot(theta_x),    y/z = cot(theta_y)

From boresight the sweep angle is a = theta - pi/2: a_x = -atan2(x, z), a_y = -atan2(y, z). A real fan (Lighthouse 1.0)
deviates from a plane through the origin; five numbers per fan describe what it measures instead:

    b        = a - phase - asin(other tan(tilt) / r)
    measured = b + gibbous_magnitude sin(b + gibbous_phase) + curve other_angle^2                               (E)

with other = y, r = sqrt(x^2 + z^2), other_angle = a_y for fan X, and other = x, r = sqrt(y^2 + z^2), other_angle = a_x
for fan Y. This is the one place where the signs are chosen: a positive `phase` lowers the measured angle, a positive
`tilt` lowers it where `other` is positive, positive `curve` raises it at both ends of the fan. `curve` has the sign
of libsurvive (Bitcraze's sign is the other one), and the gibbous term is evaluated at b, as in libsurvive, so that
`from_libsurvive` is exact; evaluated at a it differs by at most gibbous_magnitude times |a - b|.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel

HALF_PI = np.pi / 2
_ROUNDS = 100
"""Rounds of `correct` at most; the terms' slopes (0.02 in real stations) make ten enough."""
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


def theta_from_time(elapsed_s: Floats, rate_hz: float) -> Floats:
    """Sweep angle theta [rad] of instants [s] after the fan's flash (1), any shape."""
    return 2 * np.pi * rate_hz * elapsed_s


def time_from_theta(theta: Floats, rate_hz: float) -> Floats:
    """Instant [s] after the fan's flash at which it stands at theta [rad] (1), any shape."""
    return theta / (2 * np.pi * rate_hz)


def ideal_theta(points: Floats) -> Floats:
    """Angles theta (..., 2) [rad] of points (..., 3) [m] (2); NaN where the point is not in front (z > 0)."""
    if points.shape[-1:] != (3,):
        raise ValueError(f"points must have shape (..., 3), not {points.shape}")
    z = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
    theta: Floats = HALF_PI - np.arctan2(points[..., :2], z)
    return theta


def direction(theta: Floats) -> Floats:
    """Directions (cot theta_x, cot theta_y, 1), (..., 3), of ideal angles (..., 2) [rad]: points at depth z = 1 (2)."""
    _check_pair(theta)
    # tan(pi/2 - theta) is finite and exact at boresight, where 1/tan(theta) would divide by infinity.
    return np.concatenate([np.tan(HALF_PI - theta), np.ones_like(theta[..., :1])], axis=-1)


def measured_theta(points: Floats, errors: FanPair) -> Floats:
    """Angles (..., 2) [rad] that fans with `errors` measure of points (..., 3) [m] (E).

    NaN where the point is not in front (z > 0), or a fan tilted so far never reaches it (|asin argument| > 1).
    """
    a = ideal_theta(points) - HALF_PI
    shift = np.stack([_tilt_term(a[..., i], a[..., 1 - i], errors[i]) for i in (0, 1)], axis=-1)
    return HALF_PI + _distort(a, shift, errors)


def correct(theta: Floats, errors: FanPair) -> Floats:
    """Ideal angles (..., 2) [rad] of measured ones (..., 2): the inverse of (E), by fixed-point iteration.

    Each fan's error depends on the other's angle, so both are needed: NaN where either is NaN, where the direction is
    not in front of the lighthouse, or where the errors are too large for the iteration to settle. Where the craft moves
    between its two sweeps, the other angle is old by half a period, which matters to second order only.
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
    """Errors of both fans from libsurvive's `fcal*` values, each (X sweep, Y sweep).

    libsurvive stores the tangent of the tilt, and its frame looks along -z with y up: ours turned by pi about x. So y
    changes sign, and with it fan X's tilt; fan Y's `other` is x, which does not.
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
    """asin(other tan(tilt) / r) from the two ideal angles: at depth 1, other = -tan(a_other), r = 1 / cos(a)."""
    argument = -np.tan(other) * np.cos(a) * np.tan(errors.tilt_rad)
    shift: Floats = np.arcsin(np.where(np.abs(argument) <= 1, argument, np.nan))
    return shift


def _distort(a: Floats, shift: Floats, errors: FanPair) -> Floats:
    """(E) from ideal angles a and tilt terms, both (..., 2)."""
    phase, _, curve, gibbous_phase, magnitude = np.array(errors).T
    b = a - phase - shift
    out: Floats = b + magnitude * np.sin(b + gibbous_phase) + curve * a[..., ::-1] ** 2
    return out


def kernel_errors(errors: FanPair) -> Floats:
    """`errors` as `measured_angle` takes them: (2, 5), per fan phase, tan(tilt), curve, gibbous phase, magnitude."""
    out = np.array(errors, dtype=np.float64)
    out[:, 1] = np.tan(out[:, 1])
    return out


@kernel
def measured_angle(x: float, y: float, z: float, fan: int, errors: Floats) -> float:
    """Angle from boresight [rad] that one fan (0: X, 1: Y) measures of a point [m] (E); `errors` of `kernel_errors`."""
    along, other = (x, y) if fan == 0 else (y, x)
    b: float = -np.arctan2(along, z) - errors[fan, 0]
    if errors[fan, 1] != 0.0:
        argument = other * errors[fan, 1] / np.sqrt(along * along + z * z)
        if not (abs(argument) <= 1.0):
            return np.nan
        b -= np.arcsin(argument)
    measured = b
    if errors[fan, 4] != 0.0:
        measured += errors[fan, 4] * np.sin(b + errors[fan, 3])
    if errors[fan, 2] != 0.0:
        measured += errors[fan, 2] * np.arctan2(other, z) ** 2
    return measured
