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
    viewpoint, direction = -rotation.T @ position, scan.direction @ rotation
    sigma = math.hypot(scan.noise_m, 0.25 * shape.spacing_m)
    squared, (tells, stray) = np.empty(len(direction)), np.empty((2, len(direction)), dtype=np.bool_)
    _compare_into(shape.mesh, viewpoint, direction, scan.range_m, sigma, squared, tells, stray)
    # A return beside the silhouette, within the jitter, lies on the surface all the same; one from behind does not.
    if stray.any():
        own = (scan.direction[stray] * scan.range_m[stray, None] - position) @ rotation
        gap = shape.tree.query(own, distance_upper_bound=4 * sigma + shape.spacing_m)[0]
        squared[stray] = np.minimum((np.maximum(gap - shape.spacing_m / 2, 0) / sigma) ** 2, WORST)
    conflict = tells & ~(squared < WORST)
    rays = int(np.count_nonzero(tells))
    overlap = 1 - np.count_nonzero(conflict) / rays if rays else np.nan
    return Agreement(float(overlap), float(np.sum(squared[tells])), rays, conflict)


@kernel
def _compare_into(
    mesh: Triangles,
    viewpoint: Floats,
    direction: Floats,
    range_m: Floats,
    sigma: float,
    squared: Floats,
    tells: Bools,
    stray: Bools,
) -> None:
    """Write squared sigmas (N,), which rays say something, and which returned from where none is met by them."""
    stack, entries = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    x, y, z = viewpoint[0], viewpoint[1], viewpoint[2]
    for i in range(len(direction)):
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        distance, t = first_hit(mesh, x, y, z, dx, dy, dz, 0.0, stack, entries)
        cosine = abs(mesh.normal[t, 0] * dx + mesh.normal[t, 1] * dy + mesh.normal[t, 2] * dz)
        measured, predicted = np.isfinite(range_m[i]), t >= 0
        squared[i] = WORST
        if measured and predicted:
            squared[i] = min(((range_m[i] - distance) * cosine / sigma) ** 2, WORST)
        tells[i] = measured or (predicted and cosine > RELIABLE_COSINE)
        stray[i] = measured and squared[i] >= WORST and not range_m[i] > distance
