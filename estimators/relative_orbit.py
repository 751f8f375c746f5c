"""Motion beside a station in circular orbit: the Clohessy-Wiltshire equations, their solution and their integral.

Seen from the station, in axes that turn with it (W. Fehse, *Automated Rendezvous and Docking of Spacecraft*, 2003,
3.2.3 and appendix A): V-bar along its velocity, R-bar towards the Earth, H-bar against the orbit's angular momentum, so
that (V, H, R) is right-handed. With the mean motion n = sqrt(mu / a^3) and a craft at (x, y, z) in these axes, gravity
and the turning axes accelerate it by

    x'' = 2 n z'            y'' = -n^2 y            z'' = 3 n^2 z - 2 n x'                              (CW)

which is gravity to first order in distance / a: what is left out is at most 3 n^2 d^2 / a, 6e-11 m/s^2 at d = 10 m in
an orbit of 400 km. Free motion is a drift and an ellipse in the plane and an oscillation across it, in closed form
(`transition`), and keeps v^2/2 - 3/2 n^2 z^2 + 1/2 n^2 y^2 (`integral`).
Arguments and results are in the lighthouse frame; the lighthouse stands in the station's centre of mass and looks along
one of the axes.
"""

from math import cos, sin, sqrt
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats

EARTH_MU_M3_S2 = 3.986004418e14
"""Gravitational parameter of the Earth (IERS 2010)."""
EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius, from which altitudes are counted (WGS 84)."""

_V, _H, _R = np.eye(3)
BORESIGHTS = {
    "v-bar": np.stack([_H, _R, _V]),
    "-v-bar": np.stack([-_H, _R, -_V]),
    "r-bar": np.stack([_H, -_V, _R]),
    "-r-bar": np.stack([-_H, -_V, -_R]),
    "h-bar": np.stack([-_V, _R, _H]),
    "-h-bar": np.stack([_V, _R, -_H]),
}
"""Attitudes of the lighthouse by the axis that it looks along: its axes x, y, z as rows (3, 3) in (V, H, R). Down, its
y, is towards the Earth; against the flight where it looks up or down itself."""


class RelativeOrbit(NamedTuple):
    """A circular orbit of the station. mean_motion_rad_s: n. axes: (3, 3), V-bar, H-bar, R-bar as rows in the
    lighthouse frame, so that p_orbit = axes p.
    """

    mean_motion_rad_s: float
    axes: Floats

    @property
    def period_s(self) -> float:
        """The time of one orbit."""
        return 2 * np.pi / self.mean_motion_rad_s


def circular(altitude_m: float, boresight: str = "-v-bar") -> RelativeOrbit:
    """Return the orbit at `altitude_m` [m] above the equator's radius. Raises ValueError for an unknown boresight."""
    if boresight not in BORESIGHTS:
        raise ValueError(f"boresight: {boresight!r} is not one of {', '.join(BORESIGHTS)}")
    return RelativeOrbit(sqrt(EARTH_MU_M3_S2 / (EARTH_RADIUS_M + altitude_m) ** 3), BORESIGHTS[boresight].T.copy())


def acceleration(orbit: RelativeOrbit, position: Floats, velocity: Floats) -> Floats:
    """Return the acceleration (CW) of craft, (..., 3) [m/s^2].

    Args:
        orbit: the station's.
        position: (..., 3) [m].
        velocity: (..., 3) [m/s].
    """
    n = orbit.mean_motion_rad_s
    place, speed = position @ orbit.axes.T, velocity @ orbit.axes.T
    along = 2 * n * speed[..., 2]
    across = -(n**2) * place[..., 1]
    down = 3 * n**2 * place[..., 2] - 2 * n * speed[..., 0]
    out: Floats = np.stack([along, across, down], axis=-1) @ orbit.axes
    return out


def transition(orbit: RelativeOrbit, time_s: float) -> Floats:
    """Return the matrix (6, 6) from (position [m], velocity [m/s]) to those after free motion over `time_s`, also
    backwards.

    Fehse, (3.22) to (3.25), without thrust.
    """
    n, t = orbit.mean_motion_rad_s, time_s
    s, c, versine = sin(n * t), cos(n * t), 2 * sin(n * t / 2) ** 2
    out = np.zeros((6, 6))
    # In the plane, (x, z, x', z'); versine is 1 - cos without its cancellation.
    out[np.ix_((0, 2, 3, 5), (0, 2, 3, 5))] = [
        [1, 6 * (n * t - s), 4 * s / n - 3 * t, 2 * versine / n],
        [0, 1 + 3 * versine, -2 * versine / n, s / n],
        [0, 6 * n * versine, 1 - 4 * versine, 2 * s],
        [0, 3 * n * s, -2 * s, c],
    ]
    out[np.ix_((1, 4), (1, 4))] = [[c, s / n], [-n * s, c]]
    turn = np.kron(np.eye(2), orbit.axes)
    moved: Floats = turn.T @ out @ turn
    return moved


def integral(orbit: RelativeOrbit, position: Floats, velocity: Floats) -> Floats:
    """Return v^2/2 - 3/2 n^2 z^2 + 1/2 n^2 y^2 of craft, (...,) [m^2/s^2].

    Args:
        orbit: the station's.
        position: (..., 3) [m].
        velocity: (..., 3) [m/s].
    """
    place = position @ orbit.axes.T
    square = orbit.mean_motion_rad_s**2
    out: Floats = np.sum(velocity**2, axis=-1) / 2 + square / 2 * (place[..., 1] ** 2 - 3 * place[..., 2] ** 2)
    return out
