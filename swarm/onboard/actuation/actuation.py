"""From the wrench that control wants to what each craft orders its thrusters and wheels to do.

A craft turns the wanted force and torque into its body frame by the attitude that it believes in, and orders pulses and
wheel torques (`swarm.onboard.actuation.orders`). The orders stand for accelerations, which its own navigation takes
into account. A craft without thrusters orders the wanted force itself, one with neither thrusters nor wheels the whole
wrench.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.state import State
from swarm.hardware import ActuatorSet
from swarm.messages import Command, Order
from swarm.onboard.actuation.orders import BodyOrder, Orders


class Actuation:
    """The actuator computers of C craft, of which A carry thrusters or wheels."""

    def __init__(self, actuators: ActuatorSet, mass: Floats, inertia: Floats, period_s: float) -> None:
        """Take the design of the actuators and of the craft.

        Args:
            actuators: thrusters and wheels of the A craft that carry some.
            mass: (C,) [kg].
            inertia: (C, 3, 3) [kg m^2] about the centre of mass, body frame.
            period_s: length of a lighthouse period [s].
        """
        self._orders = Orders(actuators, period_s)
        self._who, self._mass, self._inertia = actuators.who, mass, inertia[actuators.who]
        self._thrusting = actuators.thrusting(len(mass))
        self._nothing = np.zeros(actuators.has_thruster.shape), np.zeros(actuators.torque_nm.shape)

    def order(self, force: Floats, torque: Floats, believed: State, command: Command) -> Order:
        """Order what comes nearest to the wanted wrench.

        Args:
            force: (C, 3) [N], wanted, lighthouse frame.
            torque: (C, 3) [N m], wanted, about the centre of mass, lighthouse frame.
            believed: the states in which the wrench is wanted; a craft that does not know its attitude orders nothing.
            command: the accelerations that the wanted wrench stands for.
        """
        who = self._who
        if not len(who):
            return Order(force, torque, *self._nothing, self._orders.stored, command)
        rotation, rate = believed.rotation[who], believed.angular_rate[who]
        able: Bools = np.isfinite(np.sum(rotation, axis=(1, 2)) + np.sum(rate, axis=1))
        rotation, rate = np.where(able[:, None, None], rotation, np.eye(3)), np.where(able[:, None], rate, 0.0)
        into_body = np.swapaxes(rotation, 1, 2)
        body_force, body_torque, body_rate = (
            (into_body @ vector[..., None])[..., 0]
            for vector in (np.where(self._thrusting[who, None], force[who], 0.0), torque[who], rate)
        )
        stored = self._orders.stored
        given = self._orders.give(body_force, body_torque, body_rate, able)
        force, torque = force.copy(), torque.copy()
        force[self._thrusting], torque[who] = 0.0, 0.0
        ordered = self._accelerations(command, given, rotation, body_rate, stored)
        return Order(force, torque, given.open_s, given.wheel_torque, self._orders.stored, ordered)

    def _accelerations(
        self, command: Command, given: BodyOrder, rotation: Floats, rate: Floats, stored: Floats
    ) -> Command:
        """Return the accelerations that the orders stand for: F / m, and I^-1 (M - w x (I w + h)), lighthouse frame."""
        who, thrusting = self._who, self._thrusting[self._who]
        momentum = (self._inertia @ rate[..., None])[..., 0] + stored
        change = np.linalg.solve(self._inertia, (given.wrench[:, 3:] - np.cross(rate, momentum))[..., None])
        linear = rotation @ (given.wrench[:, :3] / self._mass[who, None])[..., None]
        acceleration, angular_acceleration = command.acceleration.copy(), command.angular_acceleration.copy()
        acceleration[who[thrusting]] = linear[thrusting, :, 0]
        angular_acceleration[who] = (rotation @ change)[..., 0]
        return Command(acceleration, angular_acceleration)
