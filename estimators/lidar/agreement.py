"""Agreement of a scan with a pose of a known shape: every ray's range against the one that the pose predicts.

The shape is looked at along the scan's own rays (`estimators.lidar.ray_cast`). With the measured range r, the predicted
one g, incidence i and a tolerance c from noise and ray spacing, a ray

    agrees      |r - g| cos i <= c
    disagrees   both returned, but further apart; a return where none is predicted; none where one is predicted
                at an incidence at which returns can be relied on

and `overlap` is the share that agrees among all of these. A point cloud's residual alone knows only the first kind of
disagreement: a pose that hides half of the target behind itself has a small residual, but a small overlap too.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lidar.ray_cast import cast
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
    viewpoint = -rotation.T @ position
    direction = scan.direction @ rotation
    hits = cast(shape.mesh, viewpoint, direction)
    predicted = np.isfinite(hits.distance)
    cosine = np.abs(np.sum(shape.mesh.normal[hits.triangle] * direction, axis=1))
    measured = scan.returned
    off = np.where(measured & predicted, (scan.range_m - np.where(predicted, hits.distance, 0.0)) * cosine, np.inf)
    sigma = np.hypot(scan.noise_m, 0.25 * shape.spacing_m)
    squared = np.minimum((off / sigma) ** 2, WORST)
    # A return beside the silhouette, within the jitter, lies on the surface all the same; one from behind does not.
    stray = np.flatnonzero(measured & (squared >= WORST) & ~(scan.range_m > hits.distance))
    if len(stray):
        own = (scan.direction[stray] * scan.range_m[stray, None] - position) @ rotation
        gap = shape.tree.query(own, distance_upper_bound=4 * sigma + shape.spacing_m)[0]
        squared[stray] = np.minimum((np.maximum(gap - shape.spacing_m / 2, 0) / sigma) ** 2, WORST)
    missing = ~measured & predicted & (cosine > RELIABLE_COSINE)
    tells = measured | missing
    conflict = tells & ~(squared < WORST)
    rays = int(np.count_nonzero(tells))
    overlap = 1 - np.count_nonzero(conflict) / rays if rays else np.nan
    return Agreement(float(overlap), float(np.sum(squared[tells])), rays, conflict)
