"""The error that no choice of K among N candidates can fall below, by convex relaxation.

With a weight w_n in 0..1 for every candidate, sum w_n = K, a pose has the information M_p(w) = F_p + sum w_n I_np, and

    g_p(w) = 1 / tr M_p(w)^-1 = 1 / e_p^2

is concave in w (a matrix mean of order -1; Pukelsheim, Optimal Design of Experiments, 1993, 6.13). A choice, whose
weights are 0 and 1, keeps to the error t at the share q of the poses only if

    G(w) = sum_p min(g_p(w) t^2, 1) >= q P

and G is concave as well, so that for any w and any multipliers m_p in 0..1, with the gradients d_p of g_p t^2 at w,

    G(v) <= sum_p [1 - m_p + m_p (g_p t^2 - d_p . w)] + max_v sum_p m_p d_p . v      for every v with sum v = K

The maximum over v is the sum of the K largest coefficients. Where the right side is below q P, the error t is out of
reach, for certain, whatever the quality of w: w only has to be good for a close bound. It is found by conditional
gradients (Frank and Wolfe 1956) on a smooth minimum, whose slopes are the multipliers. The largest t that is out of
reach, found by halving, is the bound. The condition that four photodiodes are lit is left out, which lowers it further.

With one station lost: of K stations the mean of M over the lost one is (K - 1)/K M, and e is convex in M, so the worst
loss leaves at least sqrt(K / (K - 1)) times the bound of K, where none is fixed.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.placement.search import Views

STEPS = 60
"""Conditional gradients of one test."""
CLOSE = 1.01
"""The bound is found to this factor."""
SOFT = (0.3, 0.03)
"""Width of the smooth minimum, at the first and at the last step."""
TINY = 1e-12
"""Part of the largest information that is added to M, so that it has an inverse; e moves by much less than `CLOSE`."""


def least_error(candidates: Views, fixed: Views, count: int, share: float, reached: float) -> float:
    """Return an error t such that no choice keeps to it at the share of the poses.

    Args:
        candidates: N candidates at P poses.
        fixed: stations that stand already.
        count: number K of stations to choose, at most N.
        share: q, the share of the poses.
        reached: error that some choice keeps to; the bound is sought below it.
    """
    if not np.isfinite(reached):
        return _limit(candidates, fixed, share)
    low, high = _limit(candidates, fixed, share), reached
    while high > CLOSE * low:
        middle = float(np.sqrt(low * high))
        if _out_of_reach(candidates, fixed, count, share, middle):
            low = middle
        else:
            high = middle
    return low


def with_one_lost(bound: float, count: int) -> float:
    """Return the bound of the error with any one of `count` stations lost, from the one with all of them."""
    return bound * float(np.sqrt(count / (count - 1))) if count > 1 else float("inf")


def _limit(candidates: Views, fixed: Views, share: float) -> float:
    """Return the error at the share of the poses with all candidates at once."""
    whole = _regular(candidates.information.sum(axis=0) + fixed.information.sum(axis=0))
    square = np.trace(np.linalg.inv(whole), axis1=-2, axis2=-1)
    ordered = np.sort(np.sqrt(square))
    return float(ordered[max(int(np.ceil(share * len(ordered) - 1e-9)) - 1, 0)])


def _regular(information: Floats) -> Floats:
    scale = np.trace(information, axis1=-2, axis2=-1)
    small = TINY * np.maximum(scale, scale.max() * TINY)
    out: Floats = information + small[:, None, None] * np.eye(6)
    return out


def _out_of_reach(candidates: Views, fixed: Views, count: int, share: float, t: float) -> bool:
    """Tell whether it is certain that no choice keeps to the error t at the share of the poses."""
    number, poses = candidates.lit.shape
    flat = candidates.information.reshape(number, -1)
    base = fixed.information.sum(axis=0)
    needed = share * poses - 1e-9
    weight = np.full(number, count / number)
    total = (weight @ flat).reshape(poses, 6, 6)
    for step in range(STEPS):
        inverse = np.linalg.inv(_regular(base + total))
        value = t * t / np.trace(inverse, axis1=-2, axis2=-1)
        soft = SOFT[0] * (SOFT[1] / SOFT[0]) ** (step / (STEPS - 1))
        part = 1 / (1 + np.exp(np.clip((value - 1) / soft, -50, 50)))
        # d g / d w = g^2 tr(M^-2 I)
        factor = (part * value * value / (t * t))[:, None, None] * (inverse @ inverse)
        gradient = flat @ factor.ravel()
        top = np.argpartition(gradient, number - count)[number - count :]
        ceiling = float(np.sum(1 - part + part * value) - gradient @ weight + gradient[top].sum())
        if ceiling < needed:
            return True
        if float(np.minimum(value, 1).sum()) >= needed:
            return False
        size = 2 / (step + 2)
        weight *= 1 - size
        weight[top] += size
        total += size * (flat[top].sum(axis=0).reshape(poses, 6, 6) - total)
    return False
