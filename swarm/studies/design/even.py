"""An even spread of photodiodes over a hull: what a layout that was thought about must beat.

On the places (N, 3) [m] that a photodiode fits on, each next photodiode goes where it is farthest from all others
(Gonzalez, Clustering to minimize the maximum intercluster distance, 1985). The first one is free: of several, the most
even spread is the one whose least distance is largest.
"""

import numpy as np

from estimators.arrays import Floats, Ints


def farthest_points(point: Floats, count: int, first: int) -> Ints:
    """Spread points one after the other, each where it is farthest from those before.

    Args:
        point: Points to choose from (N, 3) [m].
        count: Number of points n.
        first: Index of the first.

    Returns:
        Indices (n,).
    """
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = first
    nearest = np.linalg.norm(point - point[first], axis=1)
    for i in range(1, count):
        chosen[i] = int(np.argmax(nearest))
        nearest = np.minimum(nearest, np.linalg.norm(point - point[chosen[i]], axis=1))
    return chosen


def outermost(point: Floats) -> int:
    """Return the index of the point of (N, 3) that is farthest from the middle of all."""
    return int(np.argmax(np.linalg.norm(point - point.mean(axis=0), axis=1)))


def even_spreads(point: Floats, count: int, firsts: int) -> list[Ints]:
    """Return several spreads, the most even one first.

    Args:
        point: Points to choose from (N, 3) [m].
        count: Number of points n of a spread.
        firsts: Number of spreads, each from another first point.

    Returns:
        Indices (n,) of every spread.
    """
    starts = np.unique(np.linspace(0, len(point) - 1, firsts).round().astype(np.int64))
    spreads = [farthest_points(point, count, int(first)) for first in starts]
    return sorted(spreads, key=lambda chosen: -least_distance(point[chosen]))


def least_distance(point: Floats) -> float:
    """Return the distance between the nearest two of the points (n, 3), n >= 2."""
    distance = np.linalg.norm(point[:, None] - point, axis=-1)
    return float(distance[np.triu_indices(len(point), 1)].min())
