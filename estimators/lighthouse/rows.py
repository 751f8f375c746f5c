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

from estimators.arc_tangent import arc_tangent
from estimators.arrays import Floats, Ints
from estimators.kernel import inlined, kernel
from estimators.lanes import lane, width, with_lane
from estimators.lighthouse.projection import checked
from estimators.lighthouse.sweep import (
    FAN,
    LIGHTHOUSE_1,
    TERMS,
    Fan,
    angle_gradient,
    is_perfect,
    kernel_fans,
    measured_angle,
    perfect_gradient,
)
from estimators.rotation import exp_into, left_jacobian_rows, turned
from estimators.state import STATES, State


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
    arm, q = arm_and_place(tau, point, station_rotation, station_position, rotation, position, velocity, angular_rate)
    if not q[2] > 0:
        matrix[:] = np.nan
        return np.nan
    expected, u = seen(q, fan, station_rotation)
    slopes_into(tau, arm, u, angular_rate, matrix)
    return angle - expected


@inlined
def arm_and_place(
    tau: float,
    point: Floats,
    station_rotation: Floats,
    station_position: Floats,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    angular_rate: Floats,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return T R b, world frame, and q [m], of numbers or of lanes.

    Args:
        tau: instant after the epoch [s].
        point: (3,) [m], the photodiode in the body frame.
        station_rotation: (3, 3) R_w_s.
        station_position: (3,) [m].
        rotation: (3, 3) R_w_b at the epoch.
        position: (3,) [m] at the epoch.
        velocity: (3,) [m/s], world frame.
        angular_rate: (3,) [rad/s], world frame.
    """
    a0 = rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2]
    a1 = rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2]
    a2 = rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2]
    b0, b1, b2 = turned(angular_rate[0] * tau, angular_rate[1] * tau, angular_rate[2] * tau, a0, a1, a2)
    v0 = position[0] + velocity[0] * tau + b0 - station_position[0]
    v1 = position[1] + velocity[1] * tau + b1 - station_position[1]
    v2 = position[2] + velocity[2] * tau + b2 - station_position[2]
    s = station_rotation
    return (b0, b1, b2), (
        s[0, 0] * v0 + s[1, 0] * v1 + s[2, 0] * v2,
        s[0, 1] * v0 + s[1, 1] * v1 + s[2, 1] * v2,
        s[0, 2] * v0 + s[1, 2] * v1 + s[2, 2] * v2,
    )


@inlined
def seen(
    q: tuple[float, float, float], fan: Floats, station_rotation: Floats
) -> tuple[float, tuple[float, float, float]]:
    """Return h(q) [rad] and its gradient R_s g [rad/m], world frame, of numbers or of lanes.

    Args:
        q: a point in front of the station [m], station frame.
        fan: (FAN,), a row of `kernel_fans`.
        station_rotation: (3, 3) R_w_s.
    """
    x, y, z = q
    if is_perfect(fan):
        across = fan[0] * x + fan[1] * y
        angle = arc_tangent(across, z) - fan[TERMS + 1]
        g0, g1, g2 = perfect_gradient(across, z, fan)
    else:
        angle, g0, g1, g2 = x, x, x, x
        for i in range(width(x)):
            angle = with_lane(angle, i, measured_angle(lane(x, i), lane(y, i), lane(z, i), fan))
            own = angle_gradient(lane(x, i), lane(y, i), lane(z, i), fan)
            g0, g1, g2 = with_lane(g0, i, own[0]), with_lane(g1, i, own[1]), with_lane(g2, i, own[2])
    s = station_rotation
    return angle, (
        s[0, 0] * g0 + s[0, 1] * g1 + s[0, 2] * g2,
        s[1, 0] * g0 + s[1, 1] * g1 + s[1, 2] * g2,
        s[2, 0] * g0 + s[2, 1] * g1 + s[2, 2] * g2,
    )


@inlined
def slopes_into(
    tau: float,
    arm: tuple[float, float, float],
    u: tuple[float, float, float],
    angular_rate: Floats,
    matrix: Floats,
) -> None:
    """Write H of a row, of numbers or of lanes.

    With m = T R b x u, so that -u^T [T R b]x = m^T, and T = I + J_l [w tau]x, the row is that of j = J_l^T m:

        -u^T [T R b]x J_l tau = j^T tau,   -u^T T [R b]x = m^T T = (m - w tau x j)^T

    Args:
        tau: instant after the epoch [s].
        arm: T R b [m].
        u: gradient [rad/m], world frame.
        angular_rate: (3,) [rad/s].
        matrix: (12,), receives it.
    """
    (b0, b1, b2), (u0, u1, u2) = arm, u
    m0, m1, m2 = b1 * u2 - b2 * u1, b2 * u0 - b0 * u2, b0 * u1 - b1 * u0
    v0, v1, v2 = angular_rate[0] * tau, angular_rate[1] * tau, angular_rate[2] * tau
    r0, r1, r2 = left_jacobian_rows(v0, v1, v2)
    j0 = r0[0] * m0 + r1[0] * m1 + r2[0] * m2
    j1 = r0[1] * m0 + r1[1] * m1 + r2[1] * m2
    j2 = r0[2] * m0 + r1[2] * m1 + r2[2] * m2
    matrix[0] = m0 - (v1 * j2 - v2 * j1)
    matrix[1] = m1 - (v2 * j0 - v0 * j2)
    matrix[2] = m2 - (v0 * j1 - v1 * j0)
    matrix[3], matrix[4], matrix[5] = j0 * tau, j1 * tau, j2 * tau
    matrix[6], matrix[7], matrix[8] = u0, u1, u2
    matrix[9], matrix[10], matrix[11] = u0 * tau, u1 * tau, u2 * tau


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


@kernel
def expect_into(
    hits: tuple[Ints, Ints, Ints, Floats], state: State, point: Floats, stations: Packed, out: Floats
) -> None:
    """Write the angles from boresight (N, F) [rad] at which photodiodes are expected, NaN where not in front.

    Args:
        hits: craft, station and photodiode (N,) of every hit, and its instant after the epoch of the states, (N,) [s].
        state: of C craft; NaN where it is not known.
        point: (C, K, 3) [m], photodiodes in the body frames.
        stations: stations of F fans each.
        out: receives the angles.
    """
    turn, vector, arm = np.empty((3, 3)), np.empty(3), np.empty(3)
    craft, station, photodiode, later = hits
    for n in range(len(craft)):
        c, s, tau = craft[n], station[n], later[n]
        r, p = state.rotation[c], point[c, photodiode[n]]
        for i in range(3):
            vector[i] = state.angular_rate[c, i] * tau
            arm[i] = r[i, 0] * p[0] + r[i, 1] * p[1] + r[i, 2] * p[2]
        exp_into(vector, turn)
        for i in range(3):
            shift = turn[i, 0] * arm[0] + turn[i, 1] * arm[1] + turn[i, 2] * arm[2]
            vector[i] = state.position[c, i] + state.velocity[c, i] * tau + shift - stations.position[s, i]
        t = stations.rotation[s]
        x = t[0, 0] * vector[0] + t[1, 0] * vector[1] + t[2, 0] * vector[2]
        y = t[0, 1] * vector[0] + t[1, 1] * vector[1] + t[2, 1] * vector[2]
        z = t[0, 2] * vector[0] + t[1, 2] * vector[1] + t[2, 2] * vector[2]
        for f in range(out.shape[1]):
            out[n, f] = measured_angle(x, y, z, stations.fans[stations.first[s] + f]) if z > 0 else np.nan
