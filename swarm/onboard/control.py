"""The wrench that keeps a craft on its reference: proportional-derivative feedback with feed-forward.

    F = m (a_ref + w_p^2 (p_ref - p) + 2 z w_p (v_ref - v))                       [N], lighthouse frame
    M = I (alpha_ref + w_a^2 e + 2 z w_a (w_ref - w)) + w x I w                   [N m], lighthouse frame

with e = log(R_ref R^T) the attitude error as an active rotation vector in the lighthouse frame, I the inertia about
the centre of mass turned into that frame, and the gyroscopic torque cancelled. The closed loop of each axis is a
second-order system of natural frequency w_p (w_a) and damping z. In an orbit, the accelerations of gravity and of the
rotating frame (`estimators.relative_orbit`) are subtracted from the force. `swarm.onboard.actuation` converts the
wrench into orders to thrusters and wheels.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.relative_orbit import RelativeOrbit
from estimators.relative_orbit import acceleration as orbital_acceleration
from estimators.rotation import log_into, multiply_into
from estimators.scratch import scratch
from estimators.state import Reference, State
from swarm.messages import Command

POSITION_FREQUENCY_RAD_S = 1.0
ATTITUDE_FREQUENCY_RAD_S = 2.0
DAMPING = 0.9


class Feedback(NamedTuple):
    """Position feedback of C craft: stiffness (C,) [1/s^2] and damping (C,) [1/s]."""

    stiffness: Floats
    damping: Floats


def feedback(craft: int) -> Feedback:
    """Return the feedback above, w_p^2 and 2 z w_p, for every craft."""
    return Feedback(np.full(craft, POSITION_FREQUENCY_RAD_S**2), np.full(craft, 2 * DAMPING * POSITION_FREQUENCY_RAD_S))


def command(reference: Reference, state: State, firm: Feedback, orbit: RelativeOrbit | None = None) -> Command:
    """Return the accelerations of the feedback above.

    They are zero if `state` is NaN, or if the reference holds neither position nor attitude.

    Args:
        reference: references of C craft.
        state: states by which the craft steer, NaN where unknown.
        firm: position feedback.
        orbit: the lighthouse's orbit, whose acceleration is subtracted; None in weightless space.
    """
    count = len(reference.position)
    out, believed = Command(*np.zeros((2, count, 3))), _contiguous(state)
    _command_into(
        reference.position,
        reference.velocity,
        reference.acceleration,
        reference.rotation,
        reference.angular_rate,
        reference.angular_acceleration,
        reference.holds_position,
        reference.holds_attitude,
        believed.rotation,
        believed.angular_rate,
        believed.position,
        believed.velocity,
        firm.stiffness,
        firm.damping,
        out.acceleration,
        out.angular_acceleration,
    )
    return out if orbit is None else without_gravity(out, reference.holds_position, state, orbit)


def without_gravity(order: Command, holds_position: Bools, state: State, orbit: RelativeOrbit) -> Command:
    """Return the command less the orbital acceleration at `state`, for craft that hold and know their position.

    Args:
        order: accelerations that are wanted in total.
        holds_position: craft whose reference holds the position, (C,).
        state: states by which the craft steer, NaN where unknown.
        orbit: the lighthouse's orbit.
    """
    pull = orbital_acceleration(orbit, state.position, state.velocity)
    known = holds_position[:, None] & np.isfinite(pull).all(axis=1, keepdims=True)
    return order._replace(acceleration=order.acceleration - np.where(known, pull, 0.0))


def wrench(order: Command, reference: Reference, state: State, mass: Floats, inertia: Floats) -> tuple[Floats, Floats]:
    """Return the wrench that produces the ordered accelerations, zero torque for a craft that does not know its state.

    Args:
        order: accelerations of C craft.
        reference: references of the craft.
        state: states by which the craft steer, NaN where unknown.
        mass: (C,) [kg].
        inertia: inertia about the centre of mass, body frame, (C, 3, 3) [kg m^2].

    Returns:
        Force (C, 3) [N] and torque (C, 3) [N m] about the centre of mass, lighthouse frame.
    """
    torque = np.zeros((len(mass), 3))
    believed = _contiguous(state)
    _torque_into(
        order.angular_acceleration,
        reference.holds_attitude,
        believed.rotation,
        believed.angular_rate,
        believed.position,
        inertia,
        torque,
    )
    return mass[:, None] * order.acceleration, torque


def _contiguous(state: State) -> State:
    return State(
        rotation=np.ascontiguousarray(state.rotation, dtype=np.float64),
        position=np.ascontiguousarray(state.position, dtype=np.float64),
        velocity=np.ascontiguousarray(state.velocity, dtype=np.float64),
        angular_rate=np.ascontiguousarray(state.angular_rate, dtype=np.float64),
    )


@kernel
def _command_into(
    to_position: Floats,
    to_velocity: Floats,
    with_acceleration: Floats,
    to_rotation: Floats,
    to_rate: Floats,
    with_angular_acceleration: Floats,
    holds_position: Bools,
    holds_attitude: Bools,
    rotation: Floats,
    rate: Floats,
    position: Floats,
    velocity: Floats,
    stiffness: Floats,
    damping: Floats,
    acceleration: Floats,
    angular_acceleration: Floats,
) -> None:
    """Write `command` of every craft into `acceleration` and `angular_acceleration`, (C, 3) each, initially zero."""
    difference, error = scratch(0.0, 3, 3), scratch(0.0, 3)
    turn_stiffness, turn_damping = ATTITUDE_FREQUENCY_RAD_S**2, 2 * DAMPING * ATTITUDE_FREQUENCY_RAD_S
    for c in range(len(position)):
        if not np.isfinite(position[c, 0] + position[c, 1] + position[c, 2]):
            continue
        if holds_position[c]:
            for i in range(3):
                acceleration[c, i] = (
                    with_acceleration[c, i]
                    + stiffness[c] * (to_position[c, i] - position[c, i])
                    + damping[c] * (to_velocity[c, i] - velocity[c, i])
                )
        if holds_attitude[c]:
            multiply_into(to_rotation[c], rotation[c].T, difference)
            log_into(difference, error)
            for i in range(3):
                angular_acceleration[c, i] = (
                    with_angular_acceleration[c, i]
                    + turn_stiffness * error[i]
                    + turn_damping * (to_rate[c, i] - rate[c, i])
                )


@kernel
def _torque_into(
    change: Floats,
    holds_attitude: Bools,
    rotation: Floats,
    rate: Floats,
    position: Floats,
    inertia: Floats,
    torque: Floats,
) -> None:
    """Write the torque of `wrench` into `torque` (C, 3), initially zero."""
    half, turned = scratch(0.0, 3, 3), scratch(0.0, 3, 3)
    for c in range(len(change)):
        w = rate[c]
        known = np.isfinite(position[c, 0] + position[c, 1] + position[c, 2] + w[0] + w[1] + w[2])
        if not (holds_attitude[c] and known):
            continue
        multiply_into(rotation[c], inertia[c], half)
        multiply_into(half, rotation[c].T, turned)
        h0 = turned[0, 0] * w[0] + turned[0, 1] * w[1] + turned[0, 2] * w[2]
        h1 = turned[1, 0] * w[0] + turned[1, 1] * w[1] + turned[1, 2] * w[2]
        h2 = turned[2, 0] * w[0] + turned[2, 1] * w[1] + turned[2, 2] * w[2]
        torque[c, 0], torque[c, 1], torque[c, 2] = w[1] * h2 - w[2] * h1, w[2] * h0 - w[0] * h2, w[0] * h1 - w[1] * h0
        for i in range(3):
            for j in range(3):
                torque[c, i] += turned[i, j] * change[c, j]
