"""Assignment of craft to the places of a new formation, with the least sum of squared distances.

Craft of radius R that are assigned in this way, and that fly on straight lines in step between places more than
2 sqrt(2) R apart, keep clear of each other (Turpin, Michael and Kumar, "CAPT", Int. J. Robotics Research 33(1), 2014,
theorem 1). SciPy finds the optimum. Every craft computes it from the same broadcasts and so gets the same result.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from estimators.arrays import Floats, Ints


def assign(position: Floats, places: Floats) -> Ints:
    """Return the index in `places` (N, 3) [m] of each craft at `position` (N, 3) [m], (N,); both must be finite."""
    cost = np.sum((position[:, None] - places[None]) ** 2, axis=2)
    out = np.empty(len(position), dtype=np.int64)
    craft, place = linear_sum_assignment(cost)
    out[craft] = place
    return out
