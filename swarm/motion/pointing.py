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

DOWN = np.array([0.0, 1.0, 0.0])


class Facing(NamedTuple):
    """rotation (N, 3, 3), angular_rate (N, 3) [rad/s], angular_acceleration (N, 3) [rad/s^2]; lighthouse frame."""

    rotation: Floats
    angular_rate: Floats
    angular_acceleration: Floats


def facing(position: Floats, velocity: Floats, acceleration: Floats) -> Facing:
    """The facing frames at positions (N, 3) [m], moving with velocity (N, 3) and acceleration (N, 3)."""
    distance = np.linalg.norm(position, axis=-1, keepdims=True)
    u = position / distance
    # Derivatives of p = r u, with r' = u . v and r'' = u . a + u' . v.
    radial = _dot(u, velocity)
    u1 = (velocity - radial * u) / distance
    u2 = (acceleration - (_dot(u, acceleration) + _dot(u1, velocity)) * u - 2 * radial * u1) / distance
    z, z1, z2 = -u, -u1, -u2

    n, n1, n2 = np.cross(DOWN, z), np.cross(DOWN, z1), np.cross(DOWN, z2)
    size = np.linalg.norm(n, axis=-1, keepdims=True)
    x = n / size
    y = np.cross(z, x)
    about_z = _dot(n1, y) / size
    rate = np.cross(z, z1) + about_z * z
    y1 = np.cross(rate, y)
    about_z1 = (_dot(n2, y) + _dot(n1, y1)) / size - _dot(n1, y) * _dot(n, n1) / size**3
    change = np.cross(z, z2) + about_z1 * z + about_z * z1
    return Facing(np.stack([x, y, z], axis=-1), rate, change)


def _dot(a: Floats, b: Floats) -> Floats:
    out: Floats = np.sum(a * b, axis=-1, keepdims=True)
    return out
