"""Control allocation by bounded least squares: the actuators' shares of a wrench, per craft, as one compiled loop.

The six components w (force [N], torque about the centre of mass [N m], body frame) are to be produced by n actuators,
each of which contributes b_i u_i with u_i between its bounds. With x = u / unit, scaled by the available action, and
S the inverse of a typical force and torque,

    minimise  |S (B x - w)|^2 + sum_i cost_i (x_i - wanted_i)^2    subject to  low <= x <= high

The costs are so small (1e-6 and less) that they only decide among equally good solutions: how strongly an actuator is
preferred, and which value it prefers. With positive costs the minimum is unique. It is found by the active set method
of C. L. Lawson and R. J. Hanson, *Solving Least Squares Problems* (1974), for two bounds after P. B. Stark and R. L.
Parker, *Bounded-variable least squares*, Comput. Stat. 10 (1995) 129: solve for the free x; where the solution leaves
the bounds, go as far as they allow and hold the variable that met its bound; else release the held variable that would
gain most, until none would.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel
from estimators.linear import solve_spd

ROUNDS_PER_ACTUATOR = 10
"""Limit on the rounds per actuator; the method needs a few, and reaches the limit only if rounding makes it cycle."""


def allocate(
    effect: Floats, scale: Floats, cost: Floats, wanted: Floats, low: Floats, high: Floats, wrench: Floats
) -> tuple[Floats, Ints]:
    """Return the x that minimises the cost above, (C, n), and the number of rounds per craft, (C,).

    Args:
        effect: B, wrench of a unit of each actuator, (C, 6, n).
        scale: S, (C, 6).
        cost: cost of each actuator, positive, (C, n).
        wanted: preferred x, (C, n).
        low: lower bounds, (C, n); an actuator between equal bounds stays there.
        high: upper bounds, (C, n).
        wrench: w, (C, 6) [N, N m].

    Raises:
        ValueError: shapes do not fit, a cost is not positive, or a lower bound is above the upper one.
    """
    craft, actuators = cost.shape
    shapes = (effect.shape, scale.shape, wrench.shape, wanted.shape, low.shape, high.shape)
    expected = ((craft, 6, actuators), (craft, 6), (craft, 6), *((craft, actuators),) * 3)
    if shapes != expected:
        raise ValueError(f"effect, scale, wrench, wanted, low, high: expected shapes {expected}, got {shapes}")
    if not np.all(cost > 0) or not np.all(low <= high):
        raise ValueError("every cost must be positive, and every low bound at most the high one")
    out, rounds = np.empty((craft, actuators)), np.zeros(craft, dtype=np.int64)
    _allocate_into(effect, scale, cost, wanted, low, high, wrench, out, rounds)
    return out, rounds


@kernel
def _allocate_into(
    effect: Floats,
    scale: Floats,
    cost: Floats,
    wanted: Floats,
    low: Floats,
    high: Floats,
    wrench: Floats,
    out: Floats,
    rounds: Ints,
) -> None:
    """Write the results of `allocate` into `out` (C, n) and `rounds` (C,)."""
    n = cost.shape[1]
    normal, right = np.empty((n, n)), np.empty(n)
    for c in range(len(cost)):
        for i in range(n):
            for j in range(i + 1):
                total = 0.0
                for k in range(6):
                    total += effect[c, k, i] * effect[c, k, j] * scale[c, k] ** 2
                normal[i, j] = normal[j, i] = total
            normal[i, i] += cost[c, i]
            right[i] = cost[c, i] * wanted[c, i]
            for k in range(6):
                right[i] += effect[c, k, i] * wrench[c, k] * scale[c, k] ** 2
        rounds[c] = _solve(normal, right, low[c], high[c], out[c])


@kernel
def _solve(normal: Floats, right: Floats, low: Floats, high: Floats, x: Floats) -> int:
    """Minimise x^T N x / 2 - r^T x between bounds into `x` (n,), N positive definite; return the number of rounds."""
    n = len(right)
    # Each variable is held at the low bound, held at the high one, or free.
    free = np.zeros(n, np.bool_)
    at_high = np.zeros(n, np.bool_)
    z, a, scratch = np.empty(n), np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        x[i] = min(max(0.0, low[i]), high[i])
        free[i] = low[i] < x[i] < high[i]
        at_high[i] = x[i] == high[i]
    just_freed = -1
    for turn in range(ROUNDS_PER_ACTUATOR * n):
        # N z = r for the free variables; the held ones are in the same system as z = x.
        for i in range(n):
            z[i] = right[i] if free[i] else x[i]
            for j in range(n):
                a[i, j] = normal[i, j] if free[i] and free[j] else 0.0
                if free[i] and not free[j]:
                    z[i] -= normal[i, j] * x[j]
            if not free[i]:
                a[i, i] = 1.0
        solve_spd(a, scratch, z)
        share, blocking = 1.0, -1
        for i in range(n):
            if free[i] and not low[i] <= z[i] <= high[i]:
                bound = low[i] if z[i] < low[i] else high[i]
                reach = (bound - x[i]) / (z[i] - x[i])
                if reach < share:
                    share, blocking = reach, i
        for i in range(n):
            if free[i]:
                x[i] += share * (z[i] - x[i])
        if blocking >= 0:
            at_high[blocking] = z[blocking] > high[blocking]
            x[blocking] = high[blocking] if at_high[blocking] else low[blocking]
            free[blocking] = False
            # It was released and is at once back at its bound: its gain was rounding.
            if blocking == just_freed and share <= 0.0:
                return turn + 1
            continue
        # The free variables are at their optimum: does any held one pull away from its bound?
        best, gain = -1, 0.0
        for i in range(n):
            if free[i] or low[i] == high[i]:
                continue
            slope, size = -right[i], abs(right[i])
            for j in range(n):
                slope += normal[i, j] * x[j]
                size += abs(normal[i, j] * x[j])
            pull = slope if at_high[i] else -slope
            if pull > 1e-13 * size and pull > gain:
                best, gain = i, pull
        if best < 0:
            return turn + 1
        free[best], just_freed = True, best
    return ROUNDS_PER_ACTUATOR * n
