"""LiDAR targets that are open, inside out, flat or symmetric: acquired, or never believed; no traceback."""

import numpy as np
import pytest
from lidar_target import DISTANCE, attitudes, box, brick, crooked, joined, scan_of

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.lidar.acquisition import Verdict, acquire
from estimators.lidar.likeness import symmetries
from estimators.lidar.shape import Shape
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


def corner() -> Shape:
    """The corner of a cube: a third of a turn about its diagonal changes nothing."""
    vertex = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 1.0
    return shape_of(vertex, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def test_symmetries_are_those_of_the_shape() -> None:
    assert len(symmetries(crooked()).rotation) == 0
    third = rot.exp(2 * np.pi / 3 * np.ones(3) / np.sqrt(3))
    for wanted, shape in (([third, third.T], corner()), ([np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1])], brick())):
        turns = symmetries(shape).rotation
        for turn in wanted:
            assert np.degrees(rot.angle_between(turns, turn).min()) < 0.5
        for turn, shift in zip(turns, symmetries(shape).position, strict=True):
            far = shape.tree.query(shape.point @ turn.T + shift)[0]
            assert far.max() < 3 * shape.spacing_m


@pytest.mark.parametrize("seed", [3, 4])
def test_a_symmetric_target_is_never_believed(seed: int) -> None:
    shape, rng = corner(), np.random.default_rng(seed)
    for attitude in attitudes(6, seed):
        assert not acquire(scan_of(shape, attitude, DISTANCE, rng), shape).found


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
