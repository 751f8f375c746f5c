"""Agreement of a scan with a pose of a known shape: every ray's range against the one that the pose predicts.

The shape is looked at along the scan's own rays (`estimators.lidar.ray_cast`). With the measured range r, the predicted
one g, incidence i and a tolerance c from noise and ray spacing, a ray

    agrees      |r - g| cos i <= c
    disagrees   both returned, but further apart; a return where none is predicted; none where one is predicted
                at an incidence at which returns can be relied on

and `overlap` is the share that agrees among all of these. A point cloud's residual alone knows only the first kind of
disagreement: a pose that hides half of the target behind itself has a small residual, but a small overlap too.
"""

import math
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.kernel import kernel
from estimators.lidar.nearest import PointTree, nearest_into
from estimators.lidar.ray_cast import STACK, Triangles, first_hit
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape

RELIABLE_COSINE = 0.35
"""Cosine of the incidence (70 degrees): a ray that comes in flatter may well not return."""
WORST = 16.0
"""Cost of a ray that disagrees, in squared sigmas."""


class Agreement(NamedTuple):
    """Agreement of a scan with a pose. overlap: 0 to 1, NaN where no ray says anything. cost: sum over rays of squared
    sigmas, each at most `WORST`.

    rays: how many say something. conflict: (N,), the rays of the scan that disagree.
    """

    overlap: float
    cost: float
    rays: int
    conflict: Bools


def agreement(scan: Scan, shape: Shape, rotation: Floats, position: Floats) -> Agreement:
    """Compare a scan with the target at a pose.

    Args:
        scan: of the target and its surroundings.
        shape: of the target.
        rotation: (3, 3), target to scanner.
        position: (3,) [m], likewise.
    """
    sigma, conflict = math.hypot(scan.noise_m, 0.25 * shape.spacing_m), np.empty(len(scan.range_m), dtype=np.bool_)
    mesh, surface, spacing = shape.mesh, shape.nearest, shape.spacing_m
    given = scan.direction, scan.range_m, rotation, position
    cost, rays, against = _compare_into(*given, mesh, surface, spacing, sigma, conflict)
    return Agreement(1 - against / rays if rays else np.nan, cost, rays, conflict)


@kernel
def _compare_into(
    direction: Floats,
    range_m: Floats,
    rotation: Floats,
    position: Floats,
    mesh: Triangles,
    surface: PointTree,
    spacing: float,
    sigma: float,
    conflict: Bools,
) -> tuple[float, int, int]:
    """Write which rays disagree (N,); return the cost, how many rays say something, and how many of them disagree."""
    stack, entries = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    gap, which = np.empty(1), np.empty(1, dtype=np.int64)
    reach, cost, rays, against = (4 * sigma + spacing) ** 2, 0.0, 0, 0
    x, y, z = _turned_back(rotation, -position[0], -position[1], -position[2])
    for i in range(len(direction)):
        dx, dy, dz = _turned_back(rotation, direction[i, 0], direction[i, 1], direction[i, 2])
        distance, t = first_hit(mesh, x, y, z, dx, dy, dz, 0.0, stack, entries)
        cosine = abs(mesh.normal[t, 0] * dx + mesh.normal[t, 1] * dy + mesh.normal[t, 2] * dz)
        r, predicted, squared = range_m[i], t >= 0, WORST
        measured = np.isfinite(r)
        conflict[i] = False
        if not (measured or (predicted and cosine > RELIABLE_COSINE)):
            continue
        if measured and predicted:
            squared = min(((r - distance) * cosine / sigma) ** 2, WORST)
        # A return beside the silhouette, within the jitter, lies on the surface all the same; one from behind does not.
        beside = measured and squared >= WORST and not r > distance
        if beside and nearest_into(surface, x + r * dx, y + r * dy, z + r * dz, reach, gap, which, stack, entries):
            squared = min((max(np.sqrt(gap[0]) - spacing / 2, 0.0) / sigma) ** 2, WORST)
        conflict[i] = not squared < WORST
        cost, rays, against = cost + squared, rays + 1, against + (1 if conflict[i] else 0)
    return cost, rays, against


@kernel
def _turned_back(rotation: Floats, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R^T v, three numbers."""
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )
