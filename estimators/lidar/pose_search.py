"""Poses of a known shape that a scan from one side allows, from nothing: thousands of starts, each refined a little.

Frames: s the scanner's, t the target's; a pose (R, p) maps t to s. For every rotation of a set spread evenly over SO(3)
(super-Fibonacci spirals, Alexa, CVPR 2022) the scan's centroid x_c gives a start for the position,

    p = x_c - R c(v),   v = R^T (-x_c / |x_c|)

with c(v) the centroid of what is seen of the shape from direction v: the whole shape's centroid would be wrong, since
its far side is missing from the scan. Two steps of point-to-point translation and eight of point-to-plane (as in
`estimators.lidar.registration`) follow, with closest points looked up in the shape's grid. Then the score

    mean_i min(|x_i - q_i|^2 / w^2, 1)  +  share of what v sees that the scan contradicts

where a surface point seen from v is contradicted by the ray nearest to it if that did not return, or came from clearly
behind. The second term is what tells a pose that hides surface from one that explains why it is not there.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape, Views
from estimators.linear import cholesky_into, solve_cholesky
from estimators.rotation import exp_into, multiply_into

STARTS = 3000
"""Rotations, about 13 degrees apart."""
SEARCH_POINTS, FIRST_POINTS = 160, 80
"""Returns of the scan that the search looks at, and those of the first steps."""
FOLLOWED = 750
"""Starts that are followed after the first steps."""
WIDTH = 0.12
"""Distance from the surface, against the shape's radius, beyond which a point is as wrong as can be."""
CELLS = 128
TRANSLATIONS, FIRST_STEPS, LAST_STEPS = 2, 3, 5
"""Steps of translation, with all starts, and with the best of them."""
GOLDEN = 1.533751168755204288118041
"""Root of x^4 = x + 4: the second irrational of the super-Fibonacci spirals."""


class Poses(NamedTuple):
    """M poses, best first: rotation (M, 3, 3), position (M, 3) [m], score (M,)."""

    rotation: Floats
    position: Floats
    score: Floats


Turned = Callable[[Floats, Floats], Floats]
"""Angles [rad] (n,) between attitudes (n, 3, 3) and one (3, 3)."""


class _RayImage(NamedTuple):
    """The rays by direction: frame (3, 3), its z towards the target. ray: (A, A), -1 where no ray is near. half:
    tangent of the half width.
    """

    frame: Floats
    ray: NDArray[np.int32]
    half: float


def rotations(count: int = STARTS) -> Floats:
    """Return `count` rotations (count, 3, 3), spread evenly over SO(3)."""
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1 - s / count)
    a, b = 2 * np.pi * s / np.sqrt(2), 2 * np.pi * s / GOLDEN
    return rot.matrix_from_quaternion(
        np.stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=-1)
    )


def search(scan: Scan, shape: Shape, starts: Floats) -> Poses:
    """Refine and score every start; return the poses, best first.

    Args:
        scan: the target's rays and those around it.
        shape: of the target.
        starts: (M, 3, 3), rotations.
    """
    point = scan.point
    stride = max(1, -(-len(point) // SEARCH_POINTS))
    some = np.ascontiguousarray(point[np.argsort(_shuffled(len(point)))[::stride]])
    rotation, score = starts.copy(), np.empty(len(starts))
    grid, views, centroid = shape.grid, shape.views, point.mean(axis=0)
    position = _starts(rotation, centroid, views)
    known = shape.point, shape.normal, grid.nearest, grid.low, grid.cell_m, views
    image = _ray_image(scan, centroid, shape)
    depth = np.where(scan.returned, scan.range_m, np.inf)
    widths = WIDTH * shape.radius_m, 3 * scan.noise_m + shape.spacing_m
    first = np.ascontiguousarray(some[:: max(1, len(some) // FIRST_POINTS)])
    _search_into(rotation, position, score, first, *known, image, depth, *widths, TRANSLATIONS, FIRST_STEPS)
    best = np.argsort(score, kind="stable")[:FOLLOWED]
    rotation, position, score = rotation[best], position[best], score[best]
    _search_into(rotation, position, score, some, *known, image, depth, *widths, 0, LAST_STEPS)
    order = np.argsort(score, kind="stable")
    return Poses(rotation[order], position[order], score[order])


def _starts(rotation: Floats, centroid: Floats, views: Views) -> Floats:
    """Return the positions (M, 3) at which what is seen of the shape has the scan's centroid."""
    toward = -centroid / np.linalg.norm(centroid)
    view = np.argmax((toward @ rotation) @ views.direction.T, axis=1)
    out: Floats = centroid - np.einsum("mij,mj->mi", rotation, views.centroid[view])
    return out


def distinct(poses: Poses, apart_rad: float, most: int, turned: Turned = rot.angle_between) -> Poses:
    """Return the best poses that differ.

    Args:
        poses: best first.
        apart_rad: least turn between two of them.
        most: number at most.
        turned: the angles between attitudes (n, 3, 3) and one (3, 3); of a symmetric shape, modulo its symmetry.
    """
    kept: list[int] = []
    for i in range(len(poses.score)):
        if np.isfinite(poses.score[i]) and (
            not kept or turned(poses.rotation[kept], poses.rotation[i]).min() >= apart_rad
        ):
            kept.append(i)
            if len(kept) == most:
                break
    return Poses(poses.rotation[kept], poses.position[kept], poses.score[kept])


def _shuffled(count: int) -> Floats:
    """Return numbers that order points at random, the same way every time."""
    return np.random.default_rng(0).random(count)


def _ray_image(scan: Scan, centroid: Floats, shape: Shape) -> _RayImage:
    """Return the scan's rays by direction, as wide as the target may be."""
    distance = float(np.linalg.norm(centroid))
    z = centroid / distance
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z])
    half = min(1.2 * shape.diameter_m / max(distance, 0.5 * shape.diameter_m), 2.0)
    ray, squared = np.full((CELLS, CELLS), -1, dtype=np.int32), np.full((CELLS, CELLS), (0.75 * scan.spacing_rad) ** 2)
    _image_into(scan.direction @ frame.T, 0.75 * scan.spacing_rad, half, ray, squared)
    return _RayImage(frame, ray, half)


@kernel
def _image_into(direction: Floats, reach: float, half: float, ray: NDArray[np.int32], squared: Floats) -> None:
    """Write the nearest ray of each cell, every ray into the cells that it may be the nearest of.

    Args:
        direction: (N, 3) of the rays, unit, in the image's frame.
        reach: how far from a cell's direction its ray may be.
        half: tangent of the half width.
        ray: (A, A), receives the rays.
        squared: (A, A), square of `reach`, becomes that of the distance.
    """
    cells = len(ray)
    look, low, high = np.empty((cells, cells, 3)), np.empty(2), np.empty(2)
    for i in range(cells):
        for j in range(cells):
            u, v = (i + 0.5) / cells * 2 * half - half, (j + 0.5) / cells * 2 * half - half
            size = np.sqrt(u * u + v * v + 1.0)
            look[i, j, 0], look[i, j, 1], look[i, j, 2] = u / size, v / size, 1.0 / size
    for n in range(len(direction)):
        x, y, z = direction[n, 0], direction[n, 1], direction[n, 2]
        # A cell within reach has its tangents between those of the corners of a cube; beside the camera, anywhere.
        far, near = z + reach, z - reach
        for k in range(2):
            a, b = direction[n, k] - reach, direction[n, k] + reach
            low[k], high[k] = -half, half
            if near > 0:
                low[k], high[k] = max(min(a / far, a / near), -half), min(max(b / far, b / near), half)
        first = int((low[0] + half) / (2 * half) * cells - 0.5)
        other = int((low[1] + half) / (2 * half) * cells - 0.5)
        for i in range(max(first, 0), min(int((high[0] + half) / (2 * half) * cells + 0.5), cells)):
            for j in range(max(other, 0), min(int((high[1] + half) / (2 * half) * cells + 0.5), cells)):
                dx, dy, dz = look[i, j, 0] - x, look[i, j, 1] - y, look[i, j, 2] - z
                d = dx * dx + dy * dy + dz * dz
                if d < squared[i, j]:
                    squared[i, j], ray[i, j] = d, n


@kernel
def _nearest(x: float, y: float, z: float, nearest: NDArray[np.int32], low: Floats, cell: float) -> int:
    """Return the index of the surface point nearest to a place, by the grid; outside it, by the nearest cell."""
    i = min(max(int((x - low[0]) / cell), 0), nearest.shape[0] - 1)
    j = min(max(int((y - low[1]) / cell), 0), nearest.shape[1] - 1)
    k = min(max(int((z - low[2]) / cell), 0), nearest.shape[2] - 1)
    return int(nearest[i, j, k])


@kernel
def _view(direction: Floats, rotation: Floats, toward: Floats) -> int:
    """The view nearest to R^T `toward`."""
    best, index = -2.0, 0
    x = rotation[0, 0] * toward[0] + rotation[1, 0] * toward[1] + rotation[2, 0] * toward[2]
    y = rotation[0, 1] * toward[0] + rotation[1, 1] * toward[1] + rotation[2, 1] * toward[2]
    z = rotation[0, 2] * toward[0] + rotation[1, 2] * toward[1] + rotation[2, 2] * toward[2]
    for k in range(len(direction)):
        dot = direction[k, 0] * x + direction[k, 1] * y + direction[k, 2] * z
        if dot > best:
            best, index = dot, k
    return index


@kernel
def _into_body(rotation: Floats, position: Floats, point: Floats, s: int) -> tuple[float, float, float]:
    """Return point `s` in the body: three numbers, since a row of an array counts references."""
    x, y, z = point[s, 0] - position[0], point[s, 1] - position[1], point[s, 2] - position[2]
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@kernel
def _search_into(
    rotation: Floats,
    position: Floats,
    score: Floats,
    point: Floats,
    surface: Floats,
    normal: Floats,
    nearest: NDArray[np.int32],
    low: Floats,
    cell: float,
    views: Views,
    image: _RayImage,
    depth: Floats,
    width: float,
    tolerance: float,
    translations: int,
    steps: int,
) -> None:
    j, step = np.empty(6), np.empty(6)
    a, lower = np.empty((6, 6)), np.zeros((6, 6))
    turn = np.empty((3, 3))
    for c in range(len(rotation)):
        r, p = rotation[c], position[c]
        for number in range(translations + steps):
            a[:] = 0.0
            step[:] = 0.0
            reach = 4 * width if translations > 0 and number < translations + 2 else 2 * width
            for s in range(len(point)):
                x, y, z = _into_body(r, p, point, s)
                near = _nearest(x, y, z, nearest, low, cell)
                mx, my, mz = surface[near, 0], surface[near, 1], surface[near, 2]
                dx, dy, dz = x - mx, y - my, z - mz
                square = dx**2 + dy**2 + dz**2
                if square > reach * reach:
                    continue
                weight = (1 - square / (reach * reach)) ** 2
                if number < translations:
                    for i in range(3):
                        a[i, i] += weight
                        step[i] += weight * r[i, 0] * dx
                        step[i] += weight * r[i, 1] * dy
                        step[i] += weight * r[i, 2] * dz
                    continue
                nx, ny, nz = normal[near, 0], normal[near, 1], normal[near, 2]
                error = nx * dx + ny * dy + nz * dz
                q0, w0 = r[0, 0] * mx + r[0, 1] * my + r[0, 2] * mz, r[0, 0] * nx + r[0, 1] * ny + r[0, 2] * nz
                q1, w1 = r[1, 0] * mx + r[1, 1] * my + r[1, 2] * mz, r[1, 0] * nx + r[1, 1] * ny + r[1, 2] * nz
                q2, w2 = r[2, 0] * mx + r[2, 1] * my + r[2, 2] * mz, r[2, 0] * nx + r[2, 1] * ny + r[2, 2] * nz
                j[0], j[1], j[2] = q1 * w2 - q2 * w1, q2 * w0 - q0 * w2, q0 * w1 - q1 * w0
                j[3], j[4], j[5] = w0, w1, w2
                for i in range(6):
                    w = weight * j[i]
                    step[i] += w * error
                    for k in range(i + 1):
                        a[i, k] += w * j[k]
            if number < translations:
                for i in range(3):
                    p[i] += step[i] / max(a[i, i], 1.0)
                continue
            # Damped: what the matched surface does not determine stays where it is.
            trace = 1e-9
            for i in range(6):
                trace += a[i, i]
                for k in range(i):
                    a[k, i] = a[i, k]
            for i in range(6):
                a[i, i] += 1e-3 * trace
            if not cholesky_into(a, lower):
                break
            solve_cholesky(lower, step)
            exp_into(step[:3], turn)
            multiply_into(turn, r, r)
            for i in range(3):
                p[i] += step[3 + i]
        score[c] = _score(r, p, point, surface, nearest, low, cell, views, image, depth, width, tolerance)


@kernel
def _score(
    rotation: Floats,
    position: Floats,
    point: Floats,
    surface: Floats,
    nearest: NDArray[np.int32],
    low: Floats,
    cell: float,
    views: Views,
    image: _RayImage,
    depth: Floats,
    width: float,
    tolerance: float,
) -> float:
    forward = 0.0
    for s in range(len(point)):
        x, y, z = _into_body(rotation, position, point, s)
        near = _nearest(x, y, z, nearest, low, cell)
        square = (x - surface[near, 0]) ** 2 + (y - surface[near, 1]) ** 2 + (z - surface[near, 2]) ** 2
        forward += min(square / (width * width), 1.0)
    distance = np.sqrt(np.sum(position**2))
    v = _view(views.direction, rotation, -position / max(distance, 1e-9))
    observed, contradicted = 0, 0
    size = image.ray.shape[0]
    q = np.empty(3)
    for index in views.sample[v]:
        mx, my, mz = surface[index, 0], surface[index, 1], surface[index, 2]
        for i in range(3):
            q[i] = position[i] + rotation[i, 0] * mx + rotation[i, 1] * my + rotation[i, 2] * mz
        z = image.frame[2, 0] * q[0] + image.frame[2, 1] * q[1] + image.frame[2, 2] * q[2]
        if z <= 0:
            continue
        x = (image.frame[0, 0] * q[0] + image.frame[0, 1] * q[1] + image.frame[0, 2] * q[2]) / z
        y = (image.frame[1, 0] * q[0] + image.frame[1, 1] * q[1] + image.frame[1, 2] * q[2]) / z
        column, row = int((x + image.half) / (2 * image.half) * size), int((y + image.half) / (2 * image.half) * size)
        if column < 0 or row < 0 or column >= size or row >= size or abs(x) > image.half or abs(y) > image.half:
            continue
        ray = image.ray[column, row]
        if ray < 0:
            continue
        observed += 1
        if depth[ray] > np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]) + 2 * tolerance:
            contradicted += 1
    return forward / len(point) + (contradicted / observed if observed > 0 else 1.0)
