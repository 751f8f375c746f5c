"""A pilot whose wrench comes from outside: the orders to thrusters, wheels and filter are made as on any craft.

The wrench is in the body frame. A craft turns it into the lighthouse frame by its own estimated attitude, as everything
on board does, and gives its filter the accelerations that it stands for:

    a = R f / m,    w' = R I^-1 (t - w_b x I w_b)
"""

from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.state import Reference, State
from swarm.messages import Command, Order
from swarm.onboard.pilot import Pilot


class RemotePilot(Pilot):
    """Steers every craft by its own estimate, with the wrench that was set last.

    force, torque: in the body frames, (C, 3) [N] and (C, 3) [N m].
    """

    def __init__(self, *parts: Any) -> None:
        """Take the parts of a pilot; which craft the scenario steers by the truth is ignored."""
        super().__init__(*parts)
        self.by_estimate = np.ones(self._craft, dtype=np.bool_)
        self.force, self.torque = np.zeros((2, self._craft, 3))

    def reference(self, time_s: float) -> Reference:
        """Return the states that the scenario's motions want at a time [s]."""
        return self._motions.at(time_s)

    def steer(self, time_s: float, told: State, idle: Bools) -> Order:
        """Return the orders of every craft for the period that begins.

        Args:
            time_s: beginning of the period [s].
            told: true states; not used.
            idle: craft whose control does nothing, (C,).
        """
        believed = self._believed(told, idle)
        self._reference = self.reference(time_s)
        able: Bools = np.isfinite(believed.rotation.sum(axis=(1, 2)) + believed.angular_rate.sum(axis=1))
        rotation = np.where(able[:, None, None], believed.rotation, np.eye(3))
        rate = np.where(able[:, None], believed.angular_rate, 0.0)
        force = np.where(able[:, None], _turned(rotation, self.force), 0.0)
        torque = np.where(able[:, None], _turned(rotation, self.torque), 0.0)
        return self._actuation.order(force, torque, believed, self._accelerations(rotation, rate, able))

    def _accelerations(self, rotation: Floats, rate: Floats, able: Bools) -> Command:
        spin = _turned(np.swapaxes(rotation, 1, 2), rate)
        momentum = _turned(self._body.inertia, spin)
        turning = np.linalg.solve(self._body.inertia, (self.torque - np.cross(spin, momentum))[..., None])[..., 0]
        command = Command(
            _turned(rotation, self.force) / self._body.mass[:, None],
            _turned(rotation, np.where(self.torque.any(axis=1, keepdims=True), turning, 0.0)),
        )
        return command.only(able)


def _turned(matrices: Floats, vectors: Floats) -> Floats:
    out: Floats = (matrices @ vectors[..., None])[..., 0]
    return out
