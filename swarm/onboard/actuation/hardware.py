"""The thrusters and wheels of all craft that have some, side by side, as they were designed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from swarm.hardware import Thrusters, Wheels


class Fitted(NamedTuple):
    """One craft's actuators. errors: 1 sigma of a thruster's relative error of force, and of its tilt [rad]. key: of
    the craft's random numbers.
    """

    thrusters: Thrusters
    wheels: Wheels
    errors: tuple[float, float]
    key: int


class Hardware(NamedTuple):
    """The actuators of A craft, body frame, padded to the most thrusters N and wheels W of any; zeros are padding.

    who: (A,), the craft that have some. force: (A, N, 3) [N] while open. arm: (A, N, 3) [m] from the centre
    of mass. shortest_s: (A, N), the shortest pulse. has_thruster: (A, N). axis: (A, W, 3). torque_nm: (A, W) [N m] and
    momentum_nms: (A, W) [N m s], the most of a wheel.
    """

    who: Ints
    force: Floats
    arm: Floats
    shortest_s: Floats
    has_thruster: Bools
    axis: Floats
    torque_nm: Floats
    momentum_nms: Floats

    @property
    def effect(self) -> Floats:
        """Force [N] and torque [N m] about the centre of mass, (A, 6, N + W), of all at their most."""
        wheels = self.axis * self.torque_nm[..., None]
        force = np.concatenate([self.force, np.zeros_like(wheels)], axis=1)
        torque = np.concatenate([np.cross(self.arm, self.force), wheels], axis=1)
        out: Floats = np.swapaxes(np.concatenate([force, torque], axis=2), 1, 2).copy()
        return out


def hardware(fitted: Sequence[Fitted], com_m: Floats) -> Hardware:
    """The actuators of every craft that has some. com_m: (C, 3) [m], centres of mass."""
    thrusters = [len(f.thrusters.force_n) for f in fitted]
    wheels = [len(f.wheels.torque_nm) for f in fitted]
    who = [i for i in range(len(fitted)) if thrusters[i] or wheels[i]]
    shape, wheel_shape = (len(who), max(thrusters, default=0)), (len(who), max(wheels, default=0))
    out = Hardware(
        who=np.array(who, dtype=np.int64),
        force=np.zeros((*shape, 3)),
        arm=np.zeros((*shape, 3)),
        shortest_s=np.zeros(shape),
        has_thruster=np.zeros(shape, dtype=np.bool_),
        axis=np.zeros((*wheel_shape, 3)),
        torque_nm=np.zeros(wheel_shape),
        momentum_nms=np.zeros(wheel_shape),
    )
    for a, craft in enumerate(who):
        f, n, w = fitted[craft], thrusters[craft], wheels[craft]
        out.force[a, :n] = -f.thrusters.force_n[:, None] * f.thrusters.exhaust
        out.arm[a, :n] = f.thrusters.point_m - com_m[craft]
        out.shortest_s[a, :n] = f.thrusters.minimum_impulse_ns / f.thrusters.force_n
        out.has_thruster[a, :n] = True
        out.axis[a, :w], out.torque_nm[a, :w], out.momentum_nms[a, :w] = f.wheels
    return out
