"""LiDAR targets that are open, inside out, flat, symmetric or round: acquired, modulo symmetry, or never believed."""

from functools import lru_cache

import numpy as np
import pytest
from lidar_target import CROOKED, DISTANCE, attitudes, box, brick, crooked, joined, scan_of

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.lidar.acquisition import Verdict, acquire
from estimators.lidar.likeness import likenesses
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import symmetry
from estimators.lidar.tracking import track
from swarm.report.findings import inspections

RIGHT_DEG = 3.0

pytestmark = pytest.mark.long


def shape_of(vertex: Floats, face: Ints) -> Shape:
    return Shape(vertex, face, points=1500)


def trough() -> tuple[Floats, Ints]:
    """An open bent sheet of three panels, all different, with an open chest: no symmetry."""
    vertex = np.array([[-1, 0, 0], [0.7, 0, 0], [0.7, 0.8, 0.1], [-1, 0.8, 0.1], [-1, 1.2, 0.9], [0.2, 1.2, 0.9]])
    vertex = np.vstack([vertex, [[-1.0, -0.5, 0.6], [0.1, -0.5, 0.6]]]).astype(float)
    sheet = np.array([[0, 1, 2], [0, 2, 3], [3, 2, 5], [3, 5, 4], [0, 6, 7], [0, 7, 1]])
    chest = box((0.2, 0.2, 0.0), (0.6, 0.5, 0.4))
    return joined((vertex, sheet), (chest[0], chest[1][:10]))


def test_an_open_surface_is_known_from_both_sides_and_acquired_or_not_believed() -> None:
    shape = shape_of(*trough())
    assert shape.two_sided
    assert np.isfinite(shape.views.centroid).all()
    rng, right = np.random.default_rng(0), 0
    for attitude in attitudes(8, 1):
        found = acquire(scan_of(shape, attitude, DISTANCE, rng), shape)
        error = np.degrees(rot.angle_between(attitude, found.rotation))
        assert not found.found or error < RIGHT_DEG
        right += found.found
    assert right >= 4


def test_a_closed_mesh_that_is_inside_out_is_turned() -> None:
    vertex, face = box((-0.6, -0.4, -0.3), (0.6, 0.4, 0.3))
    for faces in (face, face[:, ::-1]):
        shape = shape_of(vertex, faces)
        assert not shape.two_sided
        # Outward: away from the centre of a convex body.
        assert (np.sum(shape.point * shape.normal, axis=1) > 0.29).all()


def test_a_flat_sheet_has_no_pose_and_says_so() -> None:
    vertex = np.array([[-0.6, -0.4, 0], [0.6, -0.4, 0], [0.6, 0.4, 0], [-0.6, 0.4, 0]])
    shape = shape_of(vertex, np.array([[0, 1, 2], [0, 2, 3]]))
    assert shape.two_sided
    assert np.isfinite(shape.views.centroid).all()
    rng = np.random.default_rng(2)
    verdicts = [acquire(scan_of(shape, a, DISTANCE, rng), shape).verdict for a in attitudes(6, 2)]
    assert Verdict.FOUND not in verdicts


@lru_cache
def corner() -> Shape:
    """The corner of a cube: a third of a turn about its diagonal changes nothing."""
    vertex = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 1.0
    return shape_of(vertex, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


@lru_cache
def drum() -> Shape:
    """A body of revolution with 40 sides, its ends of different size: an axis, and no way to turn it over."""
    angle = 2 * np.pi * np.arange(40) / 40
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low, high = (np.column_stack([r * ring, np.full(40, z)]) for r, z in ((0.6, -0.5), (0.3, 0.7)))
    after = (np.arange(40) + 1) % 40
    i, bottom, top = np.arange(40), np.full(40, 80), np.full(40, 81)
    sides = np.concatenate([np.stack([i, after, 40 + after], axis=1), np.stack([i, 40 + after, 40 + i], axis=1)])
    ends = np.concatenate([np.stack([bottom, after, i], axis=1), np.stack([top, 40 + i, 40 + after], axis=1)])
    vertex = np.concatenate([low, high, [[0, 0, -0.5], [0, 0, 0.7]]])
    return shape_of(vertex, np.concatenate([sides, ends]))


def test_symmetry_is_that_of_the_shape() -> None:
    """The whole group, its products too, and to a hundredth of a degree."""
    assert symmetry(crooked()).trivial
    third = rot.exp(2 * np.pi / 3 * np.ones(3) / np.sqrt(3))
    halves = rot.exp(np.pi * np.eye(3))
    for shape, wanted in ((corner(), [third, third.T]), (brick(), list(halves))):
        group = symmetry(shape)
        assert len(group.turn) == 1 + len(wanted)
        assert not len(group.axes)
        for turn in wanted:
            assert np.degrees(rot.angle_between(group.turn, turn).min()) < 0.01
        rotation, position = group.equivalents(np.eye(3), np.zeros(3))
        for turn, shift in zip(rotation, position, strict=True):
            assert shape.tree.query(shape.point @ turn.T + shift)[0].max() < 3 * shape.spacing_m
        # What is mistaken for the shape is something else.
        assert all(group.angle_between(group.turn, turn).min() > np.radians(20) for turn in likenesses(shape).rotation)


def test_a_cube_has_all_its_24_turns() -> None:
    group = symmetry(shape_of(*box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))))
    assert len(group.turn) == 24
    # A signed permutation of the axes with determinant one.
    assert np.abs(group.turn - np.round(group.turn)).max() < 1e-3
    assert len(np.unique(np.round(group.turn).reshape(24, 9), axis=0)) == 24


def test_a_body_of_revolution_has_an_axis_and_is_acquired_and_tracked_up_to_the_turn_about_it() -> None:
    shape = drum()
    group = symmetry(shape)
    assert np.abs(group.axes) == pytest.approx(np.array([[0, 0, 1]]), abs=1e-3)
    assert len(group.turn) == 1
    rng, found_of = np.random.default_rng(5), 0
    for attitude in attitudes(4, 6):
        found = acquire(scan_of(shape, attitude, DISTANCE, rng), shape)
        if not found.found:
            continue
        found_of += 1
        true, there = group.nearest(attitude, DISTANCE, found.rotation)
        error = np.concatenate([rot.log(true @ found.rotation.T), there - found.position])
        assert np.degrees(np.linalg.norm(error[:3])) < RIGHT_DEG
        assert np.linalg.norm(error[3:]) < 0.05
        # What is promised of the axis is kept; of the turn about it, nothing is promised.
        axis = found.rotation[:, 2]
        assert axis @ found.covariance[:3, :3] @ axis > 1.0
        assert error @ np.linalg.solve(found.covariance, error) < 30
        turned = rot.exp(np.radians([2.0, -1.0, 1.0])) @ attitude
        fit = track(scan_of(shape, turned, DISTANCE, rng), shape, found.rotation, found.position)
        assert fit.tracked
        assert np.degrees(group.angle_between(fit.rotation[None], turned)[0]) < RIGHT_DEG
    assert found_of >= 2


@pytest.mark.parametrize("seed", [3, 4])
def test_a_symmetric_target_is_acquired_as_a_class(seed: int) -> None:
    shape, rng, found_of = corner(), np.random.default_rng(seed), 0
    group = symmetry(shape)
    for attitude in attitudes(4, seed):
        found = acquire(scan_of(shape, attitude, DISTANCE, rng), shape)
        if not found.found:
            continue
        error = np.degrees(group.angle_between(found.rotation[None], attitude)[0])
        assert error < RIGHT_DEG
        found_of += 1
        # Any member of the class, with its own covariance, is the same answer.
        there, place = group.equivalents(found.rotation, found.position)
        other = found.nearest(shape, there[-1])
        assert other.position == pytest.approx(place[-1], abs=1e-9)
    assert found_of >= 2


def test_a_small_part_that_tells_two_attitudes_decides_where_it_is_seen() -> None:
    """A brick with one small knob: without it, four attitudes are one. Right, or ambiguous; never another."""
    shape = shape_of(*joined(box((-0.6, -0.4, -0.3), (0.6, 0.4, 0.3)), box((0.35, 0.1, 0.3), (0.55, 0.3, 0.45))))
    assert symmetry(shape).trivial
    rng, verdicts = np.random.default_rng(7), []
    for attitude in attitudes(4, 8):
        found = acquire(scan_of(shape, attitude, DISTANCE / 2, rng), shape)
        verdicts.append(found.verdict)
        assert not found.found or np.degrees(rot.angle_between(attitude, found.rotation)) < RIGHT_DEG
    assert verdicts.count(Verdict.FOUND) >= 2


def test_the_table_says_why_a_target_was_never_acquired() -> None:
    figures = {
        "target": "t",
        "scans": 20,
        "tracked_share": 0.0,
        "acquisitions": 0,
        "measured_attitude_mean_deg": None,
        "outcomes": {"ambiguous": 17, "undetermined": 3},
    }
    (finding,) = inspections({"a": figures})
    assert "17 scans ambiguous: more than one attitude fits, the shape is symmetric" in finding.text
    (finding,) = inspections({"a": {**figures, "acquisitions": 1}})
    assert "ambiguous" not in finding.text


def divided(vertex: Floats, face: Ints) -> tuple[Floats, Ints]:
    """Every triangle as four."""
    corner = vertex[face]
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return parts.reshape(-1, 3), np.arange(3 * len(parts)).reshape(-1, 3)


def test_a_mesh_far_from_its_origin_inside_out_and_in_thousands_of_triangles_is_the_same_target() -> None:
    """Its pose is that of its own origin, 21 m away, which an error of the attitude moves: the covariance knows."""
    vertex, face = joined(*CROOKED)
    for _ in range(3):
        vertex, face = divided(vertex, face)
    offset = np.array([20.0, -7.0, 3.0])
    far = Shape(vertex + offset, face[:, ::-1], points=1500)
    assert len(far.mesh.corner) > 3000
    rng = np.random.default_rng(0)
    for truth in attitudes(2, 3):
        found = acquire(scan_of(crooked(), truth, DISTANCE, rng), far)
        assert found.found
        turned = rot.exp(np.radians([2.0, 1.0, -1.0])) @ truth
        near = DISTANCE - turned @ offset
        fit = track(scan_of(crooked(), turned, DISTANCE, rng), far, found.rotation, found.position)
        assert fit.tracked
        for true, answer, place in ((truth, found, DISTANCE - truth @ offset), (turned, fit, near)):
            error = np.concatenate([rot.log(true @ answer.rotation.T), place - answer.position])
            assert np.degrees(np.linalg.norm(error[:3])) < 0.5
            assert error @ np.linalg.solve(answer.covariance, error) < 22.5, "99.9 % of six degrees of freedom"
