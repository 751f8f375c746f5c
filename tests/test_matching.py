"""Matches of a scan's points with a shape, the trees they are looked up in, and what their errors weigh."""

import numpy as np
import pytest
from lidar_target import DISTANCE, crooked, scan_of
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree

from estimators.lidar.matching import Equations, Matches, closest, linearised, unknown
from estimators.lidar.nearest import nearest, nearest_into, point_tree, thinned
from estimators.lidar.pose_search import CELLS, _ray_image
from estimators.lidar.ray_cast import STACK, cast, triangles
from estimators.lidar.registration import Approach, _solved, _unit, register
from estimators.lidar.scan import Returns, clusters, from_points
from estimators.lidar.shape import Shape
from estimators.rotation import exp

NOISE_M = 0.01


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.mark.parametrize("flat", [False, True])
def test_the_nearest_of_those_that_count(rng, flat):
    point = rng.normal(size=(500, 3)) * [1, 1, 0 if flat else 1]
    point[100:120] = point[100]
    counts = rng.random(500) < 0.4
    tree, kept = thinned(point_tree(point), counts), np.flatnonzero(counts)
    stack, gaps = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    for place in 1.5 * rng.normal(size=(200, 3)):
        squared, index = np.empty(4), np.empty(4, dtype=np.int64)
        x, y, z = place
        found = nearest_into(tree, x, y, z, 0.7**2, squared, index, stack, gaps)
        right = cKDTree(point[kept]).query(place, k=4, distance_upper_bound=0.7)[0]
        assert found == np.count_nonzero(np.isfinite(right))
        assert np.sqrt(squared[:found]) == pytest.approx(right[:found])
        number = tree.number.ravel()[index[:found]]
        assert np.linalg.norm(point[number] - place, axis=1) == pytest.approx(right[:found])
        assert counts[number].all()


def test_of_no_points_none_is_the_nearest():
    found = nearest(point_tree(np.zeros((0, 3))), np.zeros((5, 3)), np.eye(3), np.zeros(3), 1e9)
    assert found.tolist() == 5 * [-1]


@pytest.mark.parametrize("spread", [1.0, 1e-9, 0.0])
def test_every_triangle_hangs_in_the_tree_once_and_is_hit_where_a_loop_over_all_says(rng, spread):
    """Triangles on one heap, too, where no slab divides them."""
    corner = spread * rng.normal(size=(400, 1, 3)) + rng.normal(size=(400, 3, 3)) * 0.3
    corner[50:90] = corner[50]
    mesh = triangles(corner.reshape(-1, 3), np.arange(1200).reshape(-1, 3))
    full = np.isfinite(mesh.slab[:, 0])
    assert sorted((-1 - mesh.child[full & (mesh.child < 0)]).tolist()) == list(range(len(mesh.number)))
    assert sorted(mesh.child[full & (mesh.child >= 0)].tolist()) == list(range(1, len(mesh.child)))
    assert sorted(mesh.number[mesh.number >= 0].tolist()) == list(range(400))
    direction = rng.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin, best = np.array([0.2, -0.1, 0.4]), np.full(300, np.inf)
    for a, e1, e2 in zip(mesh.corner, mesh.edge1, mesh.edge2, strict=True):
        h, f = np.cross(direction, e2), np.cross(origin - a, e1)
        u, v, s = (x / (h @ e1) for x in (h @ (origin - a), direction @ f, np.full(300, e2 @ f)))
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0)
        best = np.where(hit & (s < best), s, best)
    assert np.isfinite(best).any()
    assert cast(mesh, origin, direction).distance == pytest.approx(best)


def test_a_point_is_matched_with_the_closest_surface_that_is_seen(rng):
    shape, turn = crooked(), exp(np.array([0.3, -0.5, 0.2]))
    visible = shape.visible_from(-turn.T @ DISTANCE)
    seen, nobody = thinned(shape.nearest, visible), thinned(shape.nearest, np.zeros(len(visible), dtype=np.bool_))
    on = shape.point[visible][::9]
    lifted = on + 0.004 * shape.normal[visible][::9]
    met = closest(lifted @ turn.T + DISTANCE, shape, seen, unknown(len(on)), turn, DISTANCE, 0.1)
    assert met.found.all()
    assert np.abs(np.sum(met.normal * (lifted - met.point), axis=1)) == pytest.approx(0.004, abs=1e-6)
    nothing = closest(lifted @ turn.T + DISTANCE, shape, nobody, unknown(len(on)), turn, DISTANCE, 0.1)
    assert not nothing.found.any()


@pytest.mark.parametrize("step", [1e-4, 1e-2, 0.1])
def test_matches_that_move_are_those_looked_up_anew(rng, step):
    shape = crooked()
    seen = thinned(shape.nearest, shape.visible_from(-DISTANCE))
    point = shape.point[::7] + 0.05 * rng.normal(size=shape.point[::7].shape) + DISTANCE
    nearby, width = unknown(len(point)), 0.3
    for _ in range(12):
        turn, place = exp(step * rng.normal(size=3)), DISTANCE + step * rng.normal(size=3)
        followed = closest(point, shape, seen, nearby, turn, place, width)
        anew = closest(point, shape, seen, unknown(len(point)), turn, place, width)
        assert 0 < np.count_nonzero(anew.found) <= len(point)
        for one, other in zip(followed, anew, strict=True):
            assert (one == other).all()
        width *= 0.9


def test_an_approach_serves_with_edges_and_without(rng):
    shape, turn = crooked(), exp(np.array([0.3, -0.5, 0.2]))
    scan = scan_of(shape, turn, DISTANCE, rng)
    start, edges = (exp(np.array([0.03, 0.02, -0.03])) @ turn, DISTANCE + 0.02), scan.edges(0.1 * shape.radius_m)
    approach = Approach(scan.returns, shape, *start, 0.3)
    for known, rough in ((edges, False), (None, True), (edges, True), (None, False)):
        fit = approach.registered(known, rough=rough)
        anew = register(scan.point, shape, *start, scan.noise_m, scan.jitter_rad, edges=known, rough=rough)
        for one, other in zip(fit, anew, strict=True):
            assert np.array_equal(np.asarray(one), np.asarray(other))


@pytest.mark.parametrize("least", [30.0, 1.5, 0.5, 0.0])
@pytest.mark.parametrize("by_many", [False, True])
def test_a_step_goes_along_determined_directions_alone(rng, least, by_many):
    """With the eigenvectors of NumPy. `least`: the weakest eigenvalue, in units in which 1 is determined."""
    shape, unit = crooked(), _unit(crooked())
    axes = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    value = np.array([least, 40.0, 50.0, 60.0, 70.0, 100.0])
    # Each direction by many points, but for the weakest: by one alone.
    rows = np.repeat(axes.T[1:], 40, axis=0) * np.sqrt(value[1:] / 40).repeat(40)[:, None]
    rows = np.concatenate([rows, np.sqrt(least) * axes.T[:1]]) / unit
    error = rng.normal(size=len(rows))
    weight = np.ones(len(rows))
    told = Equations(error, rows, weight, weight, rows.T @ rows, rows.T @ error, len(rows))
    step = _solved(told.normal, told.right, told, shape, np.eye(3), by_many=by_many)
    firm = value > 1
    # By one point alone, and much weaker than the others, it is no evidence.
    firm[0] &= not by_many or least > 2.0
    along = axes.T @ (unit * told.right)
    assert step / unit == pytest.approx(axes[:, firm] @ (along[firm] / value[firm]))


@pytest.mark.parametrize("nearer", [1.0, 0.3])
def test_each_cell_has_the_ray_that_is_nearest_to_it(rng, nearer):
    scan = scan_of(crooked(), np.eye(3), DISTANCE, rng)
    image = _ray_image(scan, nearer * scan.point.mean(axis=0), crooked())
    middle = (np.arange(CELLS) + 0.5) / CELLS * 2 * image.half - image.half
    look = np.stack([*np.meshgrid(middle, middle, indexing="ij"), np.ones((CELLS, CELLS))], axis=-1)
    look /= np.linalg.norm(look, axis=-1, keepdims=True)
    _, ray = cKDTree(scan.direction).query(look @ image.frame, distance_upper_bound=0.75 * scan.spacing_rad)
    assert (image.ray == np.where(ray < len(scan.direction), ray, -1)).all()
    assert (image.ray >= 0).any()


@pytest.mark.parametrize("incidence_deg", [0.0, 40.0, 75.0])
def test_weights_know_noise_and_jitter_of_a_ray_at_any_incidence(rng, incidence_deg):
    """A ray at a slant plane 100 m away, bent by 0.3 mrad, has another range, and is believed where it was meant."""
    jitter_rad, tilt = 3e-4, np.radians(incidence_deg)
    across = np.array([-np.cos(tilt), np.sin(tilt), 0.0])
    meant = np.tile([1.0, 0.0, 0.0], (20_000, 1))
    bent = meant + jitter_rad * rng.normal(size=meant.shape)
    bent /= np.linalg.norm(bent, axis=1, keepdims=True)
    place = np.array([100.0, 0.0, 0.0])
    depth = (place @ across) / (bent @ across) + NOISE_M * rng.normal(size=len(bent))
    on = Matches(np.zeros_like(meant), np.tile(across, (len(bent), 1)), np.ones(len(bent), dtype=np.bool_))
    told = linearised(Returns(depth[:, None] * meant, NOISE_M, jitter_rad), on, np.eye(3), place, 10.0)
    variance = np.mean(told.error**2)
    assert variance == pytest.approx((NOISE_M * np.cos(tilt)) ** 2 + (0.03 * np.sin(tilt)) ** 2, rel=0.05)
    # The floor, of the known shape, is added to what the rays themselves have.
    assert 1 / told.weight[0] == pytest.approx(variance + (0.3 * NOISE_M) ** 2, rel=0.05)
    assert told.normal == pytest.approx(told.jacobian.T @ (told.weight[:, None] * told.jacobian))
    assert told.right == pytest.approx(told.jacobian.T @ (told.weight * told.error))


def test_objects_are_what_the_graph_of_near_pairs_says(rng):
    point = np.array([8.0, 0, 0]) + rng.normal(size=(300, 3))
    scan = from_points(point, 0.02, NOISE_M)
    reach = np.maximum(2.2 * 0.02 * np.linalg.norm(point, axis=1), 0.3)
    gap = np.linalg.norm(point[:, None] - point, axis=2)
    label = connected_components(coo_matrix(gap <= np.minimum(reach[:, None], reach)), directed=False)[1]
    right = [set(np.flatnonzero(label == k).tolist()) for k in range(label.max() + 1)]
    found = clusters(scan, 0.3)
    assert sorted(map(sorted, found)) == sorted(map(sorted, right))
    assert [len(one) for one in found] == sorted(map(len, right), reverse=True)


def test_a_shape_without_any_sharp_edge_is_registered(rng):
    """An egg: its scan has edges, where lines leave it, and the shape has none to match them with."""
    polar, around = (x.ravel() for x in np.meshgrid(np.linspace(0.02, np.pi - 0.02, 24), np.arange(24) * np.pi / 12))
    across = np.sin(polar) * (1 + 0.2 * np.cos(polar))
    vertex = np.stack([0.5 * across * np.cos(around), 0.35 * across * np.sin(around), 0.8 * np.cos(polar)], axis=1)
    hull = ConvexHull(vertex)
    a, b, c = (vertex[corner] for corner in hull.simplices.T)
    inward = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0
    face = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    shape, turn = Shape(vertex, face, points=600), exp(np.array([0.4, -0.2, 0.7]))
    scan = scan_of(shape, turn, DISTANCE, rng)
    edges = scan.edges(0.1 * shape.radius_m)
    assert len(edges.point) > 5
    assert not len(shape.edge.point)
    fit = register(scan.point, shape, exp(np.array([0.02, 0.01, 0.02])) @ turn, DISTANCE, NOISE_M, edges=edges)
    assert np.linalg.norm(fit.position - DISTANCE) < 0.05
