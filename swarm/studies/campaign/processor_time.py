"""Times of the processor, not of the wall: what else the machine runs disturbs them through its caches only."""

from collections.abc import Callable, Collection
from time import thread_time
from typing import TypeVar

import numpy as np

REPEATS = 3
"""A timed solution is run so often, and the fastest counts: the others were disturbed."""
T = TypeVar("T")


def fastest(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result of `work`, and the time of its fastest repeat [s]."""
    least = np.inf
    for _ in range(REPEATS):
        began = thread_time()
        result = work()
        least = min(least, thread_time() - began)
    return result, least


def median_us(seconds: Collection[float], among: int = 1) -> float | None:
    """Return the median of times [s] in microseconds per one of `among`; None where there are none."""
    return float(np.median(list(seconds)) * 1e6 / among) if len(seconds) else None
