"""The one door to numba: `kernel` compiles a plain loop, cached on disk, without the GIL.

Kernels are written per craft, as loops that read like the equations, and mapped over the craft axis by
their caller; `np.linalg` stays out of them (it costs many seconds of compile time).
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with numba: cached, NumPy's division by zero (inf, nan), strict IEEE order."""
    compiled: Callable[P, R] = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=False)(function)
    return compiled
