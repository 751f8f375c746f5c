"""The execution of orders by thrusters and wheels: the wrench on every craft, and the work done.

In the world every pulse has its thruster's own error and faults (`swarm.world.execution`) and turns with the craft's
true attitude, and the wheels' momentum turns with the craft. Propellant is not taken off the mass.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from swarm.hardware import ActuatorSet, Fitted
from swarm.messages import Order
from swarm.world.execution import StuckThruster, executed, obeyed, open_share
from swarm.world.wrench import OnboardWrench


class Drive(NamedTuple):
    """Wrench on C craft in one period.

    force: force on the craft without actuators, (C, 3) [N], lighthouse frame.
    torque: torque on the craft without actuators, (C, 3) [N m], lighthouse frame.
    onboard: wrench of the other craft's actuators; None where there are none.
    """

    force: Floats
    torque: Floats
    onboard: OnboardWrench | None


class ActuatorWork(NamedTuple):
    """True work of C craft's actuators up to the end of a period, (C,) each; NaN where a craft has no such actuator.

    delta_v_m_s: impulse of the thrusters, or of the ideal force, over the mass [m/s].
    thrusters_open: number of thrusters that were open in the period.
    wheel_momentum_nms: magnitude of the reaction wheels' total momentum [N m s].
    """

    delta_v_m_s: Floats
    thrusters_open: Floats
    wheel_momentum_nms: Floats


class Actuators:
    """The thrusters and wheels of C craft with their true errors."""

    def __init__(
        self,
        fitted: Sequence[Fitted],
        actuators: ActuatorSet,
        mass: Floats,
        period_s: float,
        steps: int,
        seed: int = 0,
    ) -> None:
        """Draw the thrusters' errors.

        Args:
            fitted: thrusters and wheels of every craft, C in number.
            actuators: thrusters and wheels of the A craft that carry some, padded.
            mass: masses, (C,) [kg].
            period_s: length of a lighthouse period [s].
            steps: number of physics steps in a period.
            seed: seed of the thrusters' errors.
        """
        self._set, self._mass = actuators, mass
        self._period_s, self._steps = period_s, steps
        self._force = np.zeros_like(actuators.force)
        for a, craft in enumerate(actuators.who.tolist()):
            f = fitted[craft]
            self._force[a, : len(f.thrusters.force_n)] = executed(f.thrusters, f.errors, f.key, seed)
        self._pulse_torque = np.cross(actuators.arm, self._force)
        self._thrusting = actuators.thrusting(len(fitted))
        self._has_wheels: Bools = np.array([len(f.wheels.torque_nm) > 0 for f in fitted], dtype=np.bool_)
        self._delta_v = np.zeros(len(fitted))
        self._open = np.zeros((len(fitted), actuators.has_thruster.shape[1]), dtype=np.bool_)
        self._momentum = np.full(len(fitted), np.nan)

    @property
    def any(self) -> bool:
        """True where any craft carries thrusters or wheels."""
        return len(self._set.who) > 0

    def drive(self, order: Order, stuck: Sequence[StuckThruster] = ()) -> Drive:
        """Carry out an order, and return the wrench on the craft.

        stuck: thrusters that do not obey, unknown on board.
        """
        who = self._set.who
        _add_delta_v(order.force, self._thrusting, self._mass, self._period_s, self._delta_v)
        if not len(who):
            return Drive(order.force, order.torque, None)
        opened = obeyed(open_share(order.open_s, self._period_s, self._steps), who, stuck)
        out = OnboardWrench(*np.zeros((3, self._steps, len(self._mass), 3)))
        wheels = np.einsum("aw,awi->ai", order.wheel_torque, self._set.axis)
        out.force[:, who] = np.einsum("san,ani->sai", opened, self._force)
        out.torque[:, who] = np.einsum("san,ani->sai", opened, self._pulse_torque) + wheels
        # The order gives the wheels' momentum at the end of the period; by mid-step less of it has gone to the craft.
        to_go = self._period_s * (1 - (np.arange(self._steps) + 0.5) / self._steps)
        out.wheel_momentum[:, who] = order.wheel_momentum + to_go[:, None, None] * wheels
        impulse = np.einsum("san,an->a", opened, np.linalg.norm(self._force, axis=2)) * self._period_s / self._steps
        self._delta_v[who] += impulse / self._mass[who]
        self._open[who] = (opened > 0).any(axis=0) & self._set.has_thruster
        self._momentum[who] = np.linalg.norm(order.wheel_momentum, axis=1)
        return Drive(order.force, order.torque, out)

    def work(self) -> ActuatorWork:
        """Return the work done up to the end of the last period."""
        if not self.any:
            return ActuatorWork(self._delta_v.copy(), *np.full((2, len(self._mass)), np.nan))
        firing = np.where(self._thrusting, np.count_nonzero(self._open, axis=1), np.nan)
        momentum = np.where(self._has_wheels, self._momentum, np.nan)
        return ActuatorWork(self._delta_v.copy(), firing, momentum)


@kernel
def _add_delta_v(force: Floats, thrusting: Bools, mass: Floats, period_s: float, delta_v: Floats) -> None:
    """Add what a period's ideal force (C, 3) [N] on the craft without thrusters does to `delta_v` (C,) [m/s]."""
    for c in range(len(mass)):
        if not thrusting[c]:
            x, y, z = force[c, 0], force[c, 1], force[c, 2]
            delta_v[c] += np.sqrt(x * x + y * y + z * z) / mass[c] * period_s
