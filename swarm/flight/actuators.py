"""From the wrench that the control wants to what moves the craft: their orders, and what thrusters and wheels give.

A craft turns the wanted force and torque into its body frame by the attitude that it believes in, and orders pulses and
wheel torques (`orders`). In the world every pulse has its thruster's own error and faults (`execution`) and turns with
the craft's true attitude, and the wheels' momentum turns with the craft. Propellant is not taken off the mass.

A craft whose model has no thrusters gets the ideal force, one with neither thrusters nor wheels the ideal wrench.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.state import State
from swarm.onboard.actuation.hardware import Fitted, hardware
from swarm.onboard.actuation.modulation import open_share
from swarm.onboard.actuation.orders import Order, Orders
from swarm.onboard.control import Command
from swarm.results.period import ActuatorWork
from swarm.world.execution import ActuatorFaults, executed, obeyed
from swarm.world.wrench import OnboardWrench


class Drive(NamedTuple):
    """What moves C craft in one period. force (C, 3) [N], torque (C, 3) [N m]: ideal, in the lighthouse frame, of those
    without actuators. onboard: of the others; None: there are none. command: what all of them have ordered.
    """

    force: Floats
    torque: Floats
    onboard: OnboardWrench | None
    command: Command


class Actuators:
    """Thrusters and wheels of C craft; the wheels turn on from one period to the next.

    most_thrusters: N, as many as the craft that has most.
    """

    def __init__(
        self,
        fitted: Sequence[Fitted],
        mass: Floats,
        com_m: Floats,
        inertia: Floats,
        period_s: float,
        steps: int,
        seed: int = 0,
    ) -> None:
        """fitted: of every craft, without thrusters and wheels for an ideal one. mass (C,) [kg], com_m (C, 3) [m],
        inertia (C, 3, 3) [kg m^2], body frame. steps: of the physics in a period of `period_s`. seed: draws the errors.
        """
        self._hardware = hardware(fitted, com_m)
        self._true_force = np.zeros_like(self._hardware.force)
        for a, craft in enumerate(self._hardware.who.tolist()):
            f = fitted[craft]
            self._true_force[a, : len(f.thrusters.force_n)] = executed(f.thrusters, f.errors, f.key, seed)
        self._orders = Orders(self._hardware, period_s)
        self._period_s, self._steps, self._mass = period_s, steps, mass
        self._inertia = inertia[self._hardware.who]
        self._pulse_torque = np.cross(self._hardware.arm, self._true_force)
        self._thrusting: Bools = np.array([len(f.thrusters.force_n) > 0 for f in fitted], dtype=np.bool_)
        self._has_wheels: Bools = np.array([len(f.wheels.torque_nm) > 0 for f in fitted], dtype=np.bool_)
        self.most_thrusters = self._hardware.has_thruster.shape[1]
        self._delta_v = np.zeros(len(fitted))
        self._open = np.zeros((len(fitted), self.most_thrusters), dtype=np.bool_)

    @property
    def fitted(self) -> bool:
        """A craft has thrusters or wheels."""
        return len(self._hardware.who) > 0

    def work(self) -> ActuatorWork:
        """Return what has been done up to the end of the last period."""
        momentum = np.full(len(self._delta_v), np.nan)
        momentum[self._hardware.who] = np.linalg.norm(self._orders.stored, axis=1)
        firing = np.where(self._thrusting, np.count_nonzero(self._open, axis=1), np.nan)
        momentum[~self._has_wheels] = np.nan
        return ActuatorWork(self._delta_v.copy(), firing, momentum)

    def drive(
        self, force: Floats, torque: Floats, believed: State, command: Command, faults: ActuatorFaults | None = None
    ) -> Drive:
        """Make force (C, 3) [N] and torque (C, 3) [N m], lighthouse frame, that the control wants for one period.

        believed: the state that they were wanted in. command: the accelerations that they stand for. faults: thrusters
        that do not obey, which nobody on board knows.
        """
        ideal, who = ~self._thrusting, self._hardware.who
        self._delta_v[ideal] += np.linalg.norm(force[ideal], axis=1) / self._mass[ideal] * self._period_s
        if not len(who):
            return Drive(force, torque, None, command)
        # A craft that does not know how it is turned can order nothing.
        rotation, rate = believed.rotation[who], believed.angular_rate[who]
        able: Bools = np.isfinite(np.sum(rotation, axis=(1, 2)) + np.sum(rate, axis=1))
        rotation, rate = np.where(able[:, None, None], rotation, np.eye(3)), np.where(able[:, None], rate, 0.0)
        into_body = np.swapaxes(rotation, 1, 2)
        body_force, body_torque, body_rate = (
            (into_body @ vector[..., None])[..., 0]
            for vector in (np.where(self._thrusting[who, None], force[who], 0.0), torque[who], rate)
        )
        stored = self._orders.stored
        order = self._orders.give(body_force, body_torque, body_rate, able)

        command = self._ordered(command, order, rotation, body_rate, stored)
        onboard = self._execute(order, obeyed(self._opened(order), who, faults))
        force, torque = force.copy(), torque.copy()
        force[self._thrusting], torque[who] = 0.0, 0.0
        return Drive(force, torque, onboard, command)

    def _ordered(self, command: Command, order: Order, rotation: Floats, rate: Floats, stored: Floats) -> Command:
        """The accelerations (lighthouse frame) that the order stands for: F / m, and I^-1 (M - w x (I w + h))."""
        who, thrusting = self._hardware.who, self._thrusting[self._hardware.who]
        momentum = (self._inertia @ rate[..., None])[..., 0] + stored
        change = np.linalg.solve(self._inertia, (order.wrench[:, 3:] - np.cross(rate, momentum))[..., None])
        linear = rotation @ (order.wrench[:, :3] / self._mass[who, None])[..., None]
        acceleration, angular_acceleration = (part.copy() for part in command)
        acceleration[who[thrusting]] = linear[thrusting, :, 0]
        angular_acceleration[who] = (rotation @ change)[..., 0]
        return Command(acceleration, angular_acceleration)

    def _opened(self, order: Order) -> Floats:
        """Share (S, A, N) of each physics step in which a thruster is open by order."""
        return open_share(order.open_s, self._period_s, self._steps)

    def _execute(self, order: Order, opened: Floats) -> OnboardWrench:
        """What thrusters that are open for shares (S, A, N) of the steps, and the wheels, do; it is booked, too."""
        parts, who = self._hardware, self._hardware.who
        out = OnboardWrench(*np.zeros((3, self._steps, len(self._delta_v), 3)))
        wheels = np.einsum("aw,awi->ai", order.wheel_torque, parts.axis)
        out.force[:, who] = np.einsum("san,ani->sai", opened, self._true_force)
        out.torque[:, who] = np.einsum("san,ani->sai", opened, self._pulse_torque) + wheels
        # Stored now is what the wheels have at the end: in mid-step, before, they had lost less to the craft.
        to_go = self._period_s * (1 - (np.arange(self._steps) + 0.5) / self._steps)
        out.wheel_momentum[:, who] = self._orders.stored + to_go[:, None, None] * wheels
        size = np.linalg.norm(self._true_force, axis=2)
        impulse = np.einsum("san,an->a", opened, size) * self._period_s / self._steps
        self._delta_v[who] += impulse / self._mass[who]
        self._open[who] = (opened > 0).any(axis=0) & parts.has_thruster
        return out
