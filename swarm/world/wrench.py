"""Wrench on the craft in a physics step: a constant one, the actuators' in the body frame, and the orbit's."""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.rotation import quaternion_rows
from swarm.world.orbit import orbit_acceleration_into


class OnboardWrench(NamedTuple):
    """Wrench of the craft's own actuators in each physics step of a period, (S, C, 3), body frame.

    force: force through the centre of mass [N].
    torque: torque about the centre of mass [N m].
    wheel_momentum: momentum of the wheels in mid-step, which turns with the craft [N m s].
    """

    force: Floats
    torque: Floats
    wheel_momentum: Floats


def most_force(
    pose: Floats,
    rate: Floats,
    mass: Floats,
    com_m: Floats,
    force: Floats,
    onboard: OnboardWrench | None,
    n: float,
    period_s: float,
) -> Floats:
    """Return a force (C, 3) [N] at least as large as any on a craft within one period, for the search for contacts.

    Args:
        pose: MuJoCo's position and quaternion at the beginning, (C, 7).
        rate: MuJoCo's velocity and body angular rate at the beginning, (C, 6).
        mass: masses, (C,) [kg].
        com_m: centres of mass, (C, 3) [m], body frame.
        force: constant force, (C, 3) [N].
        onboard: wrench of the actuators, if any.
        n: the orbit's mean motion, 0 without one [rad/s].
        period_s: length of a lighthouse period [s].
    """
    push = np.linalg.norm(force, axis=1)
    if onboard is not None:
        push += np.linalg.norm(onboard.force, axis=2).max(axis=0)
    # (CW) is at most 3 n^2 |p| + 2 n |v|; within a period it grows by a fraction of n T, and by 2 n T of the push.
    arm = np.linalg.norm(com_m, axis=1)
    distance = np.linalg.norm(pose[:, :3], axis=1) + arm
    speed = np.linalg.norm(rate[:, :3], axis=1) + np.linalg.norm(rate[:, 3:], axis=1) * arm
    orbital = mass * (3 * n**2 * distance + 2 * n * speed)
    most: Floats = np.zeros_like(force)
    most[:, 0] = (push + orbital) * (1 + 8 * n * period_s)
    return most


@kernel
def wrench_into(
    pose: Floats,
    rate: Floats,
    com: Floats,
    mass: Floats,
    force: Floats,
    torque: Floats,
    onboard_force: Floats,
    onboard_torque: Floats,
    wheel_momentum: Floats,
    axes: Floats,
    n: float,
    h: float,
    d: float,
    s: float,
    b: float,
    out: Floats,
) -> None:
    """Write force and torque about the centre of mass, lighthouse frame, for one step.

    The wrench is the sum of the constant one, the actuators' from the body frame, the wheels' torque -w x h, and the
    orbit's force. The orbit's arguments `axes` to `b` are the fields of an `OrbitStep`.

    Args:
        pose: MuJoCo's position and quaternion, (C, 7).
        rate: MuJoCo's velocity and body angular rate, (C, 6).
        com: centres of mass, (C, 3) [m], body frame.
        mass: masses, (C,) [kg].
        force: constant force, (C, 3) [N], lighthouse frame.
        torque: constant torque, (C, 3) [N m], lighthouse frame.
        onboard_force: force of the actuators, (C, 3) [N], body frame.
        onboard_torque: torque of the actuators, (C, 3) [N m], body frame.
        wheel_momentum: momentum of the wheels, (C, 3) [N m s], body frame.
        axes: V-bar, H-bar, R-bar as rows in the lighthouse frame, (3, 3).
        n: mean motion [rad/s].
        h: length of the step [s].
        d: coefficient d [1/s].
        s: coefficient s [1/s^2].
        b: coefficient b [1/s].
        out: output, force [N] and torque [N m], (C, 6).
    """
    place, speed, pull, body = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    for c in range(len(pose)):
        p, q, r = rate[c, 3], rate[c, 4], rate[c, 5]
        cx, cy, cz = com[c, 0], com[c, 1], com[c, 2]
        h0, h1, h2 = wheel_momentum[c, 0], wheel_momentum[c, 1], wheel_momentum[c, 2]
        # In the body frame: the velocity of the centre of mass about the origin, and the torque.
        about = (q * cz - r * cy, r * cx - p * cz, p * cy - q * cx)
        gyroscopic = (q * h2 - r * h1, r * h0 - p * h2, p * h1 - q * h0)
        turn = quaternion_rows(pose[c, 3], pose[c, 4], pose[c, 5], pose[c, 6])
        for i in range(3):
            body[0, i], body[1, i] = onboard_force[c, i], onboard_torque[c, i] - gyroscopic[i]
        for i in range(3):
            row = turn[i]
            place[i] = pose[c, i] + row[0] * cx + row[1] * cy + row[2] * cz
            speed[i] = rate[c, i] + row[0] * about[0] + row[1] * about[1] + row[2] * about[2]
            out[c, i] = force[c, i] + row[0] * body[0, 0] + row[1] * body[0, 1] + row[2] * body[0, 2]
            out[c, 3 + i] = torque[c, i] + row[0] * body[1, 0] + row[1] * body[1, 1] + row[2] * body[1, 2]
        orbit_acceleration_into(axes, n, h, d, s, b, place, speed, pull)
        for i in range(3):
            out[c, i] += mass[c] * pull[i]
