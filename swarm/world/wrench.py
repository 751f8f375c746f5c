"""Wrench on the craft in a physics step: a constant one, the actuators' in the body frame, and the orbit's.

MuJoCo takes the forces of a free joint: F, and in the body frame the torque about the body's origin, R^T M + r x R^T F
with r from the origin to the centre of mass, where F and M are given. It could find them from F and M by itself, which
takes it a sixth of the time of its whole step; these are its own, bit for bit where the origin is the centre of mass.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import inlined, kernel
from estimators.rotation import Row, Rows, quaternion_rows
from swarm.world.orbit import orbit_acceleration_into

_UNIT = 1e-15
"""Deviation of a quaternion's length from 1 from which MuJoCo normalizes it (its mjMINVAL)."""


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


@inlined
def _generalized_into(pose: Floats, com: Floats, force: Row, torque: Row, out: Floats) -> None:
    """Write one craft's wrench as the forces (6,) of its free joint, from pose (7,) and centre of mass (3,)."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    # Normalized, and written as a matrix, as MuJoCo does it, which rounds otherwise than `quaternion_rows`.
    size = np.sqrt((w * w + x * x) + (y * y + z * z))
    if abs(size - 1) > _UNIT:
        w, x, y, z = w * (1 / size), x * (1 / size), y * (1 / size), z * (1 / size)
    rows = (
        ((w * w - y * y) + (x * x - z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), (w * w + y * y) - (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), (w * w - y * y) - (x * x - z * z)),
    )
    f = _into_body(rows, force)
    m = _into_body(rows, torque)
    out[0], out[1], out[2] = force
    out[3] = m[0] + (com[1] * f[2] - com[2] * f[1])
    out[4] = m[1] + (com[2] * f[0] - com[0] * f[2])
    out[5] = m[2] + (com[0] * f[1] - com[1] * f[0])


@kernel
def _into_body(rows: Rows, vector: Row) -> Row:
    """Return R^T v, summed as MuJoCo does."""
    a, b, c = rows
    x, y, z = vector
    return a[0] * x + b[0] * y + c[0] * z, a[1] * x + b[1] * y + c[1] * z, a[2] * x + b[2] * y + c[2] * z


@kernel
def constant_into(pose: Floats, com: Floats, force: Floats, torque: Floats, out: Floats) -> None:
    """Write the forces of free joints for one step under a wrench that does not turn with the craft.

    Args:
        pose: MuJoCo's position and quaternion, (C, 7).
        com: centres of mass, (C, 3) [m], body frame.
        force: force through the centre of mass, (C, 3) [N], lighthouse frame.
        torque: torque about the centre of mass, (C, 3) [N m], lighthouse frame.
        out: output, (C, 6).
    """
    for c in range(len(pose)):
        f, m = (force[c, 0], force[c, 1], force[c, 2]), (torque[c, 0], torque[c, 1], torque[c, 2])
        _generalized_into(pose[c], com[c], f, m, out[c])


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
    """Write the forces of free joints for one step under the whole wrench.

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
        out: output, (C, 6).
    """
    place, speed, pull, body, total = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3)), np.empty((2, 3))
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
            total[0, i] = force[c, i] + row[0] * body[0, 0] + row[1] * body[0, 1] + row[2] * body[0, 2]
            total[1, i] = torque[c, i] + row[0] * body[1, 0] + row[1] * body[1, 1] + row[2] * body[1, 2]
        orbit_acceleration_into(axes, n, h, d, s, b, place, speed, pull)
        for i in range(3):
            total[0, i] += mass[c] * pull[i]
        f, m = (total[0, 0], total[0, 1], total[0, 2]), (total[1, 0], total[1, 1], total[1, 2])
        _generalized_into(pose[c], com[c], f, m, out[c])
