"""The assignment of craft to the places of a new formation: the least sum of squared distances.

Straight lines flown in step between places more than 2 sqrt(2) R apart, so assigned, keep craft of radius R clear of
each other (Turpin, Michael and Kumar, "CAPT", Int. J. Robotics Research 33(1), 2014, theorem 1). SciPy finds the
optimum. Every craft computes it from the same broadcasts, and so comes to the same answer.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from estimators.arrays import Floats, Ints


def assign(position: Floats, places: Floats) -> Ints:
    """(N,): the index in `places` (N, 3) [m] of each craft at `position` (N, 3) [m]; both finite."""
    cost = np.sum((position[:, None] - places[None]) ** 2, axis=2)
    out = np.empty(len(position), dtype=np.int64)
    craft, place = linear_sum_assignment(cost)
    out[craft] = place
    return out
