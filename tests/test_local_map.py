"""Tracking of a craft that nobody knows: scans joined to a map."""

import numpy as np
import pytest
from lidar_target import DISTANCE, NOISE_M, brick, crooked, directions, scan_of

from estimators import rotation as rot
from estimators.lidar.edge_lines import edge_lines
from estimators.lidar.local_map import LocalMap, surface
from estimators.lidar.scan import Scan

NEAR = 0.6 * DISTANCE
STEP_RAD = np.radians(3.0)


@pytest.fixture(scope="module")
def joined() -> tuple[LocalMap, list[float], np.ndarray]:
    """A map of five scans in steps of 3 degrees, the errors [deg] of all but the first, and the last attitude."""
    rng, truth = np.random.default_rng(3), rot.exp(np.array([0.4, -0.5, 0.3]))
    known, errors = LocalMap(NOISE_M), list[float]()
    rotation, position = truth, NEAR
    for number in range(5):
        own = surface(scan_of(crooked(), truth, NEAR, rng))
        if number:
            fit = known.track(own, rotation, position)
            assert fit.tracked
            rotation, position = fit.rotation, fit.position
            errors.append(float(np.degrees(rot.angle_between(rotation, truth))))
        known.join(own, rotation, position)
        if number < 4:
            way = rng.standard_normal(3)
            truth = rot.exp(STEP_RAD * way / np.linalg.norm(way)) @ truth
    return known, errors, truth


def test_scans_joined_to_a_map_keep_the_attitude(joined):
    """Over four steps the error stays below a degree on average, and does not add up."""
    _, errors, _ = joined
    assert np.mean(errors) < 1.0
    assert max(errors) < 2.0


def test_a_start_far_off_is_found_among_turns(joined):
    """From 25 degrees off, one of the turns tried leads back to where the map is."""
    known, _, truth = joined
    own = surface(scan_of(crooked(), truth, NEAR, np.random.default_rng(4)))
    off = rot.exp(np.radians([0.0, 0.0, 25.0]))
    turns = rot.exp(np.radians(np.array([[0.0, 0, 0], [0, 0, -20], [0, 0, 20], [20, 0, 0], [0, 20, 0]])))
    fit = known.track(own, off @ truth, NEAR, turns)
    assert np.degrees(rot.angle_between(fit.rotation, truth)) < 2.0


def test_another_place_is_not_tracked(joined):
    """A scan of nothing, and one of what lies 2 m off, are not tracked."""
    known, _, truth = joined
    direction, line, step = directions()
    empty = Scan(direction, np.full(len(direction), np.nan), np.radians(2.0), NOISE_M, line, step)
    assert not known.track(surface(empty), truth, NEAR).tracked
    beside = surface(scan_of(crooked(), truth, NEAR, np.random.default_rng(5)))
    assert not known.track(beside, truth, NEAR + np.array([2.0, 0.0, 0.0])).tracked


def test_normals_are_those_of_the_surface():
    """Of a brick, all normals are one of its faces', within 3 degrees for nine of ten."""
    truth = rot.exp(np.array([0.3, 0.5, -0.6]))
    own = surface(scan_of(brick(), truth, NEAR, np.random.default_rng(6)))
    best = np.abs(own.normal @ truth).max(axis=1)
    assert len(own.point) > 200
    assert np.quantile(np.degrees(np.arccos(np.minimum(best, 1.0))), 0.9) < 3.0


def test_edges_run_along_those_of_the_shape():
    """Of a brick, tangents are along one of its axes."""
    truth = rot.exp(np.array([0.3, 0.5, -0.6]))
    scan = scan_of(brick(), truth, NEAR, np.random.default_rng(7))
    found = edge_lines(scan.edges(0.1), np.radians(2.0) * 3.0)
    best = np.abs(found.tangent @ truth).max(axis=1)
    assert len(found.point) >= 6
    assert np.degrees(np.arccos(np.median(best))) < 5.0
