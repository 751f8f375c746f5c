"""The survey of a synthetic room: stations within their sigmas, honest sigmas, moves, mirrors, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from synthetic_room import FIRST, PLANE, SECOND, Room, light, relative, room

from estimators import rotation as rot
from estimators.lighthouse.sweep import FanErrors, lighthouse_1, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from estimators.survey.problem import Free, Problem, Truth, room_of
from estimators.survey.rays import directions
from estimators.survey.solve import solve
from estimators.survey.survey import Surveyed, Unsolvable, disagreement, survey, with_truth
from estimators.survey.terms import PARTS, errors_of, numbers


def error(found: Surveyed, truth: Room, station: int) -> np.ndarray:
    """Error of a station's pose in the first one's frame, (6,)."""
    turn, place = relative(truth.rotation, truth.position)
    d = rot.log((found.room.rotation[station] @ turn[station].T)[None])[0]
    return np.concatenate([d, found.room.position[station] - place[station]])


def test_stations_of_both_generations_are_found() -> None:
    where = room((FIRST, SECOND, FIRST))
    rows, moving = light(where, np.random.default_rng(3), 6)
    found = survey(rows, moving, where.errors, time_s=np.arange(6.0))
    assert found.placed.all()
    assert found.used.all()
    assert not found.steps
    for s in (1, 2):
        sigma = np.concatenate([found.rotation_sigma(s), found.position_sigma(s)])
        assert np.all(np.abs(error(found, where, s)) < 4 * sigma)  # 12 normal values: 1 in 1300
        assert np.linalg.norm(sigma[3:]) < 0.01
    apart, turned = disagreement(found)
    # Each station alone tells range by an object of 10 cm at 3 m to some millimetres.
    assert np.nanmedian(apart) < 0.02
    assert np.nanmedian(turned) < 0.02


@pytest.mark.long
def test_sigmas_are_honest() -> None:
    where = room((SECOND, SECOND))
    nees = []
    for seed in range(8):
        rows, moving = light(where, np.random.default_rng(seed), 4)
        found = survey(rows, moving, where.errors)
        e = error(found, where, 1)
        nees.append(float(e @ np.linalg.solve(found.covariance[6:12, 6:12], e)))
    # Chi-square of 48 degrees of freedom, 1 in 1000 on either side.
    low, high = chi2.ppf([0.001, 0.999], 48)
    assert low < np.sum(nees) < high


def test_a_crazyflies_deck_is_enough() -> None:
    where = room((SECOND, SECOND))
    rows, moving = light(where, np.random.default_rng(1), 8, own=3e-6, shared=0.0, moving=False, point=PLANE)
    found = survey(rows, moving, where.errors)
    sigma = np.concatenate([found.rotation_sigma(1), found.position_sigma(1)])
    assert np.all(np.abs(error(found, where, 1)) < 4 * sigma)
    assert np.linalg.norm(sigma[3:]) < 0.02


@pytest.mark.long
def test_systematic_errors_are_found_and_believed() -> None:
    where = room((SECOND, SECOND))
    rows, moving = light(where, np.random.default_rng(5), 8, own=1e-4, shared=0.0, moving=False)
    told = rows._replace(own=np.full(len(rows.own), 1e-6))
    found = survey(told, moving, where.errors)
    # 512 angles less 54 unknowns: 3 %; Cauchy's weights make of it some 5 %, and cost 10 % of the variance.
    assert found.systematic_rad == pytest.approx(1e-4, rel=0.15)


def test_a_station_that_moved_is_found() -> None:
    before = room((FIRST, SECOND, SECOND))
    shift, turn = np.array([0.004, -0.01, 0.006]), np.radians([0.3, -0.2, 0.4])
    after = before._replace(
        rotation=np.array([before.rotation[0], rot.exp(turn[None])[0] @ before.rotation[1], before.rotation[2]]),
        position=before.position + np.array([[0, 0, 0], [1, 1, 1], [0, 0, 0]]) * shift,
    )
    first, _ = light(before, np.random.default_rng(1), 4)
    second, _ = light(after, np.random.default_rng(2), 5)
    rows = first._replace(
        **{
            name: np.concatenate([getattr(first, name), getattr(second, name) + add])
            for name, add in zip(first._fields, (0, 0, 4, 0.0, 0.0, 0.0, 0.0, 0.0, 10_000, 0), strict=True)
        }
    )
    found = survey(rows, np.full(9, True), before.errors, time_s=np.arange(9.0))
    assert [(step.station, step.window) for step in found.steps] == [(1, 4)]
    place = found.room.position[3] - found.room.position[1]
    # Along the first station's axes; sigmas of both places are some 2 mm.
    np.testing.assert_allclose(place, shift @ before.rotation[0], atol=0.008)
    for s, there in ((1, before), (3, after)):
        grown = [np.insert(part, 3, part[1], axis=0) for part in (there.rotation, there.position)]
        e = error(found, Room(grown[0], grown[1], there.errors), s)
        sigma = np.concatenate([found.rotation_sigma(s), found.position_sigma(s)])
        assert np.all(np.abs(e) < 4.5 * sigma)


def test_truth_fixes_frame_and_scale() -> None:
    where = room((SECOND, SECOND))
    rows, moving = light(where, np.random.default_rng(4), 8, own=2e-5, shared=0.0, moving=False, point=1.01 * PLANE)
    # The deck is believed 1 % smaller than it is, so all is found 1 % too near, but for the truth.
    rows = rows._replace(point=rows.point / 1.01)
    plain = survey(rows, moving, where.errors)
    known = solve(
        Problem(rows, moving, Free(np.zeros(2, dtype=np.bool_)), plain.room), replace(plain.room)
    ).room.window_position
    far = float(np.linalg.norm(where.position[1] - where.position[0]))
    assert np.linalg.norm(plain.room.position[1]) == pytest.approx(far / 1.01, rel=3e-3)
    lever = np.array([0.0, 0.01, 0.02])
    place = known * 1.01 + plain.room.window_rotation @ lever
    joined = with_truth(plain, Truth(place, np.zeros(8, dtype=np.int64), 1e-4), np.eye(3), np.zeros(3))
    assert np.linalg.norm(joined.room.position[1] - joined.room.position[0]) == pytest.approx(far, rel=2e-3)
    assert np.all(joined.position_sigma(0) < 1e-9)
    assert 0 < np.max(joined.position_sigma(1)) < 0.02


@pytest.mark.long
def test_terms_are_adjusted_towards_the_truth() -> None:
    where = room((FIRST, FIRST))
    rows, moving = light(where, np.random.default_rng(6), 10, own=1e-5, shared=0.0, moving=False)
    wrong = tuple((x._replace(tilt_rad=x.tilt_rad + 1e-3), y) for x, y in (FIRST, FIRST))
    plain = survey(rows, moving, wrong)
    found = survey(rows, moving, wrong, parts=("tilt",))
    assert found.systematic_rad < 0.6 * plain.systematic_rad
    tilts = [numbers(found.room.errors(s)[0])[1] for s in range(2)]
    for tilt, sigma in zip(tilts, found.term_sigma[:, 0, 1], strict=True):
        assert abs(tilt - FIRST[0].tilt_rad) < 4 * sigma
        assert 0 < sigma < 8e-4  # the prior is 1e-3


def test_jacobian_is_that_of_differences() -> None:
    where = room((FIRST, SECOND))
    rows, moving = light(where, np.random.default_rng(7), 2)
    start = room_of(
        [(where.rotation[s], where.position[s], where.errors[s]) for s in (0, 1)],
        rot.exp(np.array([[0.1, 0.2, -1.0], [0.3, 0.0, 2.0]])),
        np.array([[0.2, -0.1, 0.1], [-0.3, 0.3, 0.0]]),
    )
    start = replace(start, rate=np.full((2, 3), 1e-3), velocity=np.full((2, 3), 0.2), lever=np.full((1, 3), 0.01))
    truth = Truth(np.array([[0.3, 0, 0], [np.nan, 0, 0]]), np.zeros(2, dtype=np.int64), 1e-3)
    problem = Problem(rows, moving, Free(np.array([True, True]), parts=tuple(PARTS)), start, truth)
    assert problem.size == 24 + 12 + 10 + 14 + 3
    _, matrix = problem.linearise(start)
    _, prior = problem.priors(start)
    for i in range(problem.size):
        step = np.zeros(problem.size)
        step[i] = 1e-6
        ahead, behind = problem.take(start, step), problem.take(start, -step)
        slope = -(problem.residuals(ahead) - problem.residuals(behind)) / 2e-6
        # Forward differences of 1e-6, and rates of 1e-3 rad/s whose lever is of first order only.
        np.testing.assert_allclose(matrix[:, [i]].toarray().ravel(), slope, atol=1e-4)
        slope = -(problem.priors(ahead)[0] - problem.priors(behind)[0]) / 2e-6
        np.testing.assert_allclose(prior[:, [i]].toarray().ravel(), slope, atol=1e-4)


@pytest.mark.parametrize("pair", [lighthouse_1(*FIRST), lighthouse_2(*SECOND)])
def test_directions_invert_the_fans(pair: tuple) -> None:
    rng = np.random.default_rng(0)
    uv = rng.uniform(-0.8, 0.8, (200, 2))
    angles = measured_angles(np.concatenate([uv, np.ones((200, 1))], axis=1), pair)
    np.testing.assert_allclose(directions(angles, pair), uv, atol=1e-9)
    assert np.isnan(directions(np.array([[np.nan, 0.1]]), pair)).all()


def test_terms_come_back_as_they_were() -> None:
    for errors in (*FIRST, *SECOND, FanErrors(), TiltedErrors()):
        again = errors_of(numbers(errors), errors)
        np.testing.assert_allclose(numbers(again), numbers(errors), atol=1e-15)
        assert type(again) is type(errors)
        np.testing.assert_allclose(again, errors, atol=1e-12)


def test_light_that_tells_nothing() -> None:
    where = room((FIRST, SECOND))
    rows, moving = light(where, np.random.default_rng(1), 2, moving=False)
    with pytest.raises(Unsolvable, match="four photodiodes"):
        survey(rows.of(rows.photodiode < 3), moving, where.errors)
    # Each sees the object, but never in the same window.
    alone = survey(rows.of(rows.station == rows.window), moving, where.errors)
    assert alone.placed.tolist() == [True, False]
    assert np.isinf(alone.position_sigma(1)).all()
