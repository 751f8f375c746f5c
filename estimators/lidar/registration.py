"""Point-to-plane registration of a scan with a target's known surface: iterated closest points, with a covariance.

Frames: s the scanner's, t the target's. The pose (R, p) of the target in s maps t to s. A scanned point x_i is matched
with its closest surface point m_i (k-d tree), normal n_i, both in t; with q_i = R m_i + p and N_i = R n_i in s

    e_i = N_i . (x_i - q_i),   J_i = [(R m_i) x N_i, N_i],   min sum_i w_i (e_i - J_i d)^2

gives the step d = (attitude, position): R <- Exp([d]x) R, p <- p + dp (Chen and Medioni 1992; error convention of this
package: active, left). Only surface that the scanner can see takes part. w_i = b_i / s_i^2: an error of the range
counts across the surface by the cosine of its incidence, an error of the ray's direction, which moves the return by
range times jitter, by the sine,

    s_i^2 = (noise cos)^2 + (range jitter sin)^2 + (0.3 noise)^2

and Tukey's b takes outliers away, its width shrinking from the start's uncertainty to a few times the noise.

Near the end two things become exact: the matches are where the points' own rays meet the mesh, and the scan's edges,
where its lines leave the target, are matched with the shape's sharp edges: with T_i the edge's tangent,

    N_i = x_i x T_i / |...|,   s_i^2 = step along the line^2 / 12 + (0.7 noise)^2

in the same e_i and J_i. They determine what planes leave free, such as a turn about the line of sight. At the very end
each of them is what it is, an interval between two rays (`estimators.lidar.silhouette`).

Directions that the matched surface does not determine (a single plane, a sphere) are left as they are, told apart by
the eigenvalues of the normal matrix, and get an infinite variance. Covariance: (J^T W J)^-1, times the mean of
w e^2 where that is above one.
"""

from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.kernel import kernel
from estimators.lidar.ray_cast import cast
from estimators.lidar.scan import Edges, Returns
from estimators.lidar.shape import Shape
from estimators.lidar.silhouette import matched, propagated
from estimators.lidar.symmetry import FREE_RAD, symmetry

FEWEST_POINTS = 12
"""Matched points without which there is no answer."""
FLOOR = 0.3
"""Part of the noise that no incidence takes away, of the known shape itself."""
FEW, FEW_SHARE, MANY = 3.0, 0.01, 0.02
"""Points that must tell of a direction while they are matched with the closest ones: at least, and of all. Only looked
at where the weakest direction has less than the last part of the strongest.
"""
GRAZING = 0.12
"""Cosine of the incidence (83 degrees) beyond which a return is not used."""
NEIGHBOURS = 4
"""Surface points that a return is compared with."""
WEAK_ATTITUDE_RAD, WEAK_POSITION = 0.05, 0.05
"""A direction whose sigma is larger (position: against the shape's radius) is not determined."""
EDGE_GATE = (0.025, 4.0)
"""Largest distance of a scanned edge from the known one: at first, against the radius; at last, in sigmas."""
JUMP = 0.1
"""A range that jumps by this, against the radius, is an edge."""
EDGE_FLOOR = 0.7
"""Part of the noise better than which an edge is not known, however fine the steps."""
WIDE = 1.4
"""Tukey's width at the very end, against the least before."""
INTERVAL_GATE = 1.7
"""Largest distance of a scanned edge from the known one at the very end, against the widest step."""
BLURRED = (3.0, 2.0, 1.0, 1.0, 1.0)
"""Blur of the edges in the last steps: that none is given up before the pose is there."""
CLEAR = 0.4
"""Sine of the least angle between an edge and the line of sight, and between it and the scan's line."""
PINNED_RAD = 0.01
"""How firmly a turn that has no meaning is kept where it is."""
POLISH_RAD = 3e-3
"""Steps below this: from now on, matched along the rays."""
STEP_RAD, STEP_M = 1e-5, 1e-5
"""Steps below these end the iteration (e_final and eps_final of the paper in one)."""
ITERATIONS = 40
ROUGH_ITERATIONS, ROUGH = 20, 1e-3
"""Of a rough registration: iterations at most, and steps, in radians and against the radius, that end it."""
PATIENCE, SHORTER = 20, 0.7
"""Iterations with whole steps; every further step is shorter by this factor."""


class Registration(NamedTuple):
    """Pose of the target in the scanner's frame: rotation (3, 3), position (3,) [m].

    covariance: (6, 6), ordered (attitude, position), infinite on the diagonal where `degenerate`. converged: the steps
    became small. iterations: how many. residual_m: RMS of the matched points. matched: share of the points matched.
    degenerate: a direction is not determined.
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    converged: bool
    iterations: int
    residual_m: float
    matched: float
    degenerate: bool


class Posed(Protocol):
    """Whatever has a position (3,) [m] and a covariance (6, 6), ordered (attitude, position)."""

    @property
    def position(self) -> Floats:
        """Position of the origin."""
        ...

    @property
    def covariance(self) -> Floats:
        """Covariance of attitude and position."""
        ...


def shifted(pose: Posed, position: Floats) -> Floats:
    """Return the covariance (6, 6) of a pose with its origin at `position` (3,) instead: an error of the attitude moves
    it along.
    """
    moved = np.eye(6)
    moved[3:, :3] = -rot.skew(position - pose.position)
    with np.errstate(invalid="ignore"):
        out: Floats = moved @ pose.covariance @ moved.T
    return out


class _Visible:
    """Surface and edges of the shape that are seen from viewpoint (3,) [m]: their indices, and trees of them."""

    def __init__(self, shape: Shape, viewpoint: Floats) -> None:
        self._shape, self.viewpoint = shape, viewpoint
        self.surface: Ints = np.flatnonzero(shape.visible_from(viewpoint))

    @cached_property
    def tree(self) -> cKDTree:
        """The surface's."""
        return cKDTree(self._shape.point[self.surface])

    @cached_property
    def edge(self) -> Ints:
        """Asked for by the last steps alone."""
        return np.flatnonzero(self._shape.edges_from(self.viewpoint))

    @cached_property
    def edge_tree(self) -> cKDTree:
        """The edges'."""
        return cKDTree(self._shape.edge.point[self.edge])


def failed(rotation: Floats, position: Floats) -> Registration:
    """Return no answer, with the pose that it started from."""
    return Registration(rotation, position, np.full((6, 6), np.nan), False, 0, np.nan, 0.0, True)


def register(
    point: Floats,
    shape: Shape,
    rotation: Floats,
    position: Floats,
    noise_m: float,
    jitter_rad: float = 0.0,
    *,
    edges: Edges | None = None,
    reach_m: float = 0.3,
    rough: bool = False,
) -> Registration:
    """Refine the target's pose from a start near it.

    Args:
        point: (n, 3) [m] in s.
        shape: of the target.
        rotation: (3, 3), start.
        position: (3,) [m], start.
        noise_m: 1 sigma of a range.
        jitter_rad: 1 sigma of a ray's direction, per axis.
        edges: where the scan's lines leave the target.
        reach_m: how far points may lie from the surface at the start.
        rough: end at steps of a thousandth of the radius, each edge a normal error.

    Raises:
        ValueError: an argument is not finite.
    """
    if not (np.isfinite(point).all() and np.isfinite(rotation).all() and np.isfinite(position).all()):
        raise ValueError("point, rotation, position: not finite")
    if len(point) < FEWEST_POINTS:
        return failed(rotation, position)
    return _iterated(Returns(point, noise_m, jitter_rad), shape, rotation, position, edges, reach_m, rough)


def normal_equations(
    returns: Returns, shape: Shape, rotation: Floats, position: Floats
) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and the right side (6,) of the ranges alone at a pose; zeros where too few of
    them meet the surface.

    Args:
        returns: of the scan.
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    width = WIDE * 3.5 * float(np.hypot(returns.noise_m, 0.15 * shape.spacing_m))
    matched = _along_rays(returns.point, shape, rotation, position)
    error, jacobian, weight, _ = _linearised(returns, matched, rotation, position, width)
    if np.count_nonzero(weight) < FEWEST_POINTS:
        return np.zeros((6, 6)), np.zeros(6)
    return jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * error)


def _iterated(
    returns: Returns,
    shape: Shape,
    rotation: Floats,
    position: Floats,
    edges: Edges | None,
    reach_m: float,
    rough: bool,
) -> Registration:
    """Match and step until the steps are small, as `register`."""
    point, noise_m = returns.point, returns.noise_m
    least = 3.5 * float(np.hypot(noise_m, 0.15 * shape.spacing_m))
    width, gate = max(reach_m, least), EDGE_GATE[0] * shape.radius_m
    converged, polishing, number, seen = False, False, 0, None
    iterations, step_rad, step_m = _limits(shape, rough)
    while number < iterations:
        number += 1
        viewpoint = -rotation.T @ position
        # What is visible changes with the pose: looked at again when the view has turned by more than 3 degrees.
        if seen is None or np.linalg.norm(viewpoint - seen.viewpoint) > 0.05 * np.linalg.norm(viewpoint):
            seen = _Visible(shape, viewpoint)
            if len(seen.surface) < FEWEST_POINTS:
                return failed(rotation, position)
        if polishing:
            matched = _along_rays(point, shape, rotation, position)
        else:
            matched = _closest(point, shape, seen, rotation, position, width)
        error, jacobian, weight, bisquare = _linearised(returns, matched, rotation, position, width)
        normal, right = jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * error)
        if polishing and edges is not None and len(edges.point):
            gate = max(0.75 * gate, EDGE_GATE[1] * float(np.max(edges.width_m)) / np.sqrt(12))
            own_normal, own_right = _of_edges(edges, noise_m, shape, seen, rotation, position, gate)
            normal, right = normal + own_normal, right + own_right
        used = weight > 0
        if np.count_nonzero(used) < FEWEST_POINTS:
            return failed(rotation, position)
        told = normal if polishing else _of_many(normal, jacobian, weight, shape.radius_m)
        step, _ = _solve(told + _pinned(shape, rotation), right, 1.0, shape.radius_m)
        # Two sets of matches may lead to each other: steps that become shorter end between them.
        step = step * SHORTER ** max(0, number - PATIENCE)
        rotation, position = rot.exp(step[:3]) @ rotation, position + step[3:]
        converged = polishing and bool(np.linalg.norm(step[:3]) < step_rad and np.linalg.norm(step[3:]) < step_m)
        if converged:
            break
        polishing = polishing or bool(width <= least and np.linalg.norm(step[:3]) < POLISH_RAD)
        # The weights follow what is left of the error, but never widen again.
        rms = 1.5 * float(np.median(np.abs(error[used])))
        width = max(least, min(0.7 * width, 4.0 * rms + 0.3 * width))
    if polishing and not rough and seen is not None and edges is not None and len(edges.point):
        last = _finished(returns, shape, seen, edges, rotation, position, WIDE * width)
        if last is None:
            return failed(rotation, position)
        normal, error, weight, bisquare, rotation, position = last
        used = weight > 0
    residual = float(np.sqrt(np.average(error**2, weights=bisquare)))
    sigma = np.sqrt(max(1.0, float(np.sum(weight * error**2) / np.sum(bisquare))))
    covariance = _covariance(normal, sigma, shape, rotation)
    degenerate = not bool(np.isfinite(covariance).all())
    return Registration(rotation, position, covariance, converged, number, residual, float(np.mean(used)), degenerate)


def _covariance(normal: Floats, sigma: float, shape: Shape, rotation: Floats) -> Floats:
    """Return the covariance (6, 6) of a pose for errors of `sigma`, with the turn that has no meaning."""
    _, covariance = _solve(normal + sigma**2 * _pinned(shape, rotation), np.zeros(6), sigma, shape.radius_m)
    free = symmetry(shape).free(rotation)
    out: Floats = covariance + FREE_RAD**2 * free.T @ free
    return out


def _limits(shape: Shape, rough: bool) -> tuple[int, float, float]:
    """Return the number of iterations at most, and the steps [rad], [m] that end them."""
    return (ROUGH_ITERATIONS, ROUGH, ROUGH * shape.radius_m) if rough else (ITERATIONS, STEP_RAD, STEP_M)


def _finished(
    returns: Returns,
    shape: Shape,
    seen: _Visible,
    edges: Edges,
    rotation: Floats,
    position: Floats,
    width: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats] | None:
    """Return the normal matrix, errors, weights and their Tukey part, and the pose, every edge an interval; None where
    too few points are matched.
    """
    gate = INTERVAL_GATE * float(np.max(edges.width_m))
    for blurred in BLURRED:
        met = _along_rays(returns.point, shape, rotation, position)
        error, jacobian, weight, bisquare = _linearised(returns, met, rotation, position, width)
        if np.count_nonzero(weight) < FEWEST_POINTS:
            return None
        normal, right = jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * error)
        distance, index = seen.edge_tree.query((edges.point - position) @ rotation, distance_upper_bound=gate)
        intervals = matched(edges, shape, seen.edge, index, np.isfinite(distance), rotation, position)
        intervals = intervals._replace(blur=blurred * intervals.blur)
        # What neither points nor edges determine is known to be within a radian, and a radius.
        weak = np.diag([1.0] * 3 + [shape.radius_m**-2] * 3)
        normal, right = propagated(normal + _pinned(shape, rotation) + weak, right, intervals)
        step, _ = _solve(normal, right, 1.0, shape.radius_m)
        rotation, position = rot.exp(step[:3]) @ rotation, position + step[3:]
    return normal, error, weight, bisquare, rotation, position


def _pinned(shape: Shape, rotation: Floats) -> Floats:
    """Return the normal matrix (6, 6) that keeps a turn without meaning, of a body of revolution, in its place.

    Any of these poses is as good as the others; their variance is added afterwards.
    """
    axis = symmetry(shape).axes @ rotation.T
    out = np.zeros((6, 6))
    out[:3, :3] = axis.T @ axis / PINNED_RAD**2
    return out


def _closest(
    point: Floats, shape: Shape, seen: _Visible, rotation: Floats, position: Floats, width: float
) -> tuple[Floats, Floats, Bools]:
    """Return the closest surface points (n, 3), their normals (n, 3), both in t, and which are within reach (n,)."""
    own = (point - position) @ rotation
    distance, index = seen.tree.query(own, k=NEIGHBOURS, distance_upper_bound=width + 2 * shape.spacing_m)
    near = seen.surface[np.where(np.isfinite(distance), index, 0)]
    offset = own[:, None] - shape.point[near]
    along = np.einsum("nkj,nkj->nk", shape.normal[near], offset)
    # A surface point stands for a disc around it: beside an edge, the nearest one may be that of the wrong face.
    lateral = np.sqrt(np.maximum(distance**2 - along**2, 0.0)) - shape.spacing_m
    which = np.argmin(along**2 + np.maximum(lateral, 0.0) ** 2, axis=1)
    row = np.arange(len(own))
    chosen = near[row, which]
    return shape.point[chosen], shape.normal[chosen], np.isfinite(distance[row, which])


def _along_rays(point: Floats, shape: Shape, rotation: Floats, position: Floats) -> tuple[Floats, Floats, Bools]:
    """Return where the points' own rays meet the exact surface (n, 3), the normals there (n, 3), in t, and which do
    (n,).
    """
    direction = point @ rotation
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    viewpoint = -rotation.T @ position
    hits = cast(shape.mesh, viewpoint, direction)
    # On a rim, a ray of half a step's difference meets another face: what such a match says is chance.
    found = np.isfinite(hits.distance) & shape.broad[hits.triangle]
    m = viewpoint + np.where(np.isfinite(hits.distance), hits.distance, 0.0)[:, None] * direction
    return m, shape.mesh.normal[hits.triangle], found


def _linearised(
    returns: Returns, met: tuple[Floats, Floats, Bools], rotation: Floats, position: Floats, width: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return errors (n,), Jacobians (n, 6), weights (n,) and their Tukey part (n,) of points matched with `met`."""
    count = len(returns.point)
    error, weight, bisquare = (np.empty(count) for _ in range(3))
    jacobian = np.empty((count, 6))
    _linearise_into(*returns, *met, rotation, position, width, error, jacobian, weight, bisquare)
    return error, jacobian, weight, bisquare


@kernel
def _linearise_into(
    point: Floats,
    noise_m: float,
    jitter_rad: float,
    m: Floats,
    n: Floats,
    found: Bools,
    rotation: Floats,
    position: Floats,
    width: float,
    error: Floats,
    jacobian: Floats,
    weight: Floats,
    bisquare: Floats,
) -> None:
    turned, across = np.empty(3), np.empty(3)
    for i in range(len(point)):
        error[i], along, square = 0.0, 0.0, 0.0
        for k in range(3):
            own = 0.0
            turned[k], across[k] = 0.0, 0.0
            for c in range(3):
                own += (point[i, c] - position[c]) * rotation[c, k]
                turned[k] += rotation[k, c] * m[i, c]
                across[k] += rotation[k, c] * n[i, c]
            error[i] += n[i, k] * (own - m[i, k])
            along += across[k] * point[i, k]
            square += point[i, k] ** 2
        ratio, cosine = error[i] / width, along / np.sqrt(square)
        # A face seen at a grazing angle is told from its neighbour by a hair: what it would say weighs too much.
        counts = found[i] and abs(ratio) < 1 and abs(cosine) >= GRAZING
        bisquare[i] = (1 - ratio**2) ** 2 if counts else 0.0
        sideways = square * jitter_rad**2 * max(0.0, 1 - cosine**2)
        weight[i] = bisquare[i] / (noise_m**2 * (cosine**2 + FLOOR**2) + sideways)
        jacobian[i, 0] = turned[1] * across[2] - turned[2] * across[1]
        jacobian[i, 1] = turned[2] * across[0] - turned[0] * across[2]
        jacobian[i, 2] = turned[0] * across[1] - turned[1] * across[0]
        jacobian[i, 3:] = across


def _of_edges(
    edges: Edges,
    noise_m: float,
    shape: Shape,
    seen: _Visible,
    rotation: Floats,
    position: Floats,
    gate: float,
) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and the right side (6,) of the scan's edges."""
    sigma = np.hypot(edges.width_m / np.sqrt(12), EDGE_FLOOR * noise_m)
    own = (edges.point - position) @ rotation
    distance, index = seen.edge_tree.query(own, distance_upper_bound=gate)
    found = np.isfinite(distance)
    chosen = seen.edge[index[found]]
    x, m = edges.point[found], shape.edge.point[chosen]
    # An edge is seen across itself, and by a line that crosses it: one that runs along it does not end there.
    across = rot.cross(x, shape.edge.tangent[chosen] @ rotation.T)
    size = np.linalg.norm(across, axis=1) / np.linalg.norm(x, axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    turned = m @ rotation.T
    error = np.sum(across * (x - turned - position), axis=1)
    crossing = np.abs(np.sum(across * edges.along[found], axis=1))
    clear = (size > CLEAR) & (crossing > CLEAR) & (np.abs(error) < gate)
    weight = np.where(clear, (1 - (error / gate) ** 2) ** 2, 0.0) / sigma[found] ** 2
    jacobian = np.concatenate([rot.cross(turned, across), across], axis=1)
    return jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * error)


def _of_many(normal: Floats, jacobian: Floats, weight: Floats, radius_m: float) -> Floats:
    """Return the normal matrix (6, 6) without the directions of which a few points tell nearly all.

    Some of the closest points are matched with the wrong face. In a direction that all others leave free, nothing
    contradicts these, and they would lead the whole pose astray.
    """
    unit = np.array([WEAK_ATTITUDE_RAD] * 3 + [WEAK_POSITION * radius_m] * 3)
    value, vector = np.linalg.eigh(normal * unit[:, None] * unit)
    if value[0] > MANY * value[-1]:
        return normal
    told = weight[:, None] * (jacobian @ (unit[:, None] * vector)) ** 2
    count = told.sum(axis=0) ** 2 / np.maximum((told**2).sum(axis=0), 1e-300)
    few = count < max(FEW, FEW_SHARE * np.count_nonzero(weight))
    if not few.any():
        return normal
    kept = vector * np.where(few, 0.0, value)
    out: Floats = (kept @ vector.T) / unit[:, None] / unit
    return out


def _solve(normal: Floats, right: Floats, sigma: float, radius_m: float) -> tuple[Floats, Floats]:
    """Return the step (6,) within the determined directions, and the covariance (6, 6) for errors of `sigma`."""
    # In units in which both parts of a direction weigh the same.
    unit = np.array([WEAK_ATTITUDE_RAD] * 3 + [WEAK_POSITION * radius_m] * 3)
    value, vector = np.linalg.eigh(normal * unit[:, None] * unit)
    strong = value > sigma**2
    inverse = np.where(strong, 1 / np.where(strong, value, 1.0), 0.0)
    step = unit * (vector @ (inverse * (vector.T @ (unit * right))))
    if not strong.all():
        weak = (np.abs(vector[:, ~strong]) > 0.1).any(axis=1)
        covariance = np.zeros((6, 6))
        covariance[np.diag_indices(6)] = np.where(weak, np.inf, unit**2)
        return step, covariance
    out: Floats = sigma**2 * (unit[:, None] * ((vector * inverse) @ vector.T) * unit)
    return step, out
