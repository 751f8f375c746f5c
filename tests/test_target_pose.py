"""Acquisition, registration and tracking of a target of known shape, from scans cast at its mesh without MuJoCo."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest
from lidar_target import DISTANCE, NOISE_M, attitudes, box, brick, crooked, directions, scan_of
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.lidar.acquisition import Verdict, acquire
from estimators.lidar.agreement import agreement
from estimators.lidar.feature_templates import angles_zyx, from_angles_zyx, right_angles
from estimators.lidar.pose_search import rotations
from estimators.lidar.ray_cast import cast, triangles
from estimators.lidar.registration import register
from estimators.lidar.scan import Scan, clusters, from_points
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry
from estimators.lidar.tracking import Outcome, chain, track


def off_deg(a, b):
    return float(np.degrees(rot.angle_between(a, b)))


def test_rays_meet_the_mesh_where_mujoco_says():
    rng = np.random.default_rng(1)
    parts = [box((-0.4, -0.35, -0.5), (0.4, 0.35, 0.5)), box((0.2, 0.1, 0.3), (0.9, 0.3, 0.8))]
    spec = mujoco.MjSpec()
    for low, high in ((vertex.min(axis=0), vertex.max(axis=0)) for vertex, _ in parts):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=(low + high) / 2, size=(high - low) / 2)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    vertex = np.concatenate([v for v, _ in parts])
    face = np.concatenate([parts[0][1], parts[1][1] + 8])
    start = rng.uniform(-2, 2, (400, 3)) + np.array([3.0, 0, 0])
    aim = rng.uniform(-0.7, 0.7, (400, 3)) - start
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    # Along an axis, components are exactly zero.
    aim[:20], start[:20] = [-1.0, 0.0, 0.0], np.column_stack([np.full(20, 3.0), rng.uniform(-0.6, 0.6, (20, 2))])
    found = cast(triangles(vertex, face), start, aim)
    geom = np.zeros(1, dtype=np.int32)
    for origin, along, distance in zip(start, aim, found.distance, strict=True):
        theirs = mujoco.mj_ray(model, data, origin, along, None, True, -1, geom)
        assert (theirs < 0) == np.isinf(distance)
        if theirs >= 0:
            assert distance == pytest.approx(theirs, abs=1e-9)


def test_registration_finds_the_pose_and_knows_how_well():
    """40 scans: the mean NEES lies below the 99.9 % bound. It may lie low: the covariance is not below the noise's."""
    rng, nees = np.random.default_rng(2), []
    for truth in attitudes(40, seed=3):
        scan = scan_of(crooked(), truth, DISTANCE, rng)
        start = rot.exp(np.radians(rng.uniform(-4, 4, 3))) @ truth, DISTANCE + rng.uniform(-0.05, 0.05, 3)
        fit = register(scan.point, crooked(), *start, NOISE_M, edges=scan.edges(0.1 * crooked().radius_m))
        assert fit.converged
        assert off_deg(fit.rotation, truth) < 1.0
        error = np.concatenate([rot.log(truth @ fit.rotation.T), DISTANCE - fit.position])
        nees.append(error @ np.linalg.solve(fit.covariance, error))
    assert np.mean(nees) < chi2.ppf(0.999, 240) / 40


def test_what_a_plane_leaves_free_is_said():
    """From straight ahead only one face of the brick is seen: three directions are free, without the edges."""
    scan = scan_of(brick(), np.eye(3), DISTANCE, np.random.default_rng(4))
    fit = register(scan.point, brick(), np.eye(3), DISTANCE, NOISE_M)
    assert fit.degenerate
    free = np.isinf(np.diag(fit.covariance))
    # About x, the line of sight, and along y and z.
    assert free.tolist() == [True, False, False, False, True, True]


def test_a_few_wrong_matches_do_not_lead_along_what_all_others_leave_free():
    """Two faces of a brick leave it free to slide along both; two stray points beyond its end would pull it there."""
    rng = np.random.default_rng(5)
    truth = rot.exp(np.array([0.0, 0.0, 0.5])) @ rot.exp(np.array([0.0, 0.35, 0.0]))
    scan = scan_of(brick(), truth, DISTANCE, rng)
    own = (scan.point - DISTANCE) @ truth
    end = 0.3 * np.sign((-truth.T @ DISTANCE)[2])
    of_two = own[np.abs(own[:, 2] - end) > 0.04]
    stray = np.array([[-0.3, 0.1, end * 1.25], [-0.2, 0.0, end * 1.25]])
    point = np.concatenate([of_two, stray]) @ truth.T + DISTANCE
    fit = register(point, brick(), truth, DISTANCE, NOISE_M, reach_m=0.12 * brick().radius_m)
    assert fit.degenerate
    assert abs((fit.position - DISTANCE) @ truth[:, 2]) < 0.005
    assert off_deg(truth, fit.rotation) < 0.5


def test_the_search_covers_all_rotations():
    """3000 rotations, 13 degrees apart: any other one has a start about as near, and the steps do the rest."""
    starts = rotations()
    worst = max(np.degrees(rot.angle_between(starts, r).min()) for r in attitudes(300, seed=5))
    assert worst < 14.0


def test_acquired_from_any_attitude():
    """All are right, to some tenths of a degree; a view that shows too little of an edge may be called undetermined."""
    rng = np.random.default_rng(6)
    believed = 0
    for truth in attitudes(6, seed=7):
        found = acquire(scan_of(crooked(), truth, DISTANCE, rng), crooked())
        assert found.found == (found.confidence > 0.5) == (found.verdict is Verdict.FOUND)
        assert off_deg(found.rotation, truth) < 1.0
        assert np.linalg.norm(found.position - DISTANCE) < 0.02
        believed += found.found
    assert believed >= 5


def test_a_brick_is_acquired_as_a_class_of_four():
    group = symmetry(brick())
    assert len(group.turn) == 4
    rng, believed = np.random.default_rng(8), 0
    for truth in attitudes(2, seed=9):
        found = acquire(scan_of(brick(), truth, DISTANCE, rng), brick())
        assert found.verdict in (Verdict.FOUND, Verdict.UNDETERMINED)
        believed += found.found
        # One of the four is the truth, and the pose given is one of the four.
        half = rot.exp(np.pi * np.eye(3))
        assert min(off_deg(found.rotation @ h, truth) for h in (np.eye(3), *half)) < 2.0
    assert believed >= 1


def test_another_object_is_not_recognised():
    rng = np.random.default_rng(10)
    for truth in attitudes(2, seed=11):
        found = acquire(scan_of(brick(), truth, DISTANCE / 2, rng), crooked())
        assert not found.found
        assert found.confidence <= 0.5


def test_a_scan_that_is_none_is_an_error_and_an_empty_one_a_flagged_null():
    direction, line, step = directions()
    empty = Scan(direction, np.full(len(direction), np.nan), np.radians(2.0), NOISE_M, line, step)
    found = acquire(empty, crooked())
    assert found.verdict is Verdict.TOO_FEW
    assert np.isnan(found.rotation).all()
    assert np.isnan(found.position).all()
    assert found.confidence == 0
    assert track(empty, crooked(), np.eye(3), DISTANCE).outcome is Outcome.TOO_FEW
    for broken, message in (
        (empty._replace(direction=np.where(direction == direction[3], np.nan, direction)), "direction is not finite"),
        (empty._replace(range_m=np.full(len(direction), np.inf)), "a range is infinite"),
        (empty._replace(direction=2 * direction), "not of unit length"),
        (empty._replace(range_m=empty.range_m[1:]), "expected"),
        (empty._replace(noise_m=0.0), "must be positive"),
    ):
        with pytest.raises(ValueError, match=message):
            acquire(broken, crooked())
        with pytest.raises(ValueError, match=message):
            track(broken, crooked(), np.eye(3), DISTANCE)
    with pytest.raises(ValueError, match="a coordinate is not finite"):
        from_points(np.array([[1.0, np.nan, 0.0]]), 0.03, NOISE_M)
    with pytest.raises(ValueError, match="the prediction is not finite"):
        track(empty, crooked(), np.full((3, 3), np.nan), DISTANCE)


def test_points_on_one_plane_are_no_pose():
    rng = np.random.default_rng(12)
    y, z = rng.uniform(-0.6, 0.6, (2, 500))
    flat = from_points(np.column_stack([5 + 0.01 * rng.standard_normal(500), y, z]), np.radians(2.0), NOISE_M)
    assert not acquire(flat, crooked()).found


def test_tracking_follows_and_notices_when_it_does_not():
    rng = np.random.default_rng(13)
    start = attitudes(1, seed=14)[0]
    rotation, position = start, DISTANCE
    for i in range(8):
        truth = rot.exp(np.radians([2.0 * i, -3.0 * i, 1.0 * i])) @ start
        place = DISTANCE + 0.03 * i
        found = track(scan_of(crooked(), truth, place, rng), crooked(), rotation, position)
        assert found.tracked
        assert off_deg(found.rotation, truth) < 1.0
        rotation, position = found.rotation, found.position
    # Turned by 100 degrees between two scans: no registration can follow that, and it is said.
    jumped = scan_of(crooked(), rot.exp(np.radians([0, 100.0, 0])) @ truth, place, rng)
    assert not track(jumped, crooked(), rotation, position).tracked
    # Gone: too few.
    gone = scan_of(crooked(), truth, place + np.array([0, 3.0, 0]), rng)
    assert track(gone, crooked(), rotation, position).outcome in (Outcome.TOO_FEW, Outcome.OVERLAP)


def test_scan_to_scan_tracking_adds_its_errors_up():
    rng = np.random.default_rng(15)
    start = attitudes(1, seed=16)[0]
    scans = [
        scan_of(crooked(), rot.exp(np.radians([0, 0, 4.0 * i])) @ start, DISTANCE, rng).around(DISTANCE, 2.0)
        for i in range(6)
    ]
    rotation, position = start, DISTANCE
    for before, scan in pairwise(scans):
        rotation, position = chain(scan, before, rotation, position)
    # Some tenths of a degree per scan; without following, it would be 20.
    assert off_deg(rotation, rot.exp(np.radians([0, 0, 20.0])) @ start) < 5.0


def test_agreement_counts_every_ray():
    truth = attitudes(1, seed=17)[0]
    scan = scan_of(crooked(), truth, DISTANCE, np.random.default_rng(18), noise_m=1e-3)
    right = agreement(scan, crooked(), truth, DISTANCE)
    assert right.overlap == 1.0
    assert right.rays >= np.count_nonzero(scan.returned)
    wrong = agreement(scan, crooked(), rot.exp(np.radians([0, 0, 60.0])) @ truth, DISTANCE)
    assert wrong.overlap < 0.8
    nothing = agreement(scan, crooked(), truth, -DISTANCE)
    assert nothing.overlap < 0.01, "behind the scanner: all returns are unexplained"


def test_objects_are_told_apart():
    rng = np.random.default_rng(19)
    one = scan_of(crooked(), np.eye(3), DISTANCE, rng)
    two = scan_of(brick(), np.eye(3), np.array([9.0, 3.0, 0.0]), rng)
    nearer = np.fmin(one.range_m, two.range_m)
    found = clusters(one._replace(range_m=nearer), 0.1)
    assert len(found) >= 2
    for members in found:
        assert np.ptp(nearer[members]) < 2.5, "no object reaches from one to the other, 5 m behind it"
    assert sorted(np.concatenate(found)) == np.flatnonzero(np.isfinite(nearer)).tolist()


def test_the_papers_64_rotations_are_24():
    turns = right_angles()
    assert turns.shape == (64, 3, 3)
    distinct = np.unique(np.round(turns).astype(int).reshape(64, 9), axis=0)
    assert len(distinct) == 24
    angles = np.array([0.3, -0.7, 1.9])
    assert angles_zyx(from_angles_zyx(angles)) == pytest.approx(angles, abs=1e-12)


def test_a_shape_needs_an_area():
    with pytest.raises(ValueError, match="no triangle has an area"):
        Shape(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="not finite"):
        Shape(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))
