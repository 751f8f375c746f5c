"""A pose from sweep angles alone: every minimum of the reprojection error (7), for a craft that knows nothing yet.

A target that is small against its distance is seen nearly in parallel projection, in which a plane and its mirror
image (turned over about the line of sight) look the same. The mirrored pose is therefore often a second minimum, and
for a plane sometimes the deeper one under noise: a start must find both and let the caller compare their costs. The
starts, each finished by the Levenberg-Marquardt of `estimators.pnp`, which alone knows the craft's motion:

1. `_plane_starts`: homography of the best plane and its two decompositions; exact for coplanar photodiodes (n >= 4).
2. `_weak_perspective_start`: the linear fit of a scaled orthographic view; for n >= 4 not in one plane. It stands where
   source 1 has DLT, which needs n >= 6 and whose perspective terms drown in noise for a small target, or RPnP.
3. `_grid_starts`: twelve attitudes that leave none farther than 90 deg; for wide targets and near-flat ones, and so
   that no answer hangs on one linear fit.
4. `_mirrored`: the mirror pose of every minimum found so far.

Rotations are R_l_b, positions metres in the lighthouse frame. A *view* frame has its z axis along the mean ray.
"""

from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.pnp import FEWEST_LIT, PoseSolution, refine_projections
from estimators.projection import COLLINEAR, angle_weights, checked, checked_lit, projections

CANDIDATES_MAX = 4
ITERATIONS_MAX = 50

DISTINCT_RAD = 1e-3
"""Minima closer than this in attitude are one: LM ends within its last step, 1e-7 rad, of a minimum or, in a flat
valley, some hundred of them. One attitude has one position, because (7) is nearly linear in it."""

FLAT = 1e-3
"""Photodiodes whose smallest spread is below this share of their largest count as coplanar."""

# Even permutations and signs: the rotation group of the tetrahedron.
_GRID = np.array(
    [
        np.roll(np.diag(sign), shift, axis=0)
        for shift in range(3)
        for sign in ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0))
    ]
)

Starts = tuple[Floats, Floats]


class StartCandidates(NamedTuple):
    """Distinct minima for one craft, refined, best first, at most 4; none where the angles determine no pose.

    rotation: (M, 3, 3) R_l_b. position: (M, 3) [m], lighthouse frame. cost: (M,) sum of squared angle residuals
    [rad^2]. With independent angle noise s_ind the difference cost[1] - cost[0], in units of s_ind^2, is twice the log
    likelihood ratio of the two poses: below 25 the caller must not trust the first.
    """

    rotation: Floats
    position: Floats
    cost: Floats


def _view(ray: Floats) -> Floats:
    """R_l_view (3, 3) with z along `ray` (3,), which is not along y."""
    x, y, z = ray / np.sqrt(ray @ ray)
    h = np.hypot(x, z)
    return np.array([[z / h, -x * y / h, x], [0.0, h, y], [-x / h, -y * z / h, z]])


def _cross(a: Floats, b: Floats) -> Floats:
    """a x b of single vectors (3,): NumPy's own takes ten times as long for one."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _plane_starts(ray: Floats, point: Floats, axes: Floats) -> Starts:
    """Two poses (2, 3, 3), (2, 3) of the plane nearest to the photodiodes, from its homography.

    With (a, b) in the plane, from the photodiodes' centre along their principal axes, ray ~ H (a, b, 1): linear in H
    (Hartley and Zisserman 2004, 4.1), n >= 4, no three on a line. In the view along the centre, H (0, 0, 1), the
    Jacobian of the image at the centre is J = g A: g its largest singular value, 1/g the depth, A the upper left 2 x 2
    of the rotation. Orthonormality leaves the third row +-c with c c^T = I - A^T A: the two poses of infinitesimal
    plane-based pose estimation (Collins and Bartoli 2014, IPPE).
    """
    centre = point.mean(axis=0)
    plane = (point - centre) @ axes[:, :2]
    plane_scale = np.array([1.0, 1.0, np.abs(plane).max()])
    source = np.column_stack([plane, np.ones(len(plane))]) / plane_scale[[2, 2, 0]]
    view = _view(ray.mean(axis=0))
    seen = ray @ view
    image = seen[:, :2] / seen[:, 2:]
    # Columns of one size: the linear system is otherwise dominated by its constant terms (Hartley 1997).
    image_scale = np.abs(image).max()
    system = np.zeros((len(ray), 2, 9))
    for axis in range(2):
        system[:, axis, 3 * axis : 3 * axis + 3] = source
        system[:, axis, 6:] = -image[:, axis : axis + 1] / image_scale * source
    h = np.linalg.svd(system.reshape(-1, 9))[2][-1].reshape(3, 3)
    h = view @ (h * np.array([[image_scale], [image_scale], [1.0]])) / plane_scale[[2, 2, 0]]
    if not np.abs(h[2, 2]) > 1e-9 * np.abs(h).max() * plane_scale[2]:
        return np.empty((0, 3, 3)), np.empty((0, 3))
    view = _view(h[:, 2] * np.sign(h[2, 2]))
    h = view.T @ h
    jacobian = h[:2, :2] / h[2, 2]
    g = np.linalg.norm(jacobian, 2)
    a = jacobian / g
    rest = np.eye(2) - a.T @ a
    c = np.sqrt(np.maximum(np.diag(rest), 0)) * np.array([1.0, 1.0 if rest[0, 1] >= 0 else -1.0])
    columns = [np.vstack([a, sign * c]) for sign in (1, -1)]
    rotation = np.array([view @ np.column_stack([m, _cross(m[:, 0], m[:, 1])]) @ axes.T for m in columns])
    return rotation, view[:, 2] / g - rotation @ centre


def _weak_perspective_start(ray: Floats, point: Floats) -> Starts:
    """One pose (1, 3, 3), (1, 3) from the scaled orthographic view, for n >= 4 photodiodes that are not coplanar.

    In the view along the mean ray the images about their mean are g M (w_p - mean), M the first two rows of the
    rotation and 1/g the depth: linear least squares, then the nearest M with orthonormal rows (the first step of POSIT,
    DeMenthon and Davis 1995).
    """
    view = _view(ray.mean(axis=0))
    seen = ray @ view
    image = seen[:, :2] / seen[:, 2:]
    centre = point.mean(axis=0)
    fit = np.linalg.lstsq(point - centre, image - image.mean(axis=0), rcond=None)[0]
    left, scale, right = np.linalg.svd(fit.T, full_matrices=False)
    rows = left @ right
    rotation = view @ np.vstack([rows, _cross(rows[0], rows[1])])
    position = view @ np.append(image.mean(axis=0), 1.0) / scale.mean() - rotation @ centre
    return rotation[None], position[None]


def _grid_starts(ray: Floats, point: Floats) -> Starts:
    """Twelve poses: the tetrahedral rotations of the view frame, at the depth that gives the image its spread."""
    view = _view(ray.mean(axis=0))
    seen = ray @ view
    image = seen[:, :2] / seen[:, 2:]
    centre = point.mean(axis=0)
    across = np.einsum("mij,kj->mki", _GRID[:, :2], point - centre)
    depth = np.sqrt(np.sum(across**2, axis=(1, 2)) / np.sum((image - image.mean(axis=0)) ** 2))
    rotation = view @ _GRID
    return rotation, depth[:, None] * view[:, 2] - rotation @ centre


def _mirrored(rotation: Floats, position: Floats, centre: Floats, normal: Floats) -> Starts:
    """Poses (M, 3, 3), (M, 3) mirrored along the line of sight s to the centre: R' = (I - 2 s s^T) R (I - 2 n n^T).

    For photodiodes in the plane with normal n it shows the same parallel projection (depth reversal).
    """
    at = rotation @ centre + position
    s = at / np.linalg.norm(at, axis=-1, keepdims=True)
    flipped = rotation - 2 * s[:, :, None] * (s[:, None, :] @ rotation)
    out = flipped @ (np.eye(3) - 2 * np.outer(normal, normal))
    return out, at - out @ centre


def _distinct(solution: PoseSolution, known: StartCandidates) -> StartCandidates:
    """The solved ones and the known ones without repetitions, best first, at most 4."""
    rotation = np.concatenate([known.rotation, solution.rotation[solution.solved]])
    position = np.concatenate([known.position, solution.position[solution.solved]])
    cost = np.concatenate([known.cost, solution.cost[solution.solved]])
    order = np.argsort(cost, kind="stable")
    # The chord |Ra - Rb| of two rotations an angle a apart is 2 sqrt(2) sin(a/2).
    apart = np.linalg.norm(rotation[:, None] - rotation, axis=(-2, -1)) > np.sqrt(2) * DISTINCT_RAD
    keep: list[int] = []
    for k in order:
        if len(keep) < CANDIDATES_MAX and apart[k, keep].all():
            keep.append(int(k))
    return StartCandidates(rotation[keep], position[keep], cost[keep])


def cold_start(
    theta: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats
) -> StartCandidates:
    """Every distinct minimum of (7) in front of the lighthouse, for one craft, without a first guess.

    Args:
        theta: (K, 2) [rad], fans X and Y; ignored, NaN allowed, where not lit.
        lit: (K,), both fans seen.
        point_m: (K, 3) [m], photodiodes in the body frame.
        offset_s: (K, 2) [s], each angle's instant minus the epoch.
        angular_rate: (3,) [rad/s], assumed within the period, lighthouse frame.
        velocity: (3,) [m/s], likewise.

    No candidate where fewer than 4 are lit, where a lit angle is missing or outside (0, pi), and where the lit
    photodiodes are on a line or their images in one point.

    Raises:
        ValueError: an array's shape does not fit `lit`; the message names the argument.
    """
    lit = checked_lit(lit, np.shape(lit)[:1])
    uv = projections(checked("theta", theta, (len(lit), 2)))
    return cold_start_projections(uv, angle_weights(uv), lit, point_m, offset_s, angular_rate, velocity)


def cold_start_projections(
    uv: Floats, weight: Floats, lit: Bools, point_m: Floats, offset_s: Floats, angular_rate: Floats, velocity: Floats
) -> StartCandidates:
    """`cold_start` from projections.

    uv: (K, 2), (x/z, y/z). weight: (K, 2), each one's inverse noise; costs are in that unit of noise, as in
    `refine_projections`. The rest, and what is raised, as in `cold_start`.
    """
    lit = checked_lit(lit, np.shape(lit)[:1])
    photodiodes = len(lit)
    uv = checked("uv", uv, (photodiodes, 2))[lit]
    weight = checked("weight", weight, (photodiodes, 2))[lit]
    point = checked("point_m", point_m, (photodiodes, 3))[lit]
    offset = checked("offset_s", offset_s, (photodiodes, 2))[lit]
    angular_rate, velocity = checked("angular_rate", angular_rate, (3,)), checked("velocity", velocity, (3,))
    found = StartCandidates(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))
    if len(uv) < FEWEST_LIT or not np.isfinite(uv).all():
        return found

    centre = point.mean(axis=0)
    _, spread, axes = np.linalg.svd(point - centre)
    axes = axes.T * np.array([1.0, 1.0, np.linalg.det(axes)])
    if not (spread[1] > COLLINEAR * spread[0] and np.ptp(uv, axis=0).any()):
        return found

    def refined(rotation: Floats, position: Floats) -> PoseSolution:
        def each(array: Floats) -> Floats:
            return np.broadcast_to(array, (len(rotation), *array.shape))

        seen = np.ones((len(rotation), len(uv)), dtype=np.bool_)
        assumed = each(offset), each(angular_rate), each(velocity)
        return refine_projections(
            each(uv), each(weight), seen, each(point), rotation, position, *assumed, ITERATIONS_MAX
        )

    ray = np.column_stack([uv, np.ones(len(uv))])
    starts = [_plane_starts(ray, point, axes), _grid_starts(ray, point)]
    if spread[2] > FLAT * spread[0]:
        starts.append(_weak_perspective_start(ray, point))
    found = _distinct(refined(np.concatenate([r for r, _ in starts]), np.concatenate([p for _, p in starts])), found)
    mirrored = _mirrored(found.rotation, found.position, centre, axes[:, 2])
    return _distinct(refined(*mirrored), found)
