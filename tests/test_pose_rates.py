"""Rates by straight lines through neighbouring poses."""

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.calibration.pose_rates import pose_rates

T = 1 / 60


def steady(count: int = 40, acceleration: float = 0.0):
    time = T * np.arange(count)
    rate, velocity = np.array([0.3, -0.5, 0.8]), np.array([0.2, 0.1, -0.3])
    start = rot.exp(np.array([1.0, 2.0, -0.5]))
    rotation = rot.exp(time[:, None] * rate) @ start
    position = time[:, None] * velocity + 0.5 * acceleration * time[:, None] ** 2 + np.array([0, 0, 2.0])
    return time, rotation, position, rate, velocity


def test_a_steady_motion_is_found_to_rounding():
    time, rotation, position, rate, velocity = steady()
    found_rate, found_velocity = pose_rates(time, rotation, position)
    np.testing.assert_allclose(found_rate, np.tile(rate, (40, 1)), atol=1e-12)
    np.testing.assert_allclose(found_velocity, np.tile(velocity, (40, 1)), atol=1e-12)


def test_an_acceleration_does_no_harm_where_neighbours_lie_on_both_sides():
    time, rotation, position, _, velocity = steady(acceleration=2.0)
    found = pose_rates(time, rotation, position)[1]
    true = velocity + 2.0 * time[:, None]
    np.testing.assert_allclose(found[6:-6], true[6:-6], atol=1e-12)
    assert np.abs(found[0] - true[0]).max() > 0.05


def test_noise_comes_through_as_said():
    random = np.random.default_rng(1)
    time, rotation, position, _, velocity = steady(2000)
    found = pose_rates(time, rotation, position + 1e-3 * random.standard_normal(position.shape))[1][6:-6]
    # 13 poses; errors of neighbours are alike, so that some 2000 / 13 x 3 are independent: 5 % for 1 sigma.
    assert (found - velocity).std() == pytest.approx(1e-3 * np.sqrt(12) / (T * 13**1.5), rel=0.15)


def test_unknown_poses_are_no_neighbours_and_too_few_give_none():
    time, rotation, position, _, velocity = steady()
    position[10:30] = np.nan
    found_rate, found = pose_rates(time, rotation, position)
    assert np.isfinite(found[:10]).all()
    assert np.isnan(found[10:30]).all()
    assert np.isnan(found_rate[10:30]).all()
    np.testing.assert_allclose(found[:10], np.tile(velocity, (10, 1)), atol=1e-12)
    assert np.isnan(pose_rates(time[:2], rotation[:2], position[:2])[1]).all()


def test_mistakes_are_named():
    time, rotation, position, _, _ = steady(5)
    with pytest.raises(ValueError, match="must increase"):
        pose_rates(time[::-1], rotation, position)
    with pytest.raises(ValueError, match="5 times, but"):
        pose_rates(time, rotation, position[:3])
