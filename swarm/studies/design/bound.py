"""The least number of photodiodes, or of stations, that any design needs, by linear programming.

Of N places, x_k in 0..1 says how much of a photodiode sits at place k. Every pose p must be seen by `needed` of them:

    minimise  sum x   subject to   sum_k reached_pk x_k >= needed  for all p,   0 <= x <= 1

Whole photodiodes are a special case, so no layout at these places does with fewer. At a pose that fewer than `needed`
places see there is no layout at all.

A station k lights r_pk photodiodes of pose p at once, of which no more than `needed` count. With a share f of the P
poses forgiven, by y_p in 0..1,

    minimise  sum x   subject to   sum_k r_pk x_k >= needed (1 - y_p)  for all p,   sum y <= f P,   0 <= x, y <= 1
"""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from estimators.arrays import Bools, Ints

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


def fewest_covering(lit: Ints, needed: int, share: float, parts: int = 1) -> int | None:
    """Return a number of stations below which none is enough; None where all candidates together are not.

    Args:
        lit: (P, N), photodiodes that each station lights at every pose.
        needed: photodiodes that must be lit at a pose, by all stations together.
        share: share of the poses at which they must be.
        parts: stations of which at least one photodiode must be lit, by any of them.
    """
    poses, stations = lit.shape
    capped = np.minimum(lit, needed)
    beyond = int(np.floor((1 - share) * poses + 1e-9))
    enough = (capped.sum(axis=1) >= needed) & (np.count_nonzero(lit, axis=1) >= parts)
    if poses - np.count_nonzero(enough) > beyond:
        return None
    forgiven = np.eye(poses)
    rows = [
        np.hstack([-capped.astype(np.float64), -needed * forgiven]),
        np.hstack([-(lit > 0).astype(np.float64), -parts * forgiven]),
        np.concatenate([np.zeros(stations), np.ones(poses)])[None],
    ]
    limit = np.concatenate([np.full(poses, -float(needed)), np.full(poses, -float(parts)), [float(beyond)]])
    cost = np.concatenate([np.ones(stations), np.zeros(poses)])
    found = linprog(cost, csr_matrix(np.vstack(rows)), limit, bounds=(0, 1))
    return parts if found.fun is None else max(parts, int(np.ceil(found.fun - ROUNDING)))
