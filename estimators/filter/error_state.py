"""One craft's error state: its prediction and its innovation, as kernels that every bank of pose filters shares.

Kept per craft in the lighthouse frame: R = R_l_b, angular rate w, position p, velocity v. The filter's state is their
error x = (d, dw, dp, dv), 12 numbers, with R_true = Exp([d]x) R and truth minus estimate for the rest. Over dt

    R <- Exp([w]x dt) R,  p <- p + v dt,  x <- F x + Gamma (angular acceleration, acceleration)
    F = [[E, dt J_l], [0, I]] for (d, dw), [[I, dt I], [0, I]] for (dp, dv),  E = Exp([w]x dt), J_l = J_l(w dt)
    Q = Gamma diag(sigma^2) Gamma^T,  Gamma = (dt^2 / 2, dt): accelerations white, constant over each dt

The measurement is the PnP pose (R_z, p_z) with covariance s^2 H of (18). PnP refers its angles to one epoch with the
predicted rates, so their error enters through the coupling B (`estimators.lighthouse.dop`), and the innovation is

    y = (log(R_z R^T), p_z - p) = (d, dp) + B (dw, dv) + noise

After an update R <- Exp([d]x) R, the rest is added, and x is zero again. The reset turns P by d/2, far below the
filter's other linearisations, and is left out.
"""

import math

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.rotation import exp_into, left_jacobian_into, log_into, multiply_into
from estimators.scratch import scratch
from estimators.state import STATES as STATES
from estimators.state import State

DEFAULT_ACCELERATION_NOISE_M_S2 = 0.2
"""White acceleration [m/s^2] per axis, constant over a period. docs/filter.md has the table behind the choice."""
DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2 = math.radians(12.0)
"""White angular acceleration [rad/s^2] per axis, constant over a period (docs/filter.md)."""

POSE = 6
POSE_COLUMNS = np.array([0, 1, 2, 6, 7, 8])
"""Columns of (attitude, position) in the state."""
RATE_COLUMNS = np.array([3, 4, 5, 9, 10, 11])
"""Columns of (angular rate, velocity) in the state."""


@kernel
def transition_into(angular_rate: Floats, dt: float, out: Floats) -> None:
    """Write F for one step.

    Args:
        angular_rate: (3,) [rad/s].
        dt: the step [s].
        out: (12, 12), receives F.
    """
    v = angular_rate * dt
    out[:] = 0.0
    for i in range(STATES):
        out[i, i] = 1.0
    exp_into(v, out[:3, :3])
    left_jacobian_into(v, out[:3, 3:6])
    for i in range(3):
        for j in range(3):
            out[i, 3 + j] *= dt
        out[6 + i, 9 + i] = dt


@kernel
def transitions_into(mask: Bools, angular_rate: Floats, step: Floats, out: Floats) -> None:
    """`transition_into` for the craft of the mask.

    Args:
        mask: (C,).
        angular_rate: (C, 3) [rad/s].
        step: (C,) [s].
        out: (C, 12, 12), receives F.
    """
    for c in range(len(mask)):
        if mask[c]:
            transition_into(angular_rate[c], step[c], out[c])


@kernel
def process_noise_into(dt: float, acceleration: float, angular_acceleration: float, out: Floats) -> None:
    """Write Q for one step with white accelerations that are constant over it.

    Args:
        dt: the step [s].
        acceleration: sigma per axis [m/s^2].
        angular_acceleration: sigma per axis [rad/s^2].
        out: (12, 12), receives Q.
    """
    out[:] = 0.0
    for i in range(STATES):
        sigma = angular_acceleration if i < 6 else acceleration
        if i % 6 < 3:
            out[i, i] = (sigma * dt * dt / 2) ** 2
            out[i, i + 3] = out[i + 3, i] = sigma * sigma * dt * dt * dt / 2
        else:
            out[i, i] = (sigma * dt) ** 2


@kernel
def propagate(rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, dt: float) -> None:
    """Move the pose of one craft on at constant rates, in place.

    Args:
        rotation: (3, 3).
        angular_rate: (3,) [rad/s].
        position: (3,) [m].
        velocity: (3,) [m/s].
        dt: the step [s].
    """
    turn = np.empty((3, 3))
    exp_into(angular_rate * dt, turn)
    multiply_into(turn, rotation, rotation)
    for i in range(3):
        position[i] += velocity[i] * dt


@kernel
def pose_difference_into(rotation_z: Floats, position_z: Floats, rotation: Floats, position: Floats, y: Floats) -> None:
    """Write the innovation of a solved pose.

    Args:
        rotation_z: (3, 3), the measured rotation.
        position_z: (3,) [m], the measured position.
        rotation: (3, 3), the predicted rotation.
        position: (3,) [m], the predicted position.
        y: (6,), receives the innovation.
    """
    turn = scratch(0.0, 3, 3)
    for i in range(3):
        for j in range(3):
            turn[i, j] = (
                rotation_z[i, 0] * rotation[j, 0]
                + rotation_z[i, 1] * rotation[j, 1]
                + rotation_z[i, 2] * rotation[j, 2]
            )
        y[3 + i] = position_z[i] - position[i]
    log_into(turn, y[:3])


@kernel
def pose_rows_into(rate_coupling: Floats, h: Floats) -> None:
    """Write H = [I B] (6, 12) of a solved pose; rate_coupling: (6, 6) [s], B."""
    for i in range(POSE):
        for j in range(3):
            h[i, j] = h[i, 6 + j] = 0.0
            h[i, 3 + j], h[i, 9 + j] = rate_coupling[i, j], rate_coupling[i, 3 + j]
        h[i, i + i // 3 * 3] = 1.0


@kernel
def innovation_into(
    rotation_z: Floats,
    position_z: Floats,
    rotation: Floats,
    position: Floats,
    rate_coupling: Floats,
    y: Floats,
    h: Floats,
) -> None:
    """Write the innovation of a solved pose into `y` (6,) and its matrix H, y = H x + noise, into `h` (6, 12).

    Args:
        rotation_z: (3, 3), the measured rotation.
        position_z: (3,) [m], the measured position.
        rotation: (3, 3), the predicted rotation.
        position: (3,) [m], the predicted position.
        rate_coupling: (6, 6) [s], B.
        y: (6,), receives the innovation.
        h: (6, 12), receives H.
    """
    pose_difference_into(rotation_z, position_z, rotation, position, y)
    pose_rows_into(rate_coupling, h)


@kernel
def innovations_into(
    mask: Bools,
    rotation: Floats,
    position: Floats,
    predicted: State,
    rate_coupling: Floats,
    y: Floats,
    h: Floats,
) -> None:
    """`innovation_into` for the craft of the mask.

    Args:
        mask: (C,).
        rotation: (C, 3, 3), measured.
        position: (C, 3) [m], measured.
        predicted: the state of the C craft.
        rate_coupling: (C, 6, 6) [s], B.
        y: (C, 6), receives the innovations.
        h: (C, 6, 12), receives H.
    """
    for c in range(len(mask)):
        if mask[c]:
            innovation_into(
                rotation[c], position[c], predicted.rotation[c], predicted.position[c], rate_coupling[c], y[c], h[c]
            )


@kernel
def correct(rotation: Floats, angular_rate: Floats, position: Floats, velocity: Floats, x: Floats) -> None:
    """Move the estimated error into the pose and rates of one craft, and leave it zero.

    Args:
        rotation: (3, 3).
        angular_rate: (3,) [rad/s].
        position: (3,) [m].
        velocity: (3,) [m/s].
        x: (12,), the error state.
    """
    turn = scratch(0.0, 3, 3)
    exp_into(x[:3], turn)
    multiply_into(turn, rotation, rotation)
    for i in range(3):
        angular_rate[i] += x[3 + i]
        position[i] += x[6 + i]
        velocity[i] += x[9 + i]
    for i in range(STATES):
        x[i] = 0.0


@kernel
def difference_into(a: State, b: State, c: int, out: Floats) -> None:
    """Write the error (12,) of state `b` of craft `c` against state `a`, as if `a` were the truth, into `out`.

    Args:
        a: the states of the craft, counted to.
        b: the states of the craft, counted from.
        c: index of the craft.
        out: (12,), receives attitude, angular rate, position and velocity.
    """
    turn = np.empty((3, 3))
    multiply_into(a.rotation[c], b.rotation[c].T, turn)
    log_into(turn, out[:3])
    for i in range(3):
        out[3 + i] = a.angular_rate[c, i] - b.angular_rate[c, i]
        out[6 + i] = a.position[c, i] - b.position[c, i]
        out[9 + i] = a.velocity[c, i] - b.velocity[c, i]
