"""Array types used everywhere: plain NumPy arrays, double precision, a leading craft axis.

Letters in shapes: C craft, K photodiodes (padded to the largest craft), 2 fans (X then Y).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
