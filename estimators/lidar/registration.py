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

import math
from copy import copy
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.eigen import eigen_into
from estimators.kernel import kernel
from estimators.lidar.matching import Equations, along_rays, closest, linearised, unknown
from estimators.lidar.nearest import PointTree, nearest, thinned
from estimators.lidar.scan import Edges, Returns
from estimators.lidar.shape import Shape
from estimators.lidar.silhouette import matched, propagated
from estimators.lidar.symmetry import FREE_RAD, symmetry
from estimators.linear import cholesky_into, solve_spd
from estimators.rotation import exp_into, multiply_into

FEWEST_POINTS = 12
"""Matched points without which there is no answer."""
FEW, FEW_SHARE, MANY = 3.0, 0.01, 0.02
"""Points that must tell of a direction while they are matched with the closest ones: at least, and of all. Only looked
at where the weakest direction has less than the last part of the strongest.
"""
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
    """The part of a shape that is seen from viewpoint (3,) [m]. surface, edge: trees of its points."""

    def __init__(self, shape: Shape, viewpoint: Floats) -> None:
        self._shape, self.viewpoint = shape, viewpoint
        self.surface = thinned(shape.nearest, shape.visible_from(viewpoint))

    @cached_property
    def edge(self) -> PointTree:
        """Asked for by the last steps alone."""
        return thinned(self._shape.nearest_edge, self._shape.edges_from(self.viewpoint))


@lru_cache(maxsize=64)
def _visible(shape: Shape, x: float, y: float, z: float) -> _Visible:
    """Return what is seen from a viewpoint [m]; one start is often registered twice, with edges and without."""
    return _Visible(shape, np.array([x, y, z]))


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
    return Approach(Returns(point, noise_m, jitter_rad), shape, rotation, position, reach_m).registered(
        edges, rough=rough
    )


def normal_equations(returns: Returns, shape: Shape, rotation: Floats, position: Floats) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and the right side (6,) of the ranges alone at a pose; zeros where too few of
    them meet the surface.

    Args:
        returns: of the scan.
        shape: of the target.
        rotation: (3, 3).
        position: (3,) [m].
    """
    width = WIDE * 3.5 * float(np.hypot(returns.noise_m, 0.15 * shape.spacing_m))
    told = linearised(returns, along_rays(returns.point, shape, rotation, position), rotation, position, width)
    if told.used < FEWEST_POINTS:
        return np.zeros((6, 6)), np.zeros(6)
    return told.normal, told.right


class Approach:
    """A registration while points are matched with the closest surface, until its steps are small.

    Edges play no part in it: what follows, with edges or without, roughly or to the end, begins where it ends.
    """

    def __init__(self, returns: Returns, shape: Shape, rotation: Floats, position: Floats, reach_m: float) -> None:
        """Step from a start (3, 3), (3,) [m], from which points may lie `reach_m` away.

        Raises ValueError where an argument is not finite.
        """
        if not (np.isfinite(returns.point).all() and np.isfinite(rotation).all() and np.isfinite(position).all()):
            raise ValueError("point, rotation, position: not finite")
        self._returns, self._shape, self._rotation, self._position = returns, shape, rotation, position
        self._least = 3.5 * float(np.hypot(returns.noise_m, 0.15 * shape.spacing_m))
        self._width, self._gate = max(reach_m, self._least), EDGE_GATE[0] * shape.radius_m
        self._number, self._polishing = 0, False
        self._seen: _Visible | None = None
        self._lost = len(returns.point) < FEWEST_POINTS
        while not self._lost and not self._polishing and self._number < ROUGH_ITERATIONS:
            self._step(None)

    @property
    def pose(self) -> tuple[Floats, Floats]:
        """The rotation (3, 3) and position (3,) [m] at which it ends."""
        return self._rotation, self._position

    def registered(self, edges: Edges | None = None, *, rough: bool = False) -> Registration:
        """Return the registration, as `register`, and stay as it is.

        Args:
            edges: where the scan's lines leave the target.
            rough: end at steps of a thousandth of the radius, each edge a normal error.
        """
        return copy(self)._registered(edges if edges is not None and len(edges.point) else None, rough)

    def _registered(self, edges: Edges | None, rough: bool) -> Registration:
        shape, converged = self._shape, False
        finish = edges is not None and not rough
        iterations, step_rad, step_m = _limits(shape, rough or finish)
        while not self._lost and not converged and self._number < iterations:
            polishing = self._polishing
            turned, moved = self._step(edges)
            converged = polishing and turned < step_rad and moved < step_m
        if edges is not None and finish and self._polishing and not self._lost:
            self._finish(edges)
        if self._lost:
            return failed(self._rotation, self._position)
        told, rotation = self._told, self._rotation
        certain = float(np.sum(told.bisquare))
        residual = float(np.sqrt(told.bisquare @ told.error**2 / certain))
        sigma = np.sqrt(max(1.0, float(told.weight @ told.error**2 / certain)))
        covariance = _covariance(self._normal, sigma, shape, rotation)
        degenerate, share = not bool(np.isfinite(covariance).all()), told.used / len(self._returns.point)
        return Registration(rotation, self._position, covariance, converged, self._number, residual, share, degenerate)

    def _step(self, edges: Edges | None) -> tuple[float, float]:
        """Match and step; return by how much [rad], [m]. It is lost where too few points are matched."""
        returns, shape, rotation, position = self._returns, self._shape, self._rotation, self._position
        self._number += 1
        viewpoint = -rotation.T @ position
        # What is visible changes with the pose: looked at again when the view has turned by more than 3 degrees.
        if self._seen is None or _length(viewpoint - self._seen.viewpoint) > 0.05 * _length(viewpoint):
            self._seen, self._nearby = _visible(shape, *viewpoint.tolist()), unknown(len(returns.point))
        seen = self._seen
        self._lost = seen.surface.size < FEWEST_POINTS
        if self._lost:
            return np.inf, np.inf
        if self._polishing:
            met = along_rays(returns.point, shape, rotation, position)
        else:
            met = closest(returns.point, shape, seen.surface, self._nearby, rotation, position, self._width)
        told = linearised(returns, met, rotation, position, self._width)
        self._told, self._normal, right = told, told.normal, told.right
        if self._polishing and edges is not None:
            self._gate = max(0.75 * self._gate, EDGE_GATE[1] * float(np.max(edges.width_m)) / np.sqrt(12))
            own = _of_edges(edges, returns.noise_m, shape, seen.edge, rotation, position, self._gate)
            self._normal, right = told.normal + own[0], told.right + own[1]
        self._lost = told.used < FEWEST_POINTS
        if self._lost:
            return np.inf, np.inf
        step = _solved(self._normal, right, told, shape, rotation, by_many=not self._polishing)
        # Two sets of matches may lead to each other: steps that become shorter end between them.
        step = step * SHORTER ** max(0, self._number - PATIENCE)
        self._rotation, self._position = _turned(rotation, step), position + step[3:]
        turned, moved = _length(step[:3]), _length(step[3:])
        self._polishing = self._polishing or (self._width <= self._least and turned < POLISH_RAD)
        # The weights follow what is left of the error, but never widen again.
        rms = 1.5 * _median(np.abs(told.error[told.weight > 0]))
        self._width = max(self._least, min(0.7 * self._width, 4.0 * rms + 0.3 * self._width))
        return turned, moved

    def _finish(self, edges: Edges) -> None:
        """Step with every edge an interval."""
        returns, shape, seen = self._returns, self._shape, self._seen
        assert seen is not None
        width, gate = WIDE * self._width, INTERVAL_GATE * float(np.max(edges.width_m))
        # What neither points nor edges determine is known to be within a radian, and a radius.
        weak = np.diag([1.0] * 3 + [shape.radius_m**-2] * 3)
        for blurred in BLURRED:
            rotation, position = self._rotation, self._position
            told = linearised(returns, along_rays(returns.point, shape, rotation, position), rotation, position, width)
            self._lost = told.used < FEWEST_POINTS
            if self._lost:
                return
            intervals = matched(edges, shape, seen.edge, gate, rotation, position)
            intervals = intervals._replace(blur=blurred * intervals.blur)
            known = told.normal + _pinned(shape, rotation) + weak
            self._told, (self._normal, right) = told, propagated(known, told.right, intervals)
            step = _solved(self._normal, right, told, shape, None, by_many=False)
            self._rotation, self._position = _turned(rotation, step), position + step[3:]


def _length(vector: Floats) -> float:
    return math.sqrt(vector @ vector)


def _turned(rotation: Floats, step: Floats) -> Floats:
    """Return Exp([d]x) R of a step (6,)."""
    out = np.empty((3, 3))
    _turned_into(rotation, step, out)
    return out


@kernel
def _turned_into(rotation: Floats, step: Floats, out: Floats) -> None:
    turn = np.empty((3, 3))
    exp_into(step, turn)
    multiply_into(turn, rotation, out)


def _median(values: Floats) -> float:
    """Return the median of values (n,), as np.median does in several times the time."""
    half = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, half)[half])
    ranked = np.partition(values, (half - 1, half))
    return float((ranked[half - 1] + ranked[half]) / 2)


def _covariance(normal: Floats, sigma: float, shape: Shape, rotation: Floats) -> Floats:
    """Return the covariance (6, 6) of a pose for errors of `sigma`, with the turn that has no meaning."""
    unit = _unit(shape)
    value, vector = np.linalg.eigh((normal + sigma**2 * _pinned(shape, rotation)) * unit[:, None] * unit)
    strong = value > sigma**2
    if strong.all():
        out: Floats = sigma**2 * (unit[:, None] * ((vector / value) @ vector.T) * unit)
    else:
        weak = (np.abs(vector[:, ~strong]) > 0.1).any(axis=1)
        out = np.diag(np.where(weak, np.inf, unit**2))
    free = symmetry(shape).free(rotation)
    out += FREE_RAD**2 * free.T @ free
    return out


def _limits(shape: Shape, rough: bool) -> tuple[int, float, float]:
    """Return the number of iterations at most, and the steps [rad], [m] that end them."""
    return (ROUGH_ITERATIONS, ROUGH, ROUGH * shape.radius_m) if rough else (ITERATIONS, STEP_RAD, STEP_M)


def _pinned(shape: Shape, rotation: Floats) -> Floats:
    """Return the normal matrix (6, 6) that keeps a turn without meaning, of a body of revolution, in its place.

    Any of these poses is as good as the others; their variance is added afterwards.
    """
    out, axes = np.zeros((6, 6)), symmetry(shape).axes
    if not len(axes):
        return out
    axis = axes @ rotation.T
    out[:3, :3] = axis.T @ axis / PINNED_RAD**2
    return out


def _of_edges(
    edges: Edges, noise_m: float, shape: Shape, seen: PointTree, rotation: Floats, position: Floats, gate: float
) -> tuple[Floats, Floats]:
    """Return the normal matrix (6, 6) and the right side (6,) of the scan's edges."""
    normal, right = np.zeros((6, 6)), np.zeros(6)
    known, own = shape.edge, (edges.point, edges.along, edges.width_m)
    chosen = nearest(seen, edges.point, rotation, position, gate)
    _edges_into(*own, noise_m, known.point, known.tangent, chosen, rotation, position, gate, normal, right)
    return normal, right


@kernel
def _edges_into(
    point: Floats,
    along: Floats,
    width: Floats,
    noise_m: float,
    known: Floats,
    tangent: Floats,
    chosen: Ints,
    rotation: Floats,
    position: Floats,
    gate: float,
    normal: Floats,
    right: Floats,
) -> None:
    m, t, n, j = np.empty(3), np.empty(3), np.empty(3), np.empty(6)
    for i in range(len(point)):
        if chosen[i] < 0:
            continue
        square = 0.0
        for k in range(3):
            m[k], t[k] = 0.0, 0.0
            for c in range(3):
                m[k] += rotation[k, c] * known[chosen[i], c]
                t[k] += rotation[k, c] * tangent[chosen[i], c]
            square += point[i, k] ** 2
        # An edge is seen across itself, and by a line that crosses it: one that runs along it does not end there.
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            n[k] = point[i, a] * t[b] - point[i, b] * t[a]
        size = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
        error, crossing = 0.0, 0.0
        for k in range(3):
            n[k] /= max(size, 1e-12)
            error += n[k] * (point[i, k] - m[k] - position[k])
            crossing += n[k] * along[i, k]
        if not (size / np.sqrt(square) > CLEAR and abs(crossing) > CLEAR and abs(error) < gate):
            continue
        variance = width[i] ** 2 / 12 + (EDGE_FLOOR * noise_m) ** 2
        weight = (1 - (error / gate) ** 2) ** 2 / variance
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            j[k], j[3 + k] = m[a] * n[b] - m[b] * n[a], n[k]
        for r in range(6):
            right[r] += weight * j[r] * error
            for c in range(6):
                normal[r, c] += weight * j[r] * j[c]


def _unit(shape: Shape) -> Floats:
    """Return units (6,) in which attitude and position of a direction weigh the same."""
    return np.array([WEAK_ATTITUDE_RAD] * 3 + [WEAK_POSITION * shape.radius_m] * 3)


def _solved(
    normal: Floats, right: Floats, told: Equations, shape: Shape, rotation: Floats | None, *, by_many: bool
) -> Floats:
    """Return the step (6,) within the determined directions.

    Args:
        normal: (6, 6).
        right: (6,).
        told: the points' part of them.
        shape: of the target.
        rotation: (3, 3), at which a turn without meaning is kept in its place; None: it is.
        by_many: directions of which a few points tell nearly all are left as they are.
    """
    step = np.empty(6)
    pinned = _pinned(shape, rotation) if rotation is not None else np.zeros((6, 6))
    fewest = max(FEW, FEW_SHARE * told.used) if by_many else 0.0
    _solve_into(normal, right, pinned, told.weight, told.jacobian, _unit(shape), fewest, step)
    return step


@kernel
def _solve_into(
    normal: Floats,
    right: Floats,
    pinned: Floats,
    weight: Floats,
    jacobian: Floats,
    unit: Floats,
    fewest: float,
    step: Floats,
) -> None:
    scaled, vector, firm = np.empty((6, 6)), np.empty((6, 6)), 0.0
    for r in range(6):
        for c in range(6):
            firm = max(firm, abs(pinned[r, c]))
            scaled[r, c] = normal[r, c] * unit[r] * unit[c]
    if _solve_firm(scaled, right, pinned, unit, MANY if fewest > 0 else 0.0, step):
        return
    eigen_into(scaled, vector)
    if fewest > 0:
        _leave_out_few(scaled, vector, weight, jacobian, unit, fewest)
    if firm > 0:
        value = np.diag(scaled).copy()
        for r in range(6):
            for c in range(6):
                scaled[r, c] = pinned[r, c] * unit[r] * unit[c]
                for k in range(6):
                    scaled[r, c] += vector[r, k] * value[k] * vector[c, k]
        eigen_into(scaled, vector)
    step[:] = 0.0
    for k in range(6):
        if not scaled[k, k] > 1.0:
            continue
        along = 0.0
        for r in range(6):
            along += vector[r, k] * unit[r] * right[r]
        for r in range(6):
            step[r] += unit[r] * vector[r, k] * along / scaled[k, k]


@kernel
def _solve_firm(scaled: Floats, right: Floats, pinned: Floats, unit: Floats, many: float, step: Floats) -> bool:
    """Write the step (6,) if every direction is determined, and none weaker than `many` of the strongest.

    The eigenvalues are all above a number where the matrix less that number is positive definite; none is above the
    root of the elements' squares. Only where that says too little are the eigenvalues themselves asked for.
    """
    less, lower, squares = np.empty((6, 6)), np.empty((6, 6)), 0.0
    for r in range(6):
        for c in range(6):
            squares += scaled[r, c] ** 2
    for r in range(6):
        for c in range(6):
            less[r, c] = scaled[r, c]
        less[r, r] -= max(1.0, many * np.sqrt(squares))
    if not cholesky_into(less, lower):
        return False
    for r in range(6):
        step[r] = unit[r] * right[r]
        for c in range(6):
            less[r, c] = scaled[r, c] + pinned[r, c] * unit[r] * unit[c]
    solve_spd(less, lower, step)
    for r in range(6):
        step[r] *= unit[r]
    return True


@kernel
def _leave_out_few(
    scaled: Floats, vector: Floats, weight: Floats, jacobian: Floats, unit: Floats, fewest: float
) -> None:
    """Set the eigenvalues of those directions to zero of which a few points tell nearly all.

    Some of the closest points are matched with the wrong face. In a direction that all others leave free, nothing
    contradicts these, and they would lead the whole pose astray.
    """
    least, most = np.inf, -np.inf
    for k in range(6):
        least, most = min(least, scaled[k, k]), max(most, scaled[k, k])
    if least > MANY * most:
        return
    for k in range(6):
        total, squares = 0.0, 0.0
        for i in range(len(weight)):
            along = 0.0
            for r in range(6):
                along += jacobian[i, r] * unit[r] * vector[r, k]
            each = weight[i] * along**2
            total += each
            squares += each**2
        if total**2 / max(squares, 1e-300) < fewest:
            scaled[k, k] = 0.0
