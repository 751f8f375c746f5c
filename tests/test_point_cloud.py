"""Planes, principal components and curvature of point clouds, against closed forms."""

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.lidar.curvature import curvature, grow
from estimators.lidar.feature_templates import segment
from estimators.lidar.point_cloud import align_principal, principal, ransac_plane


def test_the_largest_plane_is_found_among_outliers():
    rng = np.random.default_rng(0)
    normal = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    across = np.linalg.svd(normal[None])[2][1:]
    flat = rng.uniform(-1, 1, (300, 2)) @ across + 0.7 * normal + 0.005 * rng.standard_normal((300, 1)) * normal
    cloud = np.concatenate([flat, rng.uniform(-1, 1, (200, 3)) + 2 * normal])
    found = ransac_plane(cloud, 0.02, rng)
    # 300 points of 5 mm over 1 m: the normal is known to 5 mm / (0.58 m sqrt(300)) = 0.5 mrad.
    assert abs(found.normal @ normal) > np.cos(3e-3)
    assert abs(found.offset_m * np.sign(found.normal @ normal) - 0.7) < 2e-3
    assert found.inlier[:300].mean() > 0.99
    assert found.inlier[300:].mean() < 0.02


def test_no_plane_through_a_line_and_no_cloud_of_nan():
    rng = np.random.default_rng(1)
    with pytest.raises(ValueError, match="all points are on one line"):
        ransac_plane(np.outer(np.arange(10.0), [1, 2, 3]), 0.01, rng)
    with pytest.raises(ValueError, match="1 points are not finite"):
        ransac_plane(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, np.nan]]), 0.01, rng)
    with pytest.raises(ValueError, match="at least 3 are needed"):
        ransac_plane(np.zeros((0, 3)), 0.01, rng)


def test_principal_axes_and_the_sign_that_is_chosen():
    rng = np.random.default_rng(2)
    a = rng.standard_normal((500, 3)) * [3.0, 1.5, 0.5]
    turn, shift = rot.exp(np.array([0.4, -1.0, 2.0])), np.array([1.0, 2.0, 3.0])
    b = a @ turn.T + shift
    assert principal(a).variance == pytest.approx(np.linalg.eigvalsh(np.cov(a.T, bias=True))[::-1], rel=1e-12)
    found = align_principal(a, b, rot.exp(np.radians([10.0, 20, -10])) @ turn)
    assert found.determined
    assert found.rotation == pytest.approx(turn, abs=1e-9)
    assert found.translation == pytest.approx(shift, abs=1e-9)
    # Near the pose turned by half a turn about an own axis, that one is chosen.
    other = turn @ rot.exp(np.array([np.pi, 0, 0]))
    flipped = align_principal(a, b, other).rotation
    assert np.degrees(rot.angle_between(flipped, other)) < 12


def test_axes_of_nearly_equal_spread_mean_nothing():
    round_cloud = np.random.default_rng(3).standard_normal((2000, 3)) * [2.0, 1.0, 0.98]
    found = align_principal(round_cloud, round_cloud, np.eye(3))
    assert not found.determined
    assert np.isnan(found.rotation).all()


@pytest.mark.parametrize(
    ("kind", "gaussian", "mean"),
    [("sphere", 1 / 0.25, 1 / 0.5), ("cylinder", 0.0, 0.5 / 0.5), ("plane", 0.0, 0.0), ("saddle", -1.0, 0.0)],
)
def test_curvature_is_that_of_the_surface(kind, gaussian, mean):
    """Without noise: off by what the quadric leaves out, (radius of the fit / radius of the surface)^2."""
    rng = np.random.default_rng(4)
    u, v = rng.uniform(-0.3, 0.3, (2, 900))
    z = {
        "sphere": np.sqrt(0.25 - u * u - v * v),
        "cylinder": np.sqrt(0.25 - u * u),
        "plane": 0.3 * u,
        "saddle": (u * u - v * v) / 2,
    }[kind]
    cloud = np.column_stack([u, v, z])
    found = curvature(cloud, 0.1)
    middle = np.hypot(u, v) < 0.1
    assert np.median(found.gaussian[middle]) == pytest.approx(gaussian, abs=0.05 * (1 + abs(gaussian)))
    assert np.median(np.abs(found.mean[middle])) == pytest.approx(abs(mean), abs=0.05 * (1 + abs(mean)))
    normal = found.normal[middle][0]
    assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-9)


def test_regions_grow_over_neighbours_only():
    rng = np.random.default_rng(5)
    point = np.concatenate([rng.uniform(0, 1, (300, 3)), rng.uniform(0, 0.6, (60, 3)) + 5, [[20.0, 0, 0]]])
    value = np.full(len(point), 2.0)
    value[-1] = np.nan
    regions = grow(point, value, 1.5, 1.0, 0.4)
    assert [len(r) for r in regions] == [300, 60]
    assert grow(point, value, 3.0, 1.0, 0.4) == [], "no seed"


def test_a_cloud_falls_into_panel_antenna_and_body():
    rng = np.random.default_rng(6)
    panel = np.column_stack([rng.uniform(-1, 1, (600, 2)), 0.004 * rng.standard_normal(600)])
    direction = rng.standard_normal((400, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    ball = 0.4 * direction / np.linalg.norm(direction, axis=1, keepdims=True) + [0.0, 3.0, 1.0]
    found = segment(np.concatenate([panel, ball]))
    assert np.isin(np.arange(600), found.panels).mean() > 0.97
    assert (found.antenna >= 600).mean() > 0.97
    assert len(found.antenna) > 200
    together = np.sort(np.concatenate(found))
    assert np.array_equal(together, np.arange(1000)), "every point has one feature"
