"""The orbit's acceleration for MuJoCo's steps: chosen so that every knot of a free drift lies on the exact solution.

A step of MuJoCo's is u' = u + h a, p' = p + h u': u, the velocity at a knot, is the mean over the interval that ends
there. The exact solution of (CW) (`estimators.relative_orbit`) has, at equidistant knots, the second difference

    a_x = d (u_z + h a_z / 2)                d = 4 tan(n h / 2) / h               -> 2 n       for h -> 0
    a_y = -s y                               s = 4 sin^2(n h / 2) / h^2           -> n^2
    a_z = b (u_x + h a_x / 2 - 3/2 n z)      b = -s / (2 sin(n h) / h - 3/2 n)    -> -2 n

in (V-bar, H-bar, R-bar), where u + h a / 2 is the central difference over both intervals. It follows by inserting the
solution's three motions: the drift x' = 3/2 n z with constant z has no second difference, that of the ellipse
(2 sin, cos) and of the cross-track oscillation is -s times the motion itself. This a causes no error for any length of
the step; (CW) evaluated at the knots would be off by millimetres after one orbit that begins 10 m away, at eight steps
per period. The initial velocity is replaced by the mean over an interval before it (`velocity_before`). Other forces
add as they do without an orbit.
"""

from math import sin, tan
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.relative_orbit import RelativeOrbit, transition


class OrbitStep(NamedTuple):
    """Constants of one step; without an orbit all numbers are zero.

    axes: V-bar, H-bar, R-bar as rows in the lighthouse frame, (3, 3).
    n: mean motion [rad/s].
    h: length of the step [s].
    d, s, b: coefficients above [1/s], [1/s^2], [1/s].
    """

    axes: Floats
    n: float
    h: float
    d: float
    s: float
    b: float


NO_ORBIT = OrbitStep(np.eye(3), 0.0, 0.0, 0.0, 0.0, 0.0)
"""The step of a world without an orbit: no acceleration."""


def orbit_step(orbit: RelativeOrbit, step_s: float) -> OrbitStep:
    """Return the coefficients for steps of `step_s` [s]."""
    n, h = orbit.mean_motion_rad_s, step_s
    s = (2 * sin(n * h / 2) / h) ** 2
    return OrbitStep(orbit.axes, n, h, 4 * tan(n * h / 2) / h, s, -s / (2 * sin(n * h) / h - 1.5 * n))


def velocity_before(orbit: RelativeOrbit, position: Floats, velocity: Floats, step_s: float) -> Floats:
    """Return the mean velocity (C, 3) [m/s] over the interval that ends now, for craft in free motion.

    Args:
        orbit: the station's orbit.
        position: positions now, (C, 3) [m].
        velocity: velocities now, (C, 3) [m/s].
        step_s: length of the interval [s].
    """
    back = transition(orbit, -step_s)
    before = np.concatenate([position, velocity], axis=-1) @ back[:3].T
    out: Floats = (position - before) / step_s
    return out


@kernel
def orbit_acceleration_into(
    axes: Floats, n: float, h: float, d: float, s: float, b: float, position: Floats, velocity: Floats, out: Floats
) -> None:
    """Write the acceleration a for the step that begins at a knot.

    The first six arguments are the fields of an `OrbitStep`: unpacking a record in a kernel takes longer than the
    computation itself.

    Args:
        axes: V-bar, H-bar, R-bar as rows in the lighthouse frame, (3, 3).
        n: mean motion [rad/s].
        h: length of the step [s].
        d: coefficient d [1/s].
        s: coefficient s [1/s^2].
        b: coefficient b [1/s].
        position: position at the knot, (3,) [m], lighthouse frame.
        velocity: velocity at the knot, (3,) [m/s], lighthouse frame.
        out: output, a, (3,) [m/s^2], lighthouse frame.
    """
    e = axes
    y = z = ux = uz = 0.0
    for i in range(3):
        y, z = y + e[1, i] * position[i], z + e[2, i] * position[i]
        ux, uz = ux + e[0, i] * velocity[i], uz + e[2, i] * velocity[i]
    # The two coupled equations of the orbital plane, solved for a_z.
    half = h / 2
    az = b * (ux + half * d * uz - 1.5 * n * z) / (1 - b * d * half * half)
    ax, ay = d * (uz + half * az), -s * y
    for i in range(3):
        out[i] = e[0, i] * ax + e[1, i] * ay + e[2, i] * az
