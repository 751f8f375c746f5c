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
    acceleration = (
        reference.acceleration
        + POSITION_FREQUENCY_RAD_S**2 * (reference.position - state.position)
        + 2 * DAMPING * POSITION_FREQUENCY_RAD_S * (reference.velocity - state.velocity)
    )
    known = np.all(np.isfinite(state.position), axis=1)
    rotation = np.where(known[:, None, None], state.rotation, np.eye(3))
    attitude_error = rot.log(reference.rotation @ np.swapaxes(rotation, -1, -2))
    angular_acceleration = (
        reference.angular_acceleration
        + ATTITUDE_FREQUENCY_RAD_S**2 * attitude_error
        + 2 * DAMPING * ATTITUDE_FREQUENCY_RAD_S * (reference.angular_rate - state.angular_rate)
    )
    return Command(
        np.where(reference.holds_position[:, None] & known[:, None], acceleration, 0.0),
        np.where(reference.holds_attitude[:, None] & known[:, None], angular_acceleration, 0.0),
    )


def wrench(order: Command, reference: Reference, state: State, mass: Floats, inertia: Floats) -> tuple[Floats, Floats]:
    """Force (C, 3) [N] and torque (C, 3) [N m] about the centre of mass, lighthouse frame, that do what is ordered.

    mass: (C,) [kg]. inertia: (C, 3, 3) [kg m^2] in the body frame. A craft that does not know its state does nothing.
    """
    known = np.all(np.isfinite(state.position), axis=1)
    rotation = np.where(known[:, None, None], state.rotation, np.eye(3))
    turned = rotation @ inertia @ np.swapaxes(rotation, -1, -2)
    momentum = (turned @ state.angular_rate[..., None])[..., 0]
    torque = (turned @ order.angular_acceleration[..., None])[..., 0] + np.cross(state.angular_rate, momentum)
    acts = reference.holds_attitude[:, None] & np.isfinite(torque)
    return mass[:, None] * order.acceleration, np.where(acts, torque, 0.0)
