"""The frame that faces the lighthouse, with its angular rate and acceleration, along a path p(t).

With u = p / |p| the direction from the lighthouse (lighthouse frame: y is down), the frame F = [x y z] is

    z = -u,   n = e_y x z,   x = n / |n|,   y = z x x

so the front faces the lighthouse and the body's y axis stays as near to "down" as it can: no roll. With
w . z = (n' . y) / |n|, from x' = w x x, its rate and acceleration are

    w = z x z' + (w . z) z,   w' = z x z'' + (w . z)' z + (w . z) z'

Undefined where p is on the y axis or at the origin, both outside the lighthouse's field.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel


class Facing(NamedTuple):
    """Frames that face the lighthouse, in the lighthouse frame.

    rotation: attitudes, (N, 3, 3).
    angular_rate: angular rates, (N, 3) [rad/s].
    angular_acceleration: angular accelerations, (N, 3) [rad/s^2].
    """

    rotation: Floats
    angular_rate: Floats
    angular_acceleration: Floats


def facing(position: Floats, velocity: Floats, acceleration: Floats) -> Facing:
    """Return the facing frames along N paths.

    Args:
        position: positions, (N, 3) [m].
        velocity: velocities, (N, 3) [m/s].
        acceleration: accelerations, (N, 3) [m/s^2].
    """
    count = len(position)
    out = Facing(np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3)))
    path = np.ascontiguousarray(position), np.ascontiguousarray(velocity), np.ascontiguousarray(acceleration)
    _facing_into(*path, *out)
    return out


@kernel
def _facing_into(
    position: Floats, velocity: Floats, acceleration: Floats, rotation: Floats, rate: Floats, change: Floats
) -> None:
    """Write the results of `facing` into its three arrays."""
    for c in range(len(position)):
        p, v, a = position[c], velocity[c], acceleration[c]
        distance = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        u0, u1, u2 = p[0] / distance, p[1] / distance, p[2] / distance
        # Derivatives of p = r u, with r' = u . v and r'' = u . a + u' . v.
        radial = u0 * v[0] + u1 * v[1] + u2 * v[2]
        t0, t1, t2 = (v[0] - radial * u0) / distance, (v[1] - radial * u1) / distance, (v[2] - radial * u2) / distance
        outward = u0 * a[0] + u1 * a[1] + u2 * a[2] + t0 * v[0] + t1 * v[1] + t2 * v[2]
        z0, z1, z2 = -u0, -u1, -u2
        # z' and z''
        d0, d1, d2 = -t0, -t1, -t2
        e0 = -(a[0] - outward * u0 - 2 * radial * t0) / distance
        e1 = -(a[1] - outward * u1 - 2 * radial * t1) / distance
        e2 = -(a[2] - outward * u2 - 2 * radial * t2) / distance
        # e_y x (a, b, c) = (c, 0, -a): the y components of n, n' and n'' are zero.
        size = np.sqrt(z2 * z2 + z0 * z0)
        x0, x2 = z2 / size, -z0 / size
        # y = z x x, with x_y = 0
        y0, y1, y2 = z1 * x2, z2 * x0 - z0 * x2, -z1 * x0
        turning = d2 * y0 - d0 * y2
        about = turning / size
        w0, w1, w2 = z1 * d2 - z2 * d1 + about * z0, z2 * d0 - z0 * d2 + about * z1, z0 * d1 - z1 * d0 + about * z2
        # y' = w x y
        f0, f2 = w1 * y2 - w2 * y1, w0 * y1 - w1 * y0
        changing = (e2 * y0 - e0 * y2 + d2 * f0 - d0 * f2) / size - turning * (z2 * d2 + z0 * d0) / size**3
        rotation[c, 0, 0], rotation[c, 1, 0], rotation[c, 2, 0] = x0, 0.0, x2
        rotation[c, 0, 1], rotation[c, 1, 1], rotation[c, 2, 1] = y0, y1, y2
        rotation[c, 0, 2], rotation[c, 1, 2], rotation[c, 2, 2] = z0, z1, z2
        rate[c, 0], rate[c, 1], rate[c, 2] = w0, w1, w2
        change[c, 0] = z1 * e2 - z2 * e1 + changing * z0 + about * d0
        change[c, 1] = z2 * e0 - z0 * e2 + changing * z1 + about * d1
        change[c, 2] = z0 * e1 - z1 * e0 + changing * z2 + about * d2
