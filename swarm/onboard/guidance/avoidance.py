"""The acceleration nearest to the one wanted with which a craft keeps clear of the others: a barrier certificate.

For craft i and its neighbour j, with dp = p_i - p_j, dv = v_i - v_j, D the least distance and u_max what each can
brake with, the pair is safe while (Wang, Ames and Egerstedt, IEEE Trans. Robotics 33(3), 2017, equation 8)

    h = sqrt(4 u_max (|dp| - D)) + dp . dv / |dp| >= 0                                                              (B1)

which each keeps up by doing its half of dh/dt >= -gamma h^3, linear in its own acceleration u (their 11 and 14)

    -dp . u <= b / 2,
    b = gamma h^3 |dp| - (dp . dv)^2 / |dp|^2 + |dv|^2 + 2 u_max dp . dv / sqrt(4 u_max (|dp| - D))                 (B2)

Among all u that meet (B2) for every neighbour, the one nearest to what the craft wants is a least-distance problem,
solved exactly by non-negative least squares (Lawson and Hanson, "Solving Least Squares Problems", chapter 23). Where no
u meets all, the craft pushes away from those that press it most.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from estimators.arrays import Bools, Floats, Ints
from swarm.onboard.guidance.broadcast import Heard

GAMMA = 2.0
"""How soon (B1) may be used up [s/m^2]: the larger, the later and the harder a craft gives way."""
LEAST_GAP_M = 1e-3
"""Nearer to the least distance than this, (B2) is taken as if it were this far: it has no value there."""


class Barrier(NamedTuple):
    """Conditions a . u <= limit on the accelerations of craft, one per pair (P,): craft: who; normal: a (P, 3), of unit
    length; limit: (P,) [m/s^2].
    """

    craft: Ints
    normal: Floats
    limit: Floats


def barriers(
    who: Ints, position: Floats, velocity: Floats, heard: Heard, distance_m: Floats, brake_m_s2: Floats
) -> Barrier:
    """The conditions (B2) of the craft `who` (M,), which are at position (M, 3) with velocity (M, 3) as they know them.

    distance_m, brake_m_s2: (M,), D and u_max. A craft has none towards itself, nor towards who is not heard.
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
    """The accelerations (C, 3) nearest to `acceleration` that meet the conditions, and who had to give way (C,).

    most_m_s2: (C,), what a craft that gives way does at most.
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
    """The shortest x (n,) with g x >= h, g (m, n), h (m,); None where there is none."""
    scale = float(np.abs(h).max())
    if scale == 0:
        return np.zeros(g.shape[1])
    e = np.vstack([g.T, h / scale])
    f = np.append(np.zeros(g.shape[1]), 1.0)
    y, _ = nnls(e, f)
    r = e @ y - f
    return None if -r[-1] < 1e-9 else scale * r[:-1] / -r[-1]
