"""The feedback that holds a guided craft to its reference: a linear-quadratic regulator of the double integrator.

Per axis, with e the deviation from the reference and u the acceleration beside the reference's own, held over T,

    [e, e']_(k+1) = A [e, e']_k + B u_k,    A = [[1, T], [0, 1]],   B = [T^2 / 2, T]^T

the gain K of u = -K [e, e'] minimises  sum (e / d)^2 + (u / f)^2  (Bryson's rule: a deviation d costs as much as an
effort f). For T -> 0 it tends to K = [f / d, sqrt(2 f / d)], a natural frequency of sqrt(f / d) with damping sqrt(1/2).
Gravity's gradient is not in A: the control subtracts it at the craft's own estimate.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are


class Gains(NamedTuple):
    """Feedback gains: acceleration per deviation of position [1/s^2] and of velocity [1/s]."""

    stiffness: float
    damping: float


def regulator(deviation_m: float, effort_m_s2: float, period_s: float) -> Gains:
    """Return the gains K of the regulator above.

    Args:
        deviation_m: deviation d [m].
        effort_m_s2: effort f [m/s^2].
        period_s: period T [s].
    """
    a = np.array([[1.0, period_s], [0.0, 1.0]])
    b = np.array([[period_s**2 / 2], [period_s]])
    # Scaled to d and f, so that the Riccati equation is solved among numbers near one.
    q, r = np.diag([1.0, 0.0]), np.array([[(deviation_m / effort_m_s2) ** 2]])
    p = solve_discrete_are(a, b, q, r)
    stiffness, damping = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)[0]
    return Gains(float(stiffness), float(damping))
