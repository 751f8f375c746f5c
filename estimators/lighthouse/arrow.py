"""The arrow of a least squares whose C blocks of six unknowns share two more, solved in time proportional to C.

    [ A_1           B_1 ] [dx_1]     [g_1]
    [      ...      ... ] [ ...] = - [...]      A_c (6, 6), symmetric positive definite;  B_c (6, 2);  D (2), diagonal
    [          A_C  B_C ] [dx_C]     [g_C]
    [ B_1^T .. B_C^T  D ] [deps]     [ h ]

The blocks touch each other only through eps: eliminating every dx_c leaves a 2 x 2 system in the Schur complement

    S = D - sum B_c^T Y_c,   Y_c = A_c^-1 B_c,   S deps = -h + sum B_c^T A_c^-1 g_c,   dx_c = -A_c^-1 g_c - Y_c deps

and the inverse of the whole has the blocks A_c^-1 + Y_c S^-1 Y_c^T and, for eps, S^-1.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.linear import cholesky_into, invert_spd_into, solve_cholesky


class Arrow(NamedTuple):
    """The linearised problem: normal A (C, 6, 6), border B (C, 6, 2), gradient g (C, 6); corner D and its h, (2,)."""

    normal: Floats
    border: Floats
    gradient: Floats
    corner: Floats
    slope: Floats


@kernel
def eliminate(
    arrow: Arrow, takes_part: Bools, damping: float, shares: bool, step: Floats, spread: Floats, schur: Floats
) -> bool:
    """Solve the arrow; return False where it is singular.

    Args:
        arrow: the linearised problem of C craft.
        takes_part: (C,).
        damping: by which the diagonal is raised, relative to itself.
        shares: False holds eps at 0.
        step: (C + 1, 6), receives dx of every craft and, in the last row, deps.
        spread: (C, 6, 2), receives Y.
        schur: (2, 2), receives S.
    """
    normal, border, gradient, corner, slope = arrow
    craft = normal.shape[0]
    damped, lower, column = np.empty((6, 6)), np.zeros((6, 6)), np.empty(6)
    right = np.empty(2)
    schur[:] = 0.0
    for fan in range(2):
        schur[fan, fan] = corner[fan] * (1 + damping)
        right[fan] = -slope[fan]
    for c in range(craft):
        if not takes_part[c]:
            continue
        damped[:] = normal[c]
        for a in range(6):
            damped[a, a] *= 1 + damping
        if not cholesky_into(damped, lower):
            return False
        for fan in range(2):
            column[:] = border[c, :, fan]
            solve_cholesky(lower, column)
            spread[c, :, fan] = column
        column[:] = gradient[c]
        solve_cholesky(lower, column)
        step[c] = -column
        for fan in range(2):
            for a in range(6):
                right[fan] += border[c, a, fan] * column[a]
                for other in range(2):
                    schur[fan, other] -= border[c, a, fan] * spread[c, a, other]
    step[craft] = 0.0
    if not shares:
        return True
    determinant = schur[0, 0] * schur[1, 1] - schur[0, 1] * schur[1, 0]
    if not determinant > 0:
        return False
    step[craft, 0] = (schur[1, 1] * right[0] - schur[0, 1] * right[1]) / determinant
    step[craft, 1] = (schur[0, 0] * right[1] - schur[1, 0] * right[0]) / determinant
    for c in range(craft):
        if takes_part[c]:
            for a in range(6):
                step[c, a] -= spread[c, a, 0] * step[craft, 0] + spread[c, a, 1] * step[craft, 1]
    return True


@kernel
def covariances_into(
    arrow: Arrow, takes_part: Bools, rho: float, covariance: Floats, known: Floats, shared: Floats
) -> None:
    """Write the covariances for unit angle noise.

    Args:
        arrow: the linearised problem of C craft.
        takes_part: (C,).
        rho: of (19).
        covariance: (C, 6, 6), receives Cov(x_c).
        known: (C, 6, 6), receives the same with eps known.
        shared: (2, 2), receives Cov(eps).
    """
    craft = len(covariance)
    step, spread, schur = np.zeros((craft + 1, 6)), np.zeros((craft, 6, 2)), np.zeros((2, 2))
    if rho > 0 and eliminate(arrow, takes_part, 0.0, False, step, spread, schur):
        invert_spd_into(schur, shared)
    shared *= 1 - rho
    for c in range(craft):
        if takes_part[c] and invert_spd_into(arrow.normal[c], known[c]):
            known[c] *= 1 - rho
            covariance[c] = known[c]
            for a in range(6):
                for b in range(6):
                    for fan in range(2):
                        for other in range(2):
                            covariance[c, a, b] += spread[c, a, fan] * shared[fan, other] * spread[c, b, other]


def empty(craft: int) -> Arrow:
    """Return an arrow with room for `craft` craft."""
    return Arrow(np.zeros((craft, 6, 6)), np.zeros((craft, 6, 2)), np.zeros((craft, 6)), np.zeros(2), np.zeros(2))
