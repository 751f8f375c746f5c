"""The least number of photodiodes that any layout needs, by linear programming.

Of N places, x_k in 0..1 says how much of a photodiode sits at place k. Every pose p must be seen by `needed` of them:

    minimise  sum x   subject to   sum_k reached_pk x_k >= needed  for all p,   0 <= x <= 1

Whole photodiodes are a special case, so no layout at these places does with fewer. At a pose that fewer than `needed`
places see there is no layout at all.
"""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from estimators.arrays import Bools

ROUNDING = 1e-6


def fewest(reached: Bools, needed: int) -> int | None:
    """Return a number below which no layout is enough; None where all places together are not.

    Args:
        reached: (Q, N), places lit at every pose.
        needed: photodiodes that must be lit at every pose.
    """
    rows = np.unique(reached, axis=0)
    if (np.count_nonzero(rows, axis=1) < needed).any():
        return None
    places = rows.shape[1]
    found = linprog(
        np.ones(places), -csr_matrix(rows.astype(np.float64)), np.full(len(rows), -float(needed)), bounds=(0, 1)
    )
    return needed if found.fun is None else max(needed, int(np.ceil(found.fun - ROUNDING)))
