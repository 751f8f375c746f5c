"""The wrench that keeps a craft on its reference: proportional-derivative feedback with feed-forward.

    F = m (a_ref + w_p^2 (p_ref - p) + 2 z w_p (v_ref - v))                       [N], lighthouse frame
    M = I (alpha_ref + w_a^2 e + 2 z w_a (w_ref - w)) + w x I w                   [N m], lighthouse frame

with e = log(R_ref R^T) the attitude error as an active rotation vector in the lighthouse frame, I the inertia about
the centre of mass turned into that frame, and the gyroscopic torque cancelled. The closed loop of each axis is a
second-order system of natural frequency w_p (w_a) and damping z. The wrench is ideal: no thruster limits it.
"""

from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.error_state import log_into
from estimators.kernel import kernel
from estimators.rotation import multiply_into
from swarm.motion.fleet import Reference

POSITION_FREQUENCY_RAD_S = 1.0
ATTITUDE_FREQUENCY_RAD_S = 2.0
DAMPING = 0.9


class State(NamedTuple):
    """Where C craft are, or believe to be: rotation (C, 3, 3), angular_rate (C, 3) [rad/s], position (C, 3) [m],
    velocity (C, 3) [m/s]; NaN where unknown.
    """

    rotation: Floats
    angular_rate: Floats
    position: Floats
    velocity: Floats

    def ahead(self, time_s: float) -> "State":
        """The state `time_s` later if the rates stay as they are."""
        return self._replace(
            rotation=rot.exp(self.angular_rate * time_s) @ self.rotation,
            position=self.position + self.velocity * time_s,
        )

    def where(self, mask: Bools, other: "State") -> "State":
        """This state for the craft in `mask` (C,), `other` for the rest."""
        flat = np.reshape(mask, (-1, 1))
        return State(
            np.where(mask.reshape(-1, 1, 1), self.rotation, other.rotation),
            np.where(flat, self.angular_rate, other.angular_rate),
            np.where(flat, self.position, other.position),
            np.where(flat, self.velocity, other.velocity),
        )


def unknown(craft: int) -> State:
    """The state of craft that know nothing."""
    nothing = np.full((craft, 3), np.nan)
    return State(np.full((craft, 3, 3), np.nan), nothing, nothing, nothing)


class Command(NamedTuple):
    """What C craft order their actuators to do for one period: acceleration (C, 3) [m/s^2] and angular_acceleration
    (C, 3) [rad/s^2], lighthouse frame; zero where a craft orders nothing.
    """

    acceleration: Floats
    angular_acceleration: Floats

    def only(self, mask: Bools) -> "Command":
        """The command of the craft in `mask` (C,), zero for the rest."""
        flat = np.reshape(mask, (-1, 1))
        return Command(np.where(flat, self.acceleration, 0.0), np.where(flat, self.angular_acceleration, 0.0))


def command(reference: Reference, state: State) -> Command:
    """The feedback above; zero where `state` is NaN, as where the reference holds neither position nor attitude."""
    out = Command(*np.zeros((2, len(reference.position), 3)))
    _command_into(*reference, *_contiguous(state), *out)
    return out


def wrench(order: Command, reference: Reference, state: State, mass: Floats, inertia: Floats) -> tuple[Floats, Floats]:
    """Force (C, 3) [N] and torque (C, 3) [N m] about the centre of mass, lighthouse frame, that do what is ordered.

    mass: (C,) [kg]. inertia: (C, 3, 3) [kg m^2] in the body frame. A craft that does not know its state does nothing.
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
    return State(*(np.ascontiguousarray(part, dtype=np.float64) for part in state))


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
    acceleration: Floats,
    angular_acceleration: Floats,
) -> None:
    """`command` of every craft, into (C, 3) each, which are zero."""
    difference, error = np.empty((3, 3)), np.empty(3)
    stiffness, damping = POSITION_FREQUENCY_RAD_S**2, 2 * DAMPING * POSITION_FREQUENCY_RAD_S
    turn_stiffness, turn_damping = ATTITUDE_FREQUENCY_RAD_S**2, 2 * DAMPING * ATTITUDE_FREQUENCY_RAD_S
    for c in range(len(position)):
        if not np.isfinite(position[c, 0] + position[c, 1] + position[c, 2]):
            continue
        if holds_position[c]:
            for i in range(3):
                acceleration[c, i] = (
                    with_acceleration[c, i]
                    + stiffness * (to_position[c, i] - position[c, i])
                    + damping * (to_velocity[c, i] - velocity[c, i])
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
    """The torque of `wrench`, into (C, 3), which is zero."""
    half, turned = np.empty((3, 3)), np.empty((3, 3))
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
