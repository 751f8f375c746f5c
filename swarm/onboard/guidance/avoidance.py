"""Collision avoidance by a barrier certificate: the acceleration nearest to the wanted one that keeps a craft clear.

For craft i and its neighbour j, with dp = p_i - p_j, dv = v_i - v_j, D the least distance and u_max the acceleration
with which each can brake, the pair is safe while (Wang, Ames and Egerstedt, IEEE Trans. Robotics 33(3), 2017,
equation 8)

    h = sqrt(4 u_max (|dp| - D)) + dp . dv / |dp| >= 0                                                              (B1)

Each craft maintains this by doing its half of dh/dt >= -gamma h^3, which is linear in its own acceleration u (their 11
and 14)

    -dp . u <= b / 2,
    b = gamma h^3 |dp| - (dp . dv)^2 / |dp|^2 + |dv|^2 + 2 u_max dp . dv / sqrt(4 u_max (|dp| - D))                 (B2)

Among all u that meet (B2) for every neighbour, the one nearest to the wanted acceleration is the solution of a
least-distance problem, solved exactly by non-negative least squares (Lawson and Hanson, "Solving Least Squares
Problems", chapter 23). If no u meets all conditions, the craft accelerates away from the neighbours whose conditions
its wanted acceleration violates, in proportion to the violation.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from estimators.arrays import Bools, Floats, Ints
from swarm.onboard.guidance.broadcast import Heard

GAMMA = 2.0
"""Coefficient gamma of (B2) [s/m^2]: the larger it is, the later and the harder a craft gives way."""
LEAST_GAP_M = 1e-3
"""Smallest gap |dp| - D for which (B2) is evaluated [m]; it is singular at zero, so smaller gaps are replaced by it."""


class Barrier(NamedTuple):
    """Conditions normal . u <= limit on the accelerations u of craft, one per pair, P pairs.

    craft: index of the craft, (P,). normal: unit vector, (P, 3). limit: (P,) [m/s^2].
    """

    craft: Ints
    normal: Floats
    limit: Floats


def barriers(
    who: Ints, position: Floats, velocity: Floats, heard: Heard, distance_m: Floats, brake_m_s2: Floats
) -> Barrier:
    """Return the conditions (B2) of M craft towards every other craft that is heard.

    Args:
        who: indices of the craft, (M,).
        position: their own estimated positions, (M, 3) [m].
        velocity: their own estimated velocities, (M, 3) [m/s].
        heard: positions and velocities of all craft by their broadcasts.
        distance_m: least distance D of each craft, (M,) [m].
        brake_m_s2: braking acceleration u_max of each craft, (M,) [m/s^2].
    """
    dp = position[:, None] - heard.position[None]
    dv = velocity[:, None] - heard.velocity[None]
    apart = np.linalg.norm(dp, axis=2)
    pair: Bools = heard.known[None] & (who[:, None] != np.arange(len(heard.known))[None]) & (apart > 0)
    pair &= np.isfinite(apart)
    i, j = np.nonzero(pair)
    dp, dv, apart = dp[i, j], dv[i, j], apart[i, j]
    brake, gap = brake_m_s2[i], apart - distance_m[i]
    closing = np.einsum("pk,pk->p", dp, dv)
    stopping = np.sqrt(4 * brake * np.maximum(np.abs(gap), LEAST_GAP_M))
    h = np.sign(gap) * stopping + closing / apart
    turning = np.einsum("pk,pk->p", dv, dv) - (closing / apart) ** 2
    b = GAMMA * h**3 * apart + turning + 2 * brake * closing / stopping
    return Barrier(who[i], -dp / apart[:, None], b / (2 * apart))


def safe(acceleration: Floats, barrier: Barrier, most_m_s2: Floats) -> tuple[Floats, Bools]:
    """Return the accelerations (C, 3) nearest to the wanted ones that meet all conditions, and the craft that gave way.

    Args:
        acceleration: wanted accelerations, (C, 3) [m/s^2].
        barrier: conditions on them.
        most_m_s2: largest acceleration of a craft that gives way, (C,) [m/s^2].

    Returns:
        The accelerations (C, 3) [m/s^2], and the mask (C,) of the craft whose acceleration was changed.
    """
    out, gave_way = acceleration.copy(), np.zeros(len(acceleration), dtype=np.bool_)
    excess = np.einsum("pk,pk->p", barrier.normal, acceleration[barrier.craft]) - barrier.limit
    for craft in np.unique(barrier.craft[excess > 0]):
        own = barrier.craft == craft
        change = nearest(-barrier.normal[own], excess[own])
        if change is None:
            pressed = own & (excess > 0)
            change = -(barrier.normal[pressed] * excess[pressed, None]).sum(axis=0) - out[craft]
        out[craft] += change
        out[craft] *= min(1.0, most_m_s2[craft] / max(float(np.linalg.norm(out[craft])), 1e-12))
        gave_way[craft] = True
    return out, gave_way


def nearest(g: Floats, h: Floats) -> Floats | None:
    """Return the shortest x (n,) with g x >= h, for g (m, n) and h (m,); None if there is none."""
    scale = float(np.abs(h).max())
    if scale == 0:
        return np.zeros(g.shape[1])
    e = np.vstack([g.T, h / scale])
    f = np.append(np.zeros(g.shape[1]), 1.0)
    y, _ = nnls(e, f)
    r = e @ y - f
    return None if -r[-1] < 1e-9 else scale * r[:-1] / -r[-1]
