"""Conversion of the wanted wrench into each craft's orders to its thrusters and wheels.

A craft turns the wanted force and torque into its body frame by its estimated attitude, and orders pulses and wheel
torques (`swarm.onboard.actuation.orders`). The orders correspond to accelerations, which its own navigation takes into
account. A craft without thrusters orders the wanted force itself; a craft with neither thrusters nor wheels orders the
whole wrench.
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
            mass: mass of each craft, (C,) [kg].
            inertia: inertia about the centre of mass, body frame, (C, 3, 3) [kg m^2].
            period_s: length of a lighthouse period [s].
        """
        self._orders = Orders(actuators, period_s)
        self._who, self._mass, self._inertia = actuators.who, mass, inertia
        self._thrusting = actuators.thrusting(len(mass))
        self._nothing = np.zeros(actuators.has_thruster.shape), np.zeros(actuators.torque_nm.shape)

    def order(self, force: Floats, torque: Floats, believed: State, command: Command) -> Order:
        """Return the orders that come nearest to the wanted wrench.

        Args:
            force: wanted force, lighthouse frame, (C, 3) [N].
            torque: wanted torque about the centre of mass, lighthouse frame, (C, 3) [N m].
            believed: states for which the wrench is wanted; a craft that does not know its attitude orders nothing.
            command: accelerations that the wanted wrench corresponds to.
        """
        who = self._who
        still: Bools = (torque[:, 0] == 0) & (torque[:, 1] == 0) & (torque[:, 2] == 0)
        if not len(who):
            return Order(force, torque, *self._nothing, self._orders.stored, self._told(command, still))
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
        still[who] = ~np.any([given.wrench[:, 3:], stored, self._orders.stored], axis=(0, 2))
        ordered = self._told(self._accelerations(command, given, rotation, body_rate, stored), still)
        return Order(force, torque, given.open_s, given.wheel_torque, self._orders.stored, ordered)

    def _accelerations(
        self, command: Command, given: BodyOrder, rotation: Floats, rate: Floats, stored: Floats
    ) -> Command:
        """Return the accelerations that the orders cause: F / m, and I^-1 (M - w x (I w + h)), lighthouse frame."""
        who, thrusting = self._who, self._thrusting[self._who]
        inertia = self._inertia[who]
        momentum = (inertia @ rate[..., None])[..., 0] + stored
        change = np.linalg.solve(inertia, (given.wrench[:, 3:] - np.cross(rate, momentum))[..., None])
        linear = rotation @ (given.wrench[:, :3] / self._mass[who, None])[..., None]
        acceleration, angular_acceleration = command.acceleration.copy(), command.angular_acceleration.copy()
        acceleration[who[thrusting]] = linear[thrusting, :, 0]
        angular_acceleration[who] = (rotation @ change)[..., 0]
        return Command(acceleration, angular_acceleration)

    def _told(self, command: Command, still: Bools) -> Command:
        """Return the command with the inertia of the craft that order no torque, (C,)."""
        if not still.any():
            return command
        return command._replace(inertia=np.where(still[:, None, None], self._inertia, np.nan))
