"""Separation of solutions: a pose and those that leave out one or two photodiodes, carried on into the filter.

With the rows J of a solved pose, N = J^T J, residuals r = measured less predicted, and E_S that picks the angles of a
set S of photodiodes, H_S = E_S^T J N^-1 J^T E_S, the solution without S differs by (a down-date of rank two or four)

    d_S = x - x_S = N^-1 J^T E_S (1 - H_S)^-1 E_S^T r,    Cov(x_S) - Cov(x) = a^2 N^-1 J^T E_S (1 - H_S)^-1 (...)^T

The rotor's part moves both alike. A filter that had the same gain and all the time the poses without S would now differ
from the one that runs by

    delta_S <- A delta_S + G d_S,    Cov_S = P + sum_j A^j G W_j W_j^T G^T A^jT,    W W^T as above

(A: what the filter keeps of its error in a period, G: its gain), whatever its gain is: both estimates are linear in the
poses. If S is false and nothing else, the error of the running filter is no more than |delta_S| and the error of the
other, which nothing has spoiled: this bounds it by

    |delta_S| + K sqrt(tr Cov_S)                                                                                    (SS)

The sum's trace is the same for all S but for W, tr(W^T G^T X G W) with X <- A^T X A + C^T C, C the rows of position or
attitude, once the filter has settled; that is what the kernel takes.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.linear import cholesky_into, invert_factor_into
from estimators.state import STATES

FEWEST_OTHERS = 4
"""Photodiodes that must be left for a set to be separated: as many as decide a pose."""


class Linear(NamedTuple):
    """Solved poses of C craft to first order, station frame.

    jacobian: (C, 2, K, 6), derivatives of the angles by the pose error. residual: (C, 2, K), predicted less measured
    [rad]. lit: (C, K), photodiodes that the poses are solved from.
    """

    jacobian: Floats
    residual: Floats
    lit: Bools


def sets_of(photodiodes: int, most: int) -> Ints:
    """Return the sets of one, and of `most` = 2 also those of two photodiodes, (S, 2); the second is -1 of one."""
    single = [(k, -1) for k in range(photodiodes)]
    double = [(k, m) for k in range(photodiodes) for m in range(k + 1, photodiodes)] if most > 1 else []
    return np.array(single + double, dtype=np.int64).reshape(-1, 2)


@kernel
def separate(
    jacobian: Floats,
    residual: Floats,
    lit: Bools,
    fresh: Bools,
    sets: Ints,
    kept: Floats,
    gain: Floats,
    weight: Floats,
    own_variance: float,
    memory: Floats,
    delta: Floats,
    added: Floats,
) -> None:
    """Carry `delta` (C, S, 12) and `added` (C, S, 2), variance of position [m^2] and attitude [rad^2], on by a period.

    Args:
        jacobian: of `Linear`.
        residual: likewise.
        lit: likewise.
        fresh: (C,), craft whose filters took in the poses.
        sets: (S, 2), of `sets_of`.
        kept: (C, 12, 12), A.
        gain: (C, 12, 6), G.
        weight: (C, 2, 6, 6), G^T X G of position and attitude.
        own_variance: a^2 [rad^2].
        memory: (C, 2), factors of `added` where a set is not in this period's pose.
        delta: carried on, distance of the estimates: running less separated.
        added: carried on.
    """
    most, angles = lit.shape[1], 4
    normal, factor, inverse = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    moves, scratch, across, lower = (
        np.empty((most, 2, 6)),
        np.empty(STATES),
        np.empty((angles, angles)),
        np.empty((angles, angles)),
    )
    who, solved, part = np.empty((angles, 2), np.int64), np.empty((angles, 7)), np.empty(6)
    for c in range(len(lit)):
        n, solves = 0, fresh[c]
        normal[:] = 0.0
        for k in range(most):
            if solves and lit[c, k]:
                n += 1
                for fan in range(2):
                    row = jacobian[c, fan, k]
                    for i in range(6):
                        for j in range(6):
                            normal[i, j] += row[i] * row[j]
        solves = solves and n > FEWEST_OTHERS and cholesky_into(normal, factor)
        if solves:
            invert_factor_into(factor, inverse)
            for k in range(most):
                for fan in range(2):
                    for i in range(6):
                        total = 0.0
                        for j in range(6):
                            total += inverse[i, j] * jacobian[c, fan, k, j]
                        moves[k, fan, i] = total
        for s in range(len(sets)):
            own, size = delta[c, s], 0
            for i in range(STATES):
                total = 0.0
                for j in range(STATES):
                    total += kept[c, i, j] * own[j]
                scratch[i] = total
            own[:] = scratch
            added[c, s, 0] *= memory[c, 0]
            added[c, s, 1] *= memory[c, 1]
            if not solves:
                continue
            for k in sets[s]:
                if k >= 0 and lit[c, k]:
                    for fan in range(2):
                        who[size, 0], who[size, 1] = fan, k
                        size += 1
            if size == 0 or n - size // 2 < FEWEST_OTHERS:
                continue
            # 1 - H_S, of one photodiode with two rows of 1 beside it.
            for i in range(angles):
                for j in range(angles):
                    total = 1.0 if i == j else 0.0
                    if i < size and j < size:
                        for a in range(6):
                            total -= jacobian[c, who[i, 0], who[i, 1], a] * moves[who[j, 1], who[j, 0], a]
                    across[i, j] = total
            if not cholesky_into(across, lower):
                added[c, s, 0] = added[c, s, 1] = np.inf
                continue
            # L^-1 of the rows' moves and residuals.
            for i in range(size):
                for a in range(7):
                    value = moves[who[i, 1], who[i, 0], a] if a < 6 else -residual[c, who[i, 0], who[i, 1]]
                    for j in range(i):
                        value -= lower[i, j] * solved[j, a]
                    solved[i, a] = value / lower[i, i]
            for a in range(6):
                part[a] = 0.0
                for i in range(size):
                    part[a] += solved[i, a] * solved[i, 6]
            for i in range(STATES):
                for a in range(6):
                    own[i] += gain[c, i, a] * part[a]
            for which in range(2):
                total = 0.0
                for i in range(size):
                    for a in range(6):
                        for b in range(6):
                            total += solved[i, a] * weight[c, which, a, b] * solved[i, b]
                added[c, s, which] = max(added[c, s, which], own_variance * total)


@kernel
def worst_levels(delta: Floats, added: Floats, variance: Floats, quantile: float, out: Floats) -> None:
    """Write the largest of (SS) over all sets and none, `out` (2, C): position [m] and attitude [rad].

    Args:
        delta: of `separate`.
        added: likewise.
        variance: (2, C), traces of P.
        quantile: K.
        out: the levels.
    """
    for c in range(len(delta)):
        for i in range(2):
            first = 6 if i == 0 else 0
            worst = quantile * np.sqrt(variance[i, c])
            for s in range(delta.shape[1]):
                x, y, z = delta[c, s, first], delta[c, s, first + 1], delta[c, s, first + 2]
                value = np.sqrt(x * x + y * y + z * z) + quantile * np.sqrt(variance[i, c] + added[c, s, i])
                worst = max(worst, value)
            out[i, c] = worst
