"""Held-out poses: the residual that noise alone leaves, by Monte Carlo, and one that it does not."""

import numpy as np
import pytest
from synthetic_survey import LAYOUT, NOISE, PERFECT, REAL, survey

from estimators.calibration.check import Sightings, solve_poses
from estimators.calibration.model import linear_fans
from estimators.calibration.problem import Noise

POSES = 600


def sightings(noise: Noise, seed: int = 1):
    made, truth = survey(POSES, noise=noise, seed=seed)
    theta, offset = np.full((POSES, len(LAYOUT), 2), np.nan), np.zeros((POSES, len(LAYOUT), 2))
    theta[made.pose, made.photodiode, made.fan] = made.theta
    offset[made.pose, made.photodiode, made.fan] = made.offset_s
    return Sightings(theta, np.isfinite(theta).all(axis=2), offset, made.angular_rate, made.velocity), made, truth


@pytest.mark.parametrize("noise", [NOISE, Noise(30e-6, 0.0), Noise(5e-6, 80e-6)])
def test_the_ratio_is_one_where_noise_is_all_that_is_left(noise):
    seen, made, truth = sightings(noise)
    points = np.broadcast_to(truth.point_m, (POSES, *truth.point_m.shape))
    fit = solve_poses(seen, linear_fans(REAL), points, made.rotation, made.position, noise)
    assert fit.pose.solved.mean() > 0.98
    # 600 poses with some 8 degrees of freedom each: 1 sigma of the ratio is 1 / sqrt(2 x 4800), 1 %. What W and the
    # systematic errors' slopes change of the noise stays below 2 %.
    assert fit.ratio == pytest.approx(1, abs=0.05)
    assert fit.median_ratio == pytest.approx(fit.ratio, abs=0.1)


def test_what_is_not_noise_shows():
    seen, made, truth = sightings(NOISE)
    points = np.broadcast_to(truth.point_m, (POSES, *truth.point_m.shape))
    uncalibrated = solve_poses(seen, linear_fans(PERFECT), points, made.rotation, made.position, NOISE)
    drawn = np.broadcast_to(LAYOUT, points.shape)
    misplaced = solve_poses(seen, linear_fans(REAL), drawn, made.rotation, made.position, NOISE)
    assert uncalibrated.ratio > 1.5
    assert misplaced.ratio > 5


def test_a_pose_without_a_start_is_left_out():
    seen, made, truth = sightings(NOISE)
    position = made.position.copy()
    position[::2] = np.nan
    points = np.broadcast_to(truth.point_m, (POSES, *truth.point_m.shape))
    fit = solve_poses(seen, linear_fans(REAL), points, made.rotation, position, NOISE)
    assert not fit.pose.solved[::2].any()
    assert np.isnan(fit.expected[::2]).all()
    nothing = solve_poses(seen, linear_fans(REAL), points, made.rotation, np.full_like(position, np.nan), NOISE)
    assert np.isnan(nothing.ratio)
    assert np.isnan(nothing.median_ratio)
