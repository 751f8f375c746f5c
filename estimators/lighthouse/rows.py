"""Single sweep angles as measurements: rows, whatever stations and fans they come from.

A *station* is a pose T_w_s = (R_s, t_s) in the world frame and a list of fans; a *row* is (station, fan, photodiode,
sweep, instant, angle). For one craft with pose (R, p) and rates (w, v) at the epoch, all in the world frame, photodiode
b on its body and the instant tau after the epoch,

    q = R_s^T (p + v tau + Exp([w]x tau) R b - t_s)                  the photodiode in the station's frame
    y = angle - h(q) = H x + noise                                   h: (E) of `estimators.lighthouse.sweep`
    H = g^T R_s^T [ -T [R b]x,  -[T R b]x J_l(w tau) tau,  I,  I tau ],   T = Exp([w]x tau),  g = grad h(q)

with x = (d, dw, dp, dv) the error state of `estimators.filter.error_state`. To first order in w tau, T and J_l are the
identity.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.lighthouse.projection import checked
from estimators.lighthouse.sweep import FAN, LIGHTHOUSE_1, Fan, angle_gradient, kernel_fans, measured_angle
from estimators.rotation import exp_into, left_jacobian_into
from estimators.state import STATES


class Station(NamedTuple):
    """A lighthouse station: rotation (3, 3) R_w_s and position (3,) [m] in the world frame, and its fans."""

    rotation: Floats
    position: Floats
    fans: Sequence[Fan]


class Packed(NamedTuple):
    """Stations as kernels take them: rotation (S, 3, 3), position (S, 3) [m], fans (F, FAN), all stations' rows of
    `kernel_fans`, of which those of station s begin at first[s] and are number[s] many.
    """

    rotation: Floats
    position: Floats
    fans: Floats
    first: Ints
    number: Ints


def packed(stations: Sequence[Station]) -> Packed:
    """Return stations as kernels take them."""
    number = np.array([len(station.fans) for station in stations], dtype=np.int64)
    return Packed(
        np.array([station.rotation for station in stations]).reshape(-1, 3, 3),
        np.array([station.position for station in stations]).reshape(-1, 3),
        np.concatenate([kernel_fans(station.fans) for station in stations] or [np.empty((0, FAN))]),
        np.cumsum(number) - number,
        number,
    )


AT_ORIGIN = Station(np.eye(3), np.zeros(3), LIGHTHOUSE_1)
"""A perfect Lighthouse 1.0 station whose frame is the world's."""


class Rows(NamedTuple):
    """M sweep angles of one craft, (M,) each: indices of station, fan and photodiode; sweep, a number that tells the
    sweeps of one fan apart; offset_s, the instant minus the epoch [s]; angle [rad], from boresight.
    """

    station: Ints
    fan: Ints
    photodiode: Ints
    sweep: Ints
    offset_s: Floats
    angle: Floats


class Linearised(NamedTuple):
    """M rows at an estimate: residual y (M,) [rad] and its matrix H (M, 12), y = H x + noise; NaN where a photodiode
    is not in front of the station.
    """

    residual: Floats
    matrix: Floats


def linearise(
    rows: Rows,
    stations: Packed,
    point_m: Floats,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    angular_rate: Floats,
) -> Linearised:
    """Return the residuals of one craft's rows and their derivatives by the error of its state.

    Args:
        rows: M sweep angles.
        stations: the stations that the rows name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        rotation: (3, 3), estimated R_w_b at the epoch.
        position: (3,) [m], estimated, world frame.
        velocity: (3,) [m/s], likewise.
        angular_rate: (3,) [rad/s], likewise.

    Raises:
        ValueError: an array has the wrong shape, or a row names a station, a fan or a photodiode that does not exist.
    """
    count = len(rows.angle)
    _within("station", rows.station, len(stations.number), count)
    _within("photodiode", rows.photodiode, len(point_m), count)
    _within("fan", rows.fan, stations.number[rows.station], count)
    out = Linearised(np.empty(count), np.empty((count, STATES)))
    _linearise_into(
        np.ascontiguousarray(rows.station, dtype=np.int64),
        np.ascontiguousarray(stations.first[rows.station] + rows.fan, dtype=np.int64),
        np.ascontiguousarray(rows.photodiode, dtype=np.int64),
        checked("offset_s", rows.offset_s, (count,)),
        checked("angle", rows.angle, (count,)),
        stations.rotation,
        stations.position,
        stations.fans,
        checked("point_m", point_m, (len(point_m), 3)),
        checked("rotation", rotation, (3, 3)),
        checked("position", position, (3,)),
        checked("velocity", velocity, (3,)),
        checked("angular_rate", angular_rate, (3,)),
        out.residual,
        out.matrix,
    )
    return out


def _within(name: str, index: Ints, limit: int | Ints, count: int) -> None:
    if index.shape != (count,):
        raise ValueError(f"{name} has shape {index.shape}, expected {(count,)}")
    if np.any((index < 0) | (index >= limit)):
        raise ValueError(f"{name}: a row names one that does not exist")


@kernel
def row_into(
    tau: float,
    angle: float,
    station_rotation: Floats,
    station_position: Floats,
    fan: Floats,
    point: Floats,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    angular_rate: Floats,
    matrix: Floats,
) -> float:
    """Return the residual y of one row, and write its H (12,) into `matrix`; NaN where not in front of the station.

    Args:
        tau: instant after the epoch [s].
        angle: measured angle from boresight [rad].
        station_rotation: (3, 3) R_w_s.
        station_position: (3,) [m].
        fan: (FAN,), a row of `kernel_fans`.
        point: (3,) [m], the photodiode in the body frame.
        rotation: (3, 3) R_w_b at the epoch.
        position: (3,) [m] at the epoch.
        velocity: (3,) [m/s], world frame.
        angular_rate: (3,) [rad/s], world frame.
        matrix: (12,), receives H.
    """
    arm, vector = np.empty((2, 3)), np.empty(3)
    turn, jacobian, moved = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for i in range(3):
        vector[i] = angular_rate[i] * tau
        arm[0, i] = rotation[i, 0] * point[0] + rotation[i, 1] * point[1] + rotation[i, 2] * point[2]
    exp_into(vector, turn)
    left_jacobian_into(vector, jacobian)
    for i in range(3):
        arm[1, i] = turn[i, 0] * arm[0, 0] + turn[i, 1] * arm[0, 1] + turn[i, 2] * arm[0, 2]
        vector[i] = position[i] + velocity[i] * tau + arm[1, i] - station_position[i]
    s = station_rotation
    x = s[0, 0] * vector[0] + s[1, 0] * vector[1] + s[2, 0] * vector[2]
    y = s[0, 1] * vector[0] + s[1, 1] * vector[1] + s[2, 1] * vector[2]
    z = s[0, 2] * vector[0] + s[1, 2] * vector[1] + s[2, 2] * vector[2]
    if not z > 0:
        matrix[:] = np.nan
        return np.nan
    g = angle_gradient(x, y, z, fan)
    for i in range(3):
        vector[i] = s[i, 0] * g[0] + s[i, 1] * g[1] + s[i, 2] * g[2]
        matrix[6 + i], matrix[9 + i] = vector[i], vector[i] * tau
    # -u^T [a]x = (a x u)^T: with the gradient u in the world frame, turned back to the epoch for the attitude.
    back = (
        turn[0, 0] * vector[0] + turn[1, 0] * vector[1] + turn[2, 0] * vector[2],
        turn[0, 1] * vector[0] + turn[1, 1] * vector[1] + turn[2, 1] * vector[2],
        turn[0, 2] * vector[0] + turn[1, 2] * vector[1] + turn[2, 2] * vector[2],
    )
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        matrix[i] = arm[0, j] * back[k] - arm[0, k] * back[j]
        moved[i] = (arm[1, j] * vector[k] - arm[1, k] * vector[j]) * tau
    for i in range(3):
        matrix[3 + i] = moved[0] * jacobian[0, i] + moved[1] * jacobian[1, i] + moved[2] * jacobian[2, i]
    return angle - measured_angle(x, y, z, fan)


@kernel
def _linearise_into(
    station: Ints,
    fan: Ints,
    photodiode: Ints,
    offset: Floats,
    angle: Floats,
    station_rotation: Floats,
    station_position: Floats,
    fans: Floats,
    point: Floats,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    angular_rate: Floats,
    residual: Floats,
    matrix: Floats,
) -> None:
    """`row_into` for every row."""
    for n in range(len(angle)):
        residual[n] = row_into(
            offset[n],
            angle[n],
            station_rotation[station[n]],
            station_position[station[n]],
            fans[fan[n]],
            point[photodiode[n]],
            rotation,
            position,
            velocity,
            angular_rate,
            matrix[n],
        )
