"""The motion bias: the part of the raw PnP error (solution - truth) that is proportional to the true rate.

It is found by least squares per axis of the lighthouse frame, position error against velocity and attitude error
against angular rate. Its slope is a time: the solution shows the craft where it is that much later. Without motion
compensation the two fans, T/2 apart, leave about -T/4 in x and +T/4 in y, which along the velocity of a turning ring
would cancel. The slope's 1 sigma counts the craft of a period as one sample (errors summed per period before squaring).
"""

from typing import Any

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from swarm.results.rows import attitude_errors_into
from swarm.results.summary.statistics import number
from swarm.results.table import TelemetryTable

MIN_RATE = 1e-4
"""Below this RMS rate [m/s], [rad/s] an axis is at rest, and no bias can be told from it."""
BLOCK = 65_536
"""Rows whose rotations are compared at a time."""


_POSITION_ERROR = (
    ("pnp - true x", "pnp - true y", "pnp - true z"),
    [f"{whose}_p{axis}_m" for whose in ("pnp", "true") for axis in "xyz"],
)
_TURN = (
    ("pnp from true x", "pnp from true y", "pnp from true z"),
    [f"{whose}_q{part}" for whose in ("pnp", "true") for part in "wxyz"],
)


class _Slope:
    """Least squares of an error against a rate through the origin, per axis, from sums over rows that come in blocks.

    The 1 sigma of the slope b is that of sum v (e - b v) / sum v^2, with the rows of a frame summed before squaring.
    """

    def __init__(self, frames: int) -> None:
        self._product, self._square = np.zeros((frames, 3)), np.zeros((frames, 3))
        self._rows = 0

    def add(self, frame: Ints, error: Floats, rate: Floats) -> None:
        """Add rows.

        Args:
            frame: Their periods, from zero, (n,).
            error: (n, 3).
            rate: (n, 3).
        """
        product, square = np.zeros((2, *self._product.shape))
        _sum_by_frame(frame, error, rate, product, square)
        self._product += product
        self._square += square
        self._rows += len(frame)

    def solve(self) -> tuple[list[float | None], list[float | None], float | None]:
        """Return slope and 1 sigma [s] per axis, None where at rest; the RMS of the error that the slopes explain."""
        product, square = self._product.sum(axis=0), self._square.sum(axis=0)
        moving = square > self._rows * MIN_RATE**2
        slope = np.divide(product, square, out=np.full(3, np.nan), where=moving)
        score = np.sqrt(np.sum((self._product - slope * self._square) ** 2, axis=0))
        sigma = np.divide(score, square, out=np.full(3, np.nan), where=moving)
        explained = float(np.sqrt(np.nansum(slope**2 * square) / self._rows)) if self._rows else None
        return [number(b) for b in slope], [number(b) for b in sigma], explained


def position_bias(rows: TelemetryTable) -> dict[str, Any]:
    """Return the slope per axis, its 1 sigma, how much of the position error it explains, and the error along the
    velocity; null where there are no rows.
    """
    first, frames = _frames(rows)
    slope, along, moving = _Slope(frames), 0.0, 0
    for part in rows.blocks(BLOCK):
        error = part.derived(*_POSITION_ERROR, _position_error)
        velocity = part.stacked("true_vx_m_s", "true_vy_m_s", "true_vz_m_s")
        frame, error, velocity = _known(part.frame - first, error, velocity)
        slope.add(frame, error, velocity)
        speed = np.linalg.norm(velocity, axis=1)
        moves = speed > MIN_RATE
        along += float(np.sum(np.sum(error * velocity, axis=1)[moves] / speed[moves]))
        moving += int(np.count_nonzero(moves))
    of_position, sigma, explained = slope.solve()
    return {
        "position_slope_s": of_position,
        "position_slope_sigma_s": sigma,
        "position_rms_m": explained,
        "along_velocity_m": along / moving if moving else None,
    }


def attitude_bias(rows: TelemetryTable) -> dict[str, Any]:
    """Return the slope per axis, its 1 sigma, and how much of the attitude error it explains; null likewise."""
    first, frames = _frames(rows)
    slope = _Slope(frames)
    for part in rows.blocks(BLOCK):
        turn = part.derived(*_TURN, _turn)
        rate = part.stacked("true_wx_rad_s", "true_wy_rad_s", "true_wz_rad_s")
        slope.add(*_known(part.frame - first, turn, rate))
    of_attitude, sigma, explained = slope.solve()
    return {
        "attitude_slope_s": of_attitude,
        "attitude_slope_sigma_s": sigma,
        "attitude_rms_deg": None if explained is None else float(np.degrees(explained)),
    }


@kernel
def _sum_by_frame(frame: Ints, error: Floats, rate: Floats, product: Floats, square: Floats) -> None:
    """Add e v and v^2 of rows, error and rate (n, 3), to the sums (frames, 3) of their frames (n,)."""
    for i in range(len(frame)):
        for axis in range(3):
            product[frame[i], axis] += error[i, axis] * rate[i, axis]
            square[frame[i], axis] += rate[i, axis] * rate[i, axis]


def _known(frame: Ints, error: Floats, rate: Floats) -> tuple[Ints, Floats, Floats]:
    """Return the rows, (n,) and (n, 3) each, whose error is known."""
    known = np.isfinite(error).all(axis=1)
    return (frame, error, rate) if known.all() else (frame[known], error[known], rate[known])


def _position_error(found: Floats) -> Floats:
    """Return the errors (n, 3) [m] of solutions whose positions stand before the true ones, (n, 6)."""
    out: Floats = found[:, :3] - found[:, 3:]
    return out


def _turn(found: Floats) -> Floats:
    """Return the attitude errors (n, 3) [rad] of solutions whose quaternions stand before the true ones, (n, 8)."""
    out = np.empty((len(found), 3))
    attitude_errors_into(found[:, 4:], found[:, :4], out)
    out[~np.isfinite(found).all(axis=1)] = np.nan
    return out


def _frames(rows: TelemetryTable) -> tuple[int, int]:
    """Return the first frame, and the number of frames from there to the last."""
    frame = rows.frame
    return (int(frame.min()), int(frame.max() - frame.min()) + 1) if len(frame) else (0, 0)
