"""First guesses of a pose from sweep angles: closed forms for G craft side by side, each with n lit photodiodes.

`ray` (G, n, 3) are the directions (u, v, 1) = (x/z, y/z, 1) of the photodiodes, `point` (G, n, 3) their places [m] in
the body frame, `centre` (G, 3) the mean of those. Rotations are R_l_b, positions metres in the lighthouse frame; a
*view* frame has its z axis along the mean ray. `estimators.lighthouse.pnp_start` says what each guess is for, and
refines it.
"""

import numpy as np

from estimators.arrays import Bools, Floats

# Even permutations and signs: the rotation group of the tetrahedron.
_GRID = np.array(
    [
        np.roll(np.diag(sign), shift, axis=0)
        for shift in range(3)
        for sign in ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))
    ]
)

Starts = tuple[Floats, Floats]
"""Rotations (G, M, 3, 3) and positions (G, M, 3) of G craft; NaN where a start does not exist."""


def transposed(matrix: Floats) -> Floats:
    """Return the transposes of matrices (..., m, n)."""
    return np.swapaxes(matrix, -1, -2)


def _view(ray: Floats) -> Floats:
    """Return R_l_view (G, 3, 3) with z along `ray` (G, 3), which is not along y."""
    x, y, z = (ray / np.sqrt(np.sum(ray * ray, axis=1))[:, None]).T
    h = np.hypot(x, z)
    rows = (z / h, -x * y / h, x), (np.zeros_like(h), h, y), (-x / h, -y * z / h, z)
    return np.moveaxis(np.array(rows), 2, 0)


def _seen(ray: Floats) -> tuple[Floats, Floats]:
    """Return the view along the mean ray (G, 3, 3), and in it the images (G, n, 2) of `ray` (G, n, 3)."""
    view = _view(ray.mean(axis=1))
    seen = ray @ view
    return view, seen[..., :2] / seen[..., 2:]


def plane_starts(ray: Floats, point: Floats, centre: Floats, axes: Floats) -> Starts:
    """Return two poses each of the plane nearest to the photodiodes, from its homography.

    With (a, b) in the plane, from the photodiodes' centre along their principal axes, ray ~ H (a, b, 1): linear in H
    (Hartley and Zisserman 2004, 4.1), n >= 4, no three on a line. In the view along the centre, H (0, 0, 1), the
    Jacobian of the image at the centre is J = g A: g its largest singular value, 1/g the depth, A the upper left 2 x 2
    of the rotation. Orthonormality leaves the third row +-c with c c^T = I - A^T A: the two poses of infinitesimal
    plane-based pose estimation (Collins and Bartoli 2014, IPPE).

    Args:
        ray: (G, n, 3).
        point: (G, n, 3) [m].
        centre: (G, 3) [m].
        axes: (G, 3, 3), principal axes of the photodiodes as columns.
    """
    craft, count = ray.shape[:2]
    plane = (point - centre[:, None]) @ axes[..., :2]
    plane_scale = np.abs(plane).max(axis=(1, 2))
    source = np.concatenate([plane / plane_scale[:, None, None], np.ones((craft, count, 1))], axis=2)
    view, image = _seen(ray)
    # Columns of one size: the linear system is otherwise dominated by its constant terms (Hartley 1997).
    image_scale = np.abs(image).max(axis=(1, 2))
    system = np.zeros((craft, count, 2, 9))
    for axis in range(2):
        system[:, :, axis, 3 * axis : 3 * axis + 3] = source
        system[:, :, axis, 6:] = -image[:, :, axis, None] / image_scale[:, None, None] * source
    h = np.linalg.svd(system.reshape(craft, -1, 9))[2][:, -1].reshape(craft, 3, 3)
    h[:, :2] *= image_scale[:, None, None]
    h[..., :2] /= plane_scale[:, None, None]
    h = view @ h
    exists = np.abs(h[:, 2, 2]) > 1e-9 * np.abs(h).max(axis=(1, 2)) * plane_scale
    h[~exists] = np.eye(3)
    view = _view(h[:, :, 2] * np.sign(h[:, 2, 2])[:, None])
    h = transposed(view) @ h
    jacobian = h[:, :2, :2] / h[:, 2:, 2:]
    g = np.linalg.norm(jacobian, 2, axis=(1, 2))
    a = jacobian / g[:, None, None]
    rest = np.eye(2) - transposed(a) @ a
    c = np.sqrt(np.maximum(np.diagonal(rest, axis1=1, axis2=2), 0))
    c[:, 1] *= np.where(rest[:, 0, 1] >= 0, 1.0, -1.0)
    columns = np.stack([np.concatenate([a, sign * c[:, None]], axis=1) for sign in (1, -1)], axis=1)
    third = np.cross(columns[..., 0], columns[..., 1])[..., None]
    rotation = view[:, None] @ np.concatenate([columns, third], axis=3) @ transposed(axes)[:, None]
    rotation[~exists] = np.nan
    position = (view[:, :, 2] / g[:, None])[:, None] - (rotation @ centre[:, None, :, None])[..., 0]
    return rotation, position


def weak_perspective_start(ray: Floats, point: Floats, centre: Floats, solid: Bools) -> Starts:
    """Return one pose each from the scaled orthographic view, for n >= 4 photodiodes that are not coplanar.

    In the view along the mean ray the images about their mean are g M (w_p - mean), M the first two rows of the
    rotation and 1/g the depth: linear least squares, then the nearest M with orthonormal rows (the first step of POSIT,
    DeMenthon and Davis 1995).

    Args:
        ray: (G, n, 3).
        point: (G, n, 3) [m].
        centre: (G, 3) [m].
        solid: (G,), False where the photodiodes are coplanar.
    """
    rotation, position = np.full((len(ray), 1, 3, 3), np.nan), np.full((len(ray), 1, 3), np.nan)
    if solid.any():
        view, image = _seen(ray[solid])
        middle = image.mean(axis=1)
        fit = np.linalg.pinv(point[solid] - centre[solid, None]) @ (image - middle[:, None])
        left, scale, right = np.linalg.svd(transposed(fit), full_matrices=False)
        rows = left @ right
        turned = view @ np.concatenate([rows, np.cross(rows[:, 0], rows[:, 1])[:, None]], axis=1)
        ahead = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
        at = (view @ ahead[..., None])[..., 0] / scale.mean(axis=1)[:, None]
        rotation[solid, 0] = turned
        position[solid, 0] = at - (turned @ centre[solid, :, None])[..., 0]
    return rotation, position


def grid_starts(ray: Floats, point: Floats, centre: Floats) -> Starts:
    """Return twelve poses, the tetrahedral rotations of the view frame, at the depth that gives the image its spread.

    Args:
        ray: (G, n, 3).
        point: (G, n, 3) [m].
        centre: (G, 3) [m].
    """
    view, image = _seen(ray)
    across = (point - centre[:, None])[:, None] @ transposed(_GRID[:, :2])
    spread = np.sum((image - image.mean(axis=1)[:, None]) ** 2, axis=(1, 2))
    depth = np.sqrt(np.sum(across**2, axis=(2, 3)) / spread[:, None])
    rotation = view[:, None] @ _GRID
    return rotation, depth[..., None] * view[:, None, :, 2] - (rotation @ centre[:, None, :, None])[..., 0]


def mirrored(rotation: Floats, position: Floats, centre: Floats, normal: Floats) -> Starts:
    """Return poses mirrored along the line of sight s to the centre: R' = (I - 2 s s^T) R (I - 2 n n^T).

    For photodiodes in the plane with normal n it shows the same parallel projection (depth reversal).

    Args:
        rotation: (G, M, 3, 3).
        position: (G, M, 3) [m].
        centre: (G, 3) [m].
        normal: (G, 3), n.
    """
    at = (rotation @ centre[:, None, :, None])[..., 0] + position
    s = at / np.linalg.norm(at, axis=-1, keepdims=True)
    flipped = rotation - 2 * s[..., None] * (s[..., None, :] @ rotation)
    out = flipped @ (np.eye(3) - 2 * normal[:, :, None] * normal[:, None])[:, None]
    return out, at - (out @ centre[:, None, :, None])[..., 0]
