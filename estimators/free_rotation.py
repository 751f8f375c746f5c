"""Angular acceleration of a body without torque: Euler's equation, in the frame in which the body turns.

    w' = R I^-1 (-w_b x I w_b),   w_b = R^T w

with the inertia I in the body frame. It is zero for a body whose inertia is the same about every axis.
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel


@kernel
def free_accelerations(mask: Bools, rotation: Floats, angular_rate: Floats, inertia: Floats, inverse: Floats) -> Floats:
    """Return the angular accelerations (C, 3) [rad/s^2] of bodies without torque; zero for craft not in the mask.

    Args:
        mask: (C,).
        rotation: (C, 3, 3).
        angular_rate: (C, 3) [rad/s].
        inertia: (C, 3, 3) [kg m^2], body frame.
        inverse: (C, 3, 3) [1 / (kg m^2)], its inverse.
    """
    out = np.zeros_like(angular_rate)
    rate, spin, twist = np.empty(3), np.empty(3), np.empty(3)
    for c in range(len(mask)):
        if not mask[c]:
            continue
        r, w = rotation[c], angular_rate[c]
        for i in range(3):
            rate[i] = r[0, i] * w[0] + r[1, i] * w[1] + r[2, i] * w[2]
        for i in range(3):
            spin[i] = inertia[c, i, 0] * rate[0] + inertia[c, i, 1] * rate[1] + inertia[c, i, 2] * rate[2]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            twist[i] = spin[j] * rate[k] - spin[k] * rate[j]
        for i in range(3):
            rate[i] = inverse[c, i, 0] * twist[0] + inverse[c, i, 1] * twist[1] + inverse[c, i, 2] * twist[2]
        for i in range(3):
            out[c, i] = r[i, 0] * rate[0] + r[i, 1] * rate[1] + r[i, 2] * rate[2]
    return out
