"""Attitude from several vectors, known in one frame and observed in another: source 2 (9) to (13).

Columns of V (3, m) are the known vectors, those of U (3, m) the observed ones, U = C V (9); C is the rotation wanted.

1. Rank 3: with the full-rank factorisation V = B C', B = I, the generalised inverse gives the minimum-norm solution
   C_0 = U V^+, V^+ = V^T (V V^T)^-1 (10, 11): `minimum_norm`. Under noise C_0 is not orthogonal.
2. To orthogonalise C_0 by itself would violate (9). The criterion is the smallest correction of what was observed,

       min |dU|^2 = sum |u_k - C v_k|^2   over   C^T C = I, det C = +1                     (12, 13)

   which is the largest trace of C^T H, H = U V^T: Wahba's problem. Its solution is the polar factor of U V^T, not that
   of U V^+; the two agree where V V^T is isotropic or the vectors are exact.
3. Rank 2, all vectors in one plane: the plane's normal joins U and V as one more column (two-vector attitude). H then
   gains n_u n_v^T, with n_u normal to all of H's columns and signed such that det C = +1. Among rotations the largest
   trace is where it was without that column, so `attitude_into` needs no special case (tested against the columns).

Solved as the eigenvector of the largest eigenvalue of Davenport's symmetric 4 x 4 matrix, a unit quaternion, by cyclic
Jacobi rotations: the distance to the next eigenvalue is 2 (s_2 +- s_3), s the singular values of H, which vanishes only
where the vectors are on one line.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.eigen import eigen_into
from estimators.kernel import kernel
from estimators.rotation import quaternion_rows

LEAST_GAP = 1e-10
"""Two largest eigenvalues nearer than this share of the first leave a turn about one axis open: s_2 / s_1 is about the
square of the vectors' width over their length."""


def minimum_norm(observed: Floats, known: Floats) -> Floats:
    """Return C_0 = U V^+ (10, 11), (..., 3, 3), of columns `observed`, `known` (..., 3, m) that span the space.

    Raises ValueError where `known` does not: rank 2 has no unique C_0.
    """
    normal = known @ np.swapaxes(known, -1, -2)
    if np.any(np.linalg.cond(normal) > 1e12):
        raise ValueError("known: the vectors lie in one plane")
    # V V^T is symmetric: solving it from the left gives the transpose of U V^T (V V^T)^-1.
    across = known @ np.swapaxes(observed, -1, -2)
    out: Floats = np.swapaxes(np.linalg.solve(normal, across), -1, -2)
    return out


@kernel
def attitude_into(h: Floats, out: Floats) -> bool:
    """Write the rotation of largest trace(out^T h), h = sum of u v^T (3, 3), into `out` (3, 3); False if not unique."""
    k = np.empty((4, 4))
    k[0, 0] = h[0, 0] + h[1, 1] + h[2, 2]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        k[0, 1 + i] = k[1 + i, 0] = h[b, a] - h[a, b]
        for j in range(3):
            k[1 + i, 1 + j] = h[i, j] + h[j, i]
        k[1 + i, 1 + i] -= k[0, 0]
    vector = np.empty((4, 4))
    eigen_into(k, vector)
    best = 0
    for i in range(1, 4):
        if k[i, i] > k[best, best]:
            best = i
    second = -np.inf
    for i in range(4):
        if i != best:
            second = max(second, k[i, i])
    if not k[best, best] - second > LEAST_GAP * k[best, best]:
        return False
    size = np.sqrt(vector[0, best] ** 2 + vector[1, best] ** 2 + vector[2, best] ** 2 + vector[3, best] ** 2)
    a, b, c, d = vector[0, best] / size, vector[1, best] / size, vector[2, best] / size, vector[3, best] / size
    turn = quaternion_rows(a, b, c, d)
    for i in range(3):
        out[i, 0], out[i, 1], out[i, 2] = turn[i]
    return True
