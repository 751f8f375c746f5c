"""Curvature of a surface of which only points are known, and its growth into regions.

At every point a quadric is fitted to the neighbours within a radius, in a frame whose z is their normal by principal
components (Feng et al. 2024; numbers in brackets are its equations, the formulae rebuilt):

    z = a x^2 + b x y + c y^2 (+ d x + e y),  by least squares                                        (6) to (8)
    first and second derivatives at the point, normal                                                 (9) to (11)
    E = 1 + z_x^2, F = z_x z_y, G = 1 + z_y^2;   L, M, N = (z_xx, z_xy, z_yy) / sqrt(1 + z_x^2 + z_y^2)      (12)
    K = (L N - M^2) / (E G - F^2),   H = (E N - 2 F M + G L) / (2 (E G - F^2))                              (13)
    k = H +- sqrt(H^2 - K)                                                                                  (14)

The paper's quadric has no linear part; d and e let the normal be a little wrong: without them z_x and z_y are zero.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from estimators.arrays import Floats, Ints
from estimators.lidar.point_cloud import checked

FEWEST_NEIGHBOURS = 8


class Curvature(NamedTuple):
    """Curvature at n points. gaussian (n,) [1/m^2], mean (n,) [1/m], principal (n, 2) [1/m], the larger magnitude
    first; normal (n, 3), without a side. NaN where a point has too few neighbours.
    """

    gaussian: Floats
    mean: Floats
    principal: Floats
    normal: Floats


def curvature(point: Floats, radius_m: float) -> Curvature:
    """Return the curvature at every one of the points (n, 3) [m], from its neighbours within `radius_m`.

    Raises ValueError where the points are not (n, 3) or not finite.
    """
    point = checked(point, 0)
    out = Curvature(*(np.full((len(point), *shape), np.nan) for shape in ((), (), (2,), (3,))))
    if not len(point):
        return out
    for i, members in enumerate(cKDTree(point).query_ball_point(point, radius_m)):
        if len(members) < FEWEST_NEIGHBOURS:
            continue
        near = point[members] - point[i]
        centred = near - near.mean(axis=0)
        frame = np.linalg.eigh(centred.T @ centred)[1][:, ::-1]
        x, y, z = (near @ frame).T
        terms = np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1)
        solution, _, rank, _ = np.linalg.lstsq(terms, z, rcond=1e-6)
        if rank < terms.shape[1]:
            continue
        a, b, c, zx, zy, _ = solution
        root = np.sqrt(1 + zx * zx + zy * zy)
        e, f, g = 1 + zx * zx, zx * zy, 1 + zy * zy
        fundamental = e * g - f * f
        second, mixed, other = 2 * a / root, b / root, 2 * c / root
        gaussian = (second * other - mixed * mixed) / fundamental
        mean = (e * other - 2 * f * mixed + g * second) / (2 * fundamental)
        spread = np.sqrt(max(mean * mean - gaussian, 0.0))
        pair = np.array([mean + spread, mean - spread])
        out.gaussian[i], out.mean[i] = gaussian, mean
        out.principal[i] = pair[np.argsort(-np.abs(pair))]
        out.normal[i] = frame @ np.array([-zx, -zy, 1.0]) / root
    return out


def grow(point: Floats, value: Floats, seed_least: float, join_least: float, radius_m: float) -> list[Ints]:
    """Return regions of points with a large value: indices of each, the largest region first.

    Seeds are taken from the largest value downwards; a region grows over neighbours.

    Args:
        point: (n, 3) [m].
        value: (n,); NaN joins nothing.
        seed_least: least value of a seed.
        join_least: least value of a point that joins.
        radius_m: distance of neighbours [m].

    Raises:
        ValueError: as `curvature`.
    """
    point = checked(point, 0)
    known = np.where(np.isnan(value), -np.inf, value)
    free = known >= join_least
    tree = cKDTree(point) if len(point) else None
    regions: list[Ints] = []
    for seed in np.argsort(-known, kind="stable"):
        if known[seed] < seed_least or tree is None:
            break
        if not free[seed]:
            continue
        free[seed] = False
        region, front = [int(seed)], [int(seed)]
        while front:
            for j in tree.query_ball_point(point[front.pop()], radius_m):
                if free[j]:
                    free[j] = False
                    region.append(j)
                    front.append(j)
        regions.append(np.array(sorted(region), dtype=np.int64))
    return sorted(regions, key=len, reverse=True)
