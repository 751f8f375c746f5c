"""The calibration's forward model against `estimators.lighthouse.sweep`, its slopes against finite differences."""

import numpy as np
import pytest
from synthetic_survey import PERFECT, REAL

from estimators.calibration.model import fan_errors, gibbous_sigma, linear_fans, place, predict
from estimators.lighthouse.sweep import FanErrors, measured_theta


def points(count: int = 200) -> np.ndarray:
    random = np.random.default_rng(2)
    return random.uniform([-2, -2, 0.8], [2, 2, 4], (count, 3))


@pytest.mark.parametrize("fans", [PERFECT, REAL, (REAL[0], FanErrors(gibbous_magnitude=0.01))])
def test_it_predicts_what_the_sweep_model_measures(fans):
    at = points()
    expected = measured_theta(at, fans) - np.pi / 2
    for fan in (0, 1):
        got = predict(at, np.full(len(at), fan), linear_fans(fans)).angle
        # A dozen operations on angles of order one.
        np.testing.assert_allclose(got, expected[:, fan], rtol=0, atol=1e-14)


@pytest.mark.parametrize("fan", [0, 1])
@pytest.mark.parametrize("fans", [PERFECT, REAL])
def test_slopes_are_those_of_finite_differences(fans, fan):
    at, numbers, step = points(), linear_fans(fans), 1e-6
    which = np.full(len(at), fan)
    slopes = predict(at, which, numbers)
    # Central differences: error step^2 times a third derivative (below 10 here), and rounding 1e-16 / step.
    for k in range(3):
        move = step * np.eye(3)[k]
        numeric = (predict(at + move, which, numbers).angle - predict(at - move, which, numbers).angle) / (2 * step)
        np.testing.assert_allclose(slopes.point[:, k], numeric, rtol=0, atol=1e-9)
    for k in range(5):
        move = np.zeros((2, 5))
        move[fan, k] = step
        numeric = (predict(at, which, numbers + move).angle - predict(at, which, numbers - move).angle) / (2 * step)
        np.testing.assert_allclose(slopes.fan[:, k], numeric, rtol=0, atol=1e-9)


def test_the_gibbous_term_has_a_slope_where_it_vanishes():
    slopes = predict(points(), np.zeros(200, dtype=np.int64), np.zeros((2, 5)))
    assert np.abs(slopes.fan[:, 3:]).max(axis=0).min() > 0.5


def test_behind_the_lighthouse_there_is_no_angle():
    behind = np.array([[0.1, 0.2, -1.0], [0.0, 0.0, 0.0]])
    assert np.isnan(predict(behind, np.zeros(2, dtype=np.int64), np.zeros((2, 5))).angle).all()


def test_fans_go_round_through_their_linear_numbers():
    back = fan_errors(linear_fans(REAL))
    np.testing.assert_allclose(np.array(back), np.array(REAL), rtol=0, atol=1e-15)
    # A negative magnitude is the same fan half a turn on.
    twin = REAL[0]._replace(gibbous_magnitude=-0.01, gibbous_phase_rad=0.5)
    same = fan_errors(linear_fans((twin, twin)))[0]
    assert same.gibbous_magnitude == pytest.approx(0.01)
    assert same.gibbous_phase_rad == pytest.approx(0.5 - np.pi)


def test_the_gibbous_sigmas_are_those_of_a_sample():
    random = np.random.default_rng(5)
    covariance = 1e-8 * np.array([[4.0, 1.0], [1.0, 2.0]])
    sample = random.multivariate_normal([0.008, -0.005], covariance, 20_000)
    phase, magnitude = gibbous_sigma(0.008, -0.005, covariance)
    # 1 sigma of a sample's standard deviation is 0.5 % of it; the second order adds (sigma / magnitude)^2, below 0.1 %.
    assert np.arctan2(sample[:, 1], sample[:, 0]).std() == pytest.approx(phase, rel=0.02)
    assert np.hypot(*sample.T).std() == pytest.approx(magnitude, rel=0.02)


def test_where_there_is_no_gibbous_term_its_phase_is_unknown():
    phase, magnitude = gibbous_sigma(0.0, 0.0, 1e-8 * np.eye(2))
    assert phase == pytest.approx(np.pi / np.sqrt(3))
    assert magnitude == pytest.approx(1e-4)


def test_a_photodiode_is_placed_at_its_angles_own_instant():
    quarter = np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    at, turn, arm = place(
        np.array([[0.1, 0, 0]]),
        quarter,
        np.array([[1.0, 2, 3]]),
        np.array([[0, 0, np.pi]]),
        np.array([[1.0, 0, 0]]),
        np.array([0.5]),
    )
    np.testing.assert_allclose(arm, [[0, 0.1, 0]], atol=1e-15)
    np.testing.assert_allclose(turn, quarter, atol=1e-15)
    np.testing.assert_allclose(at, [[1.4, 2, 3]], atol=1e-15)
