"""The motion bias: the part of the raw PnP error (solution - truth) that is proportional to the true rate.

It is found by least squares per axis of the lighthouse frame, position error against velocity and attitude error
against angular rate. Its slope is a time: the solution shows the craft where it is that much later. Without motion
compensation the two fans, T/2 apart, leave about -T/4 in x and +T/4 in y, which along the velocity of a turning ring
would cancel. The slope's 1 sigma counts the craft of a period as one sample (errors summed per period before squaring).
"""

from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from swarm.results.rows import attitude_errors_into
from swarm.results.summary.statistics import number
from swarm.results.table import TelemetryTable

MIN_RATE = 1e-4
"""Below this RMS rate [m/s], [rad/s] an axis is at rest, and no bias can be told from it."""

_POSITION_ERROR = (
    ("pnp - true x", "pnp - true y", "pnp - true z"),
    [f"{whose}_p{axis}_m" for whose in ("pnp", "true") for axis in "xyz"],
)
_TURN = (
    ("pnp from true x", "pnp from true y", "pnp from true z"),
    [f"{whose}_q{part}" for whose in ("pnp", "true") for part in "wxyz"],
)


class _Slopes(NamedTuple):
    """Slope and 1 sigma [s] per axis, None where at rest; the RMS of the error that the slopes explain."""

    slope_s: list[float | None]
    sigma_s: list[float | None]
    explained: float | None


def position_bias(rows: TelemetryTable) -> dict[str, Any]:
    """Return the slope per axis, its 1 sigma, how much of the position error it explains, and the error along the
    velocity; null where there are no rows.
    """
    ex, ey, ez = rows.derived(*_POSITION_ERROR, _position_error)
    vx, vy, vz = (rows.column(f"true_v{axis}_m_s") for axis in "xyz")
    found = _slopes(rows.column("frame"), ex, ey, ez, vx, vy, vz)
    along, moving = _along(ex, ey, ez, vx, vy, vz)
    return {
        "position_slope_s": found.slope_s,
        "position_slope_sigma_s": found.sigma_s,
        "position_rms_m": found.explained,
        "along_velocity_m": along / moving if moving else None,
    }


def attitude_bias(rows: TelemetryTable) -> dict[str, Any]:
    """Return the slope per axis, its 1 sigma, and how much of the attitude error it explains; null likewise."""
    wx, wy, wz = (rows.column(f"true_w{axis}_rad_s") for axis in "xyz")
    ex, ey, ez = rows.derived(*_TURN, _turn)
    found = _slopes(rows.column("frame"), ex, ey, ez, wx, wy, wz)
    return {
        "attitude_slope_s": found.slope_s,
        "attitude_slope_sigma_s": found.sigma_s,
        "attitude_rms_deg": None if found.explained is None else float(np.degrees(found.explained)),
    }


def _slopes(frame: Floats, ex: Floats, ey: Floats, ez: Floats, vx: Floats, vy: Floats, vz: Floats) -> _Slopes:
    """Return the least squares of errors e (rows,) against rates v (rows,) through the origin, axis by axis.

    The 1 sigma of the slope b is that of sum v (e - b v) / sum v^2, with the rows of a frame summed before squaring.
    """
    first, last = (int(frame.min()), int(frame.max())) if len(frame) else (0, -1)
    # By frame, per axis: the sums of e v and of v^2.
    sums = np.zeros((2, last - first + 1, 3))
    slope, sigma = np.full((2, 3), np.nan)
    count = _sum_by_frame(frame, first, ex, ey, ez, vx, vy, vz, sums)
    square = _solve(sums, count, slope, sigma)
    explained = float(np.sqrt(square / count)) if count else None
    return _Slopes([number(b) for b in slope], [number(b) for b in sigma], explained)


@kernel
def _sum_by_frame(
    frame: Floats, first: int, ex: Floats, ey: Floats, ez: Floats, vx: Floats, vy: Floats, vz: Floats, sums: Floats
) -> int:
    """Add e v and v^2 of the rows, (rows,) each, whose errors are known, to the sums (2, frames, 3) of their frames.

    Returns the number of these rows.
    """
    count = 0
    for i in range(len(frame)):
        if np.isfinite(ex[i]) and np.isfinite(ey[i]) and np.isfinite(ez[i]):
            count += 1
            f = int(frame[i]) - first
            sums[0, f, 0] += ex[i] * vx[i]
            sums[0, f, 1] += ey[i] * vy[i]
            sums[0, f, 2] += ez[i] * vz[i]
            sums[1, f, 0] += vx[i] * vx[i]
            sums[1, f, 1] += vy[i] * vy[i]
            sums[1, f, 2] += vz[i] * vz[i]
    return count


@kernel
def _solve(sums: Floats, count: int, slope: Floats, sigma: Floats) -> float:
    """Write slope and 1 sigma (3,) of sums (2, frames, 3) over `count` rows, where the axis is not at rest.

    Returns the sum of the squares of the error that the slopes explain.
    """
    explained = 0.0
    for axis in range(3):
        product = square = score = 0.0
        for f in range(sums.shape[1]):
            product += sums[0, f, axis]
            square += sums[1, f, axis]
        if square > count * MIN_RATE**2:
            b = product / square
            for f in range(sums.shape[1]):
                left = sums[0, f, axis] - b * sums[1, f, axis]
                score += left * left
            slope[axis], sigma[axis] = b, np.sqrt(score) / square
            explained += b * b * square
    return explained


@kernel
def _along(ex: Floats, ey: Floats, ez: Floats, vx: Floats, vy: Floats, vz: Floats) -> tuple[float, int]:
    """Return the sum of the errors along the velocities, (rows,) each, of rows that move, and their number."""
    total, moving = 0.0, 0
    for i in range(len(ex)):
        speed = np.sqrt(vx[i] * vx[i] + vy[i] * vy[i] + vz[i] * vz[i])
        along = ex[i] * vx[i] + ey[i] * vy[i] + ez[i] * vz[i]
        if speed > MIN_RATE and np.isfinite(along):
            total += along / speed
            moving += 1
    return total, moving


def _position_error(found: Floats) -> Floats:
    """Return the errors (3, n) [m] of solutions whose positions stand before the true ones, (6, n)."""
    out: Floats = found[:3] - found[3:]
    return out


def _turn(found: Floats) -> Floats:
    """Return the attitude errors (3, n) [rad] of solutions whose quaternions stand before the true ones, (8, n)."""
    out = np.empty((3, found.shape[1]))
    attitude_errors_into(found[4:], found[:4], out)
    out[:, ~np.isfinite(found).all(axis=0)] = np.nan
    return out
