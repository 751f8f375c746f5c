"""Array types used everywhere: plain NumPy arrays, double precision, a leading craft axis.

Letters in shapes: C craft, K photodiodes (padded to the largest craft), 2 fans (X then Y).
"""

from math import prod

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

LINE = 64
"""Bytes of a line of the processor's cache, and of its widest vectors."""


def lined(*shape: int, filled: bool = True) -> Floats:
    """Return an array of zeros, or of whatever is there if it is not to be `filled`, that begins with a line of the
    cache.

    NumPy's own begin a quarter of a line later where they are large, and every second vector in them lies across two
    lines, which takes as long as two.
    """
    size = prod(shape)
    raw = (np.zeros if filled else np.empty)(size + LINE // 8)
    first = -raw.__array_interface__["data"][0] % LINE // 8
    return raw[first : first + size].reshape(shape)
