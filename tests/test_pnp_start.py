"""Cold starts: the right minimum or a flag, both candidates of a plane, and nothing where there is no pose."""

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, angle_errors, angles, draw, random_position, random_rotation, sweep_offsets

from estimators.arrays import Bools, Floats
from estimators.levenberg_marquardt import STEP_SMALL
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.pnp_start import StartCandidates, cold_start, cold_starts
from estimators.rotation import angle_between, exp

NOISE_IND = ANGLE_NOISE * np.sqrt(1 - RHO)
SURE = 25
"""Twice the log likelihood ratio above which the caller trusts the first candidate: five deviations."""


def ambiguous(found: StartCandidates) -> bool:
    return len(found.cost) > 1 and found.cost[1] - found.cost[0] < SURE * NOISE_IND**2


def still(photodiodes: int) -> tuple[Floats, Floats, Floats]:
    return np.zeros((photodiodes, 2)), np.zeros(3), np.zeros(3)


def start(theta: Floats, point: Floats, lit: Bools | None = None) -> StartCandidates:
    return cold_start(theta, np.ones(len(point), dtype=np.bool_) if lit is None else lit, point, *still(len(point)))


def seen(rotation: Floats, position: Floats, point: Floats) -> Floats:
    """Noise-free angles (K, 2) of one static craft."""
    offset, *rates = (a[None] for a in still(len(point)))
    return np.asarray(angles(rotation[None], position[None], point[None], offset, rates[0], rates[1])[0])


def refined_truth(rotation: Floats, position: Floats, point: Floats, theta: Floats) -> Floats:
    """The attitude of the minimum next to the truth."""
    lit = np.ones((1, len(point)), dtype=np.bool_)
    motion = (a[None] for a in still(len(point)))
    return np.asarray(refine(theta[None], lit, point[None], rotation[None], position[None], *motion).rotation[0])


def test_random_poses_of_the_dome_never_silently_wrong() -> None:
    # The larger run, 10 000 poses beside OpenCV, is benchmarks/cold_start.py.
    count, rng = 2000, np.random.default_rng(1)
    d, still_all = draw(rng, count, 1.0, 5.0), (np.zeros((count, 12, 2)), np.zeros((count, 3)), np.zeros((count, 3)))
    theta = angles(d.rotation, d.position, d.point, *still_all) + angle_errors(rng, count, 12)
    truth = refine(theta, d.lit, d.point, d.rotation, d.position, *still_all)
    assert truth.solved.all()
    right = flagged = 0
    for c in range(count):
        found = start(np.where(d.lit[c, :, None], theta[c], np.nan), d.point[c], d.lit[c])
        if ambiguous(found):
            flagged += 1
        else:
            assert angle_between(found.rotation[0], truth.rotation[c]) < 1e-6
            right += 1
    print(f"right {right}, ambiguous {flagged}")
    assert flagged < 0.01 * count


@pytest.mark.parametrize("photodiodes", [4, 5, 6, 9])
@pytest.mark.parametrize("depth", [1.0, 0.2, 0.05])
@pytest.mark.parametrize("half_size_m", [0.0625, 0.4])
def test_random_clouds_down_to_four_photodiodes(photodiodes: int, depth: float, half_size_m: float) -> None:
    # No symmetry, flat ones too, and targets as wide as their distance, where parallel projection says nothing.
    rng = np.random.default_rng(photodiodes)
    for _ in range(40):
        point = half_size_m * rng.uniform(-1, 1, (photodiodes, 3)) * [1, 1, depth]
        rotation, position = random_rotation(rng, 1)[0], random_position(rng, 1, 1.0, 4.0)[0]
        if np.min(point @ rotation[2] + position[2]) < 0.3:
            continue
        theta = seen(rotation, position, point) + angle_errors(rng, 1, photodiodes)[0]
        found = start(theta, point)
        truth = refined_truth(rotation, position, point, theta)
        distance = angle_between(found.rotation, truth)
        # What is not flagged is right; what is flagged has the right one among its candidates.
        assert distance[0] < 1e-6 or (ambiguous(found) and np.min(distance) < 1e-6)


@pytest.mark.parametrize("photodiodes", [4, 5, 12])
def test_a_plane_keeps_both_candidates(photodiodes: int) -> None:
    rng = np.random.default_rng(photodiodes)
    flags = 0
    for _ in range(60):
        point = np.column_stack([rng.uniform(-0.0625, 0.0625, (photodiodes, 2)), np.full(photodiodes, 0.02)])
        tilt = exp(np.deg2rad(rng.uniform(25, 65)) * np.append(random_rotation(rng, 1)[0, 0, :2], 0.0))
        rotation, position = tilt @ exp(np.array([0, np.pi, 0])), np.append(rng.uniform(-0.5, 0.5, 2), 4.0)
        theta = seen(rotation, position, point) + angle_errors(rng, 1, photodiodes)[0]
        found = start(theta, point)
        truth = refined_truth(rotation, position, point, theta)
        distance = angle_between(found.rotation, truth)
        assert len(found.cost) >= 2
        assert np.min(distance) < 1e-6
        flags += ambiguous(found)
        assert distance[0] < 1e-6 or ambiguous(found)
        # The second one turns the plane's normal to the other side of the line of sight.
        sight = position / np.linalg.norm(position)
        normals = found.rotation[:2, :, 2]
        mirrored = normals[0] - 2 * (normals[0] @ sight) * sight
        assert np.abs(normals[1] @ mirrored) > np.cos(np.deg2rad(15))
    print(f"planar, {photodiodes} photodiodes at 4 m: {flags} of 60 ambiguous")


def test_four_photodiodes_in_a_plane_at_a_distance_are_ambiguous() -> None:
    # 6 cm across at 12 m: parallel projection within the noise, so both candidates fit.
    square = 0.03 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    rotation, position = exp(np.array([0.5, np.pi, 0.0])), np.array([1.0, 0.0, 12.0])
    rng = np.random.default_rng(3)
    for _ in range(20):
        assert ambiguous(start(seen(rotation, position, square) + angle_errors(rng, 1, 4)[0], square))


def test_exact_angles_give_the_exact_pose() -> None:
    rng = np.random.default_rng(4)
    d = draw(rng, 200, 1.0, 5.0)
    for c in range(200):
        point = d.point[c, d.lit[c]]
        found = start(seen(d.rotation[c], d.position[c], point), point)
        # The search ends where less than that is left to go.
        assert angle_between(found.rotation[0], d.rotation[c]) < STEP_SMALL
        assert np.max(np.abs(found.position[0] - d.position[c])) < STEP_SMALL


def test_motion_is_compensated() -> None:
    rng = np.random.default_rng(5)
    d, offset = draw(rng, 50, 1.0, 5.0), sweep_offsets(rng, 50, 12)
    rate, velocity = rng.standard_normal((2, 50, 3))
    theta = angles(d.rotation, d.position, d.point, offset, rate, velocity)
    for c in range(50):
        found = cold_start(theta[c], d.lit[c], d.point[c], offset[c], rate[c], velocity[c])
        assert angle_between(found.rotation[0], d.rotation[c]) < STEP_SMALL


def test_candidates_are_sorted_distinct_and_in_front() -> None:
    rng = np.random.default_rng(6)
    for _ in range(50):
        point = 0.1 * rng.uniform(-1, 1, (4, 3)) * [1, 1, 0.1]
        rotation, position = random_rotation(rng, 1)[0], random_position(rng, 1, 1.0, 4.0)[0]
        found = start(seen(rotation, position, point) + angle_errors(rng, 1, 4)[0], point)
        assert 1 <= len(found.cost) <= 4
        assert (np.diff(found.cost) >= 0).all()
        for i in range(len(found.cost)):
            assert (point @ found.rotation[i, 2] + found.position[i, 2] > 0).all()
            assert (angle_between(found.rotation[i], found.rotation[:i]) > 1e-3).all()


def test_where_there_is_no_pose_there_is_no_candidate() -> None:
    rng = np.random.default_rng(7)
    point, rotation, position = 0.06 * rng.uniform(-1, 1, (6, 3)), exp(np.ones(3)), np.array([0.2, 0.1, 2.0])
    theta = seen(rotation, position, point)
    three = np.arange(6) < 3
    missing, behind = theta.copy(), theta + np.pi
    missing[2, 1] = np.nan
    line = np.linspace(-0.06, 0.06, 6)[:, None] * np.array([0.6, 0.0, 0.8])
    cases = {
        "three lit": (theta, point, three),
        "none lit": (theta, point, three & ~three),
        "a lit angle missing": (missing, point, None),
        "angles behind": (behind, point, None),
        "collinear": (seen(rotation, position, line), line, None),
        "one point": (theta, np.tile(point[:1], (6, 1)), None),
        "one direction": (np.full((6, 2), 1.5), point, None),
    }
    for name, (angle, layout, lit) in cases.items():
        found = start(angle, layout, lit)
        assert len(found.cost) == 0, name
        assert found.rotation.shape == (0, 3, 3)
        assert found.position.shape == (0, 3)


def test_a_plane_seen_edge_on_is_no_exception() -> None:
    point = np.column_stack([np.random.default_rng(8).uniform(-0.06, 0.06, (6, 2)), np.zeros(6)])
    rotation, position = exp(np.array([np.pi / 2, 0, 0])), np.array([0.0, 0.0, 2.0])
    found = start(seen(rotation, position, point), point)
    assert np.isfinite(found.cost).all()


def test_three_places_shared_by_four_photodiodes_are_ambiguous() -> None:
    # P3P has up to four exact solutions: a coincident fourth photodiode decides nothing.
    point = 0.06 * np.array([[1.0, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [1.0, 0, 0]])
    rotation, position = exp(np.array([0.6, 2.6, 0.1])), np.array([0.3, -0.2, 2.0])
    found = start(seen(rotation, position, point), point)
    assert ambiguous(found)
    assert np.min(angle_between(found.rotation, rotation)) < 1e-6


@pytest.mark.parametrize("argument", ["theta", "lit", "point_m", "offset_s", "angular_rate", "velocity"])
def test_wrong_shapes_name_the_argument(argument: str) -> None:
    shapes = {
        "theta": (5, 2),
        "lit": (5,),
        "point_m": (5, 3),
        "offset_s": (5, 2),
        "angular_rate": (3,),
        "velocity": (3,),
    }
    shapes[argument] = (*shapes[argument], 1)
    with pytest.raises(ValueError, match=argument):
        cold_start(**{name: np.ones(shape) for name, shape in shapes.items()})  # type: ignore[arg-type]


def test_candidates_are_the_same_bit_for_bit_alone_and_in_company_and_with_padding() -> None:
    """Also those of planes and lines, with any number lit, in more craft than are started side by side."""
    rng = np.random.default_rng(12)
    d = draw(rng, 300, 1.0, 8.0, fewest=4)
    lit, point = d.lit & (rng.random(d.lit.shape) < 0.9), d.point.copy()
    point[::7, :, 2] = 0.0
    point[::31, :, 1:] = 0.0
    offset, rate, velocity = rng.normal(0, 1e-3, (300, 12, 2)), rng.normal(size=(300, 3)), rng.normal(size=(300, 3))
    theta = angles(d.rotation, d.position, point, offset, rate, velocity) + angle_errors(rng, 300, 12)
    together = cold_starts(theta, lit, point, offset, rate, velocity)
    counts = []
    for c in range(0, 300, 3):
        seen = lit[c]
        alone = cold_start(theta[c, seen], seen[seen], point[c, seen], offset[c, seen], rate[c], velocity[c])
        for one, other in zip(alone, together[c], strict=True):
            np.testing.assert_array_equal(one, other)
        counts.append(len(alone.cost))
    assert {0, 1, 2} <= set(counts)
