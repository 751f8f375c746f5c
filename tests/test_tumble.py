"""Free tumbling of a body of unknown inertia: what a minute of attitudes tells, and what follows in the dark."""

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.filter.tumble import PARTS, Tumble, tensors
from estimators.free_rotation import free_turns

MOMENTS = np.array([32.0, 16.0, 26.0])
SIGMA_RAD, PERIOD_S = np.radians(0.15), 0.25


def turned(rotation, rate, time_s):
    """Attitude and rate after a time, by Euler's equation."""
    tensor = np.diag(MOMENTS)[None]
    one = np.ones(1, dtype=np.bool_)
    number = max(1, round(time_s / 0.125))
    for _ in range(number):
        dt = time_s / number
        moved = free_turns(one, rotation[None], rate[None], tensor, np.linalg.inv(tensor), dt)
        rotation, rate = rot.exp(moved.turn[0]) @ rot.exp(rate * dt) @ rotation, rate + moved.rate[0]
    return rotation, rate


def followed(rate_deg_s, scans, seed=0, observers=1, period_s=PERIOD_S):
    """A body that each observer has scanned so many times: its estimate, its attitude and its rate."""
    rng = np.random.default_rng(seed)
    rotation = rot.exp(rng.standard_normal(3))
    rate = rotation @ np.radians(rate_deg_s)
    covariance = SIGMA_RAD**2 * np.eye(3)
    known = Tumble(rot.exp(SIGMA_RAD * rng.standard_normal(3)) @ rotation, covariance, 0.3)
    for _ in range(scans):
        rotation, rate = turned(rotation, rate, period_s)
        known.predict(period_s)
        for _ in range(observers):
            assert known.update(rot.exp(SIGMA_RAD * rng.standard_normal(3)) @ rotation, covariance)
    return known, rotation, rate


def test_ten_seconds_in_the_dark_are_within_three_sigma():
    """After 30 s all ratios of inertia are known, and ten seconds later the attitude to a degree and a half."""
    known, rotation, rate = followed([3.0, -2.0, 4.0], 120)
    found = known.inertia()
    true = 3 * np.sort(MOMENTS) / MOMENTS.sum()
    assert found.observed == PARTS
    assert np.all(np.abs(found.moments - true) < 3 * found.sigma * true)
    assert np.all(found.sigma < 0.15)
    steady = rot.exp(rate * 10.0) @ rotation
    rotation, rate = turned(rotation, rate, 10.0)
    known.predict(10.0)
    off = rot.log(rotation @ known.rotation.T)
    assert off @ np.linalg.solve(known.covariance[:3, :3], off) < 3**2 + 5.0, "99.7 % of three degrees of freedom"
    assert known.sigma_rad < np.radians(1.5)
    # What constant rates would say is several times as far off.
    assert rot.angle_between(steady, rotation) > 4 * np.linalg.norm(off)
    assert not known.update(rot.exp(np.array([0.0, 0.0, 0.3])) @ rotation, SIGMA_RAD**2 * np.eye(3))
    assert known.update(rotation, SIGMA_RAD**2 * np.eye(3))


@pytest.mark.parametrize("seed", range(4))
def test_several_observers_know_no_sooner_what_only_time_tells(seed):
    """Three of them have 240 attitudes after 8 s, and a third of a turn: all must be filtered again long after it."""
    known, _, _ = followed([3.0, -2.0, 4.0], 250, seed, observers=3, period_s=0.1)
    found, true = known.inertia(), 3 * np.sort(MOMENTS) / MOMENTS.sum()
    assert np.all(np.abs(found.moments - true) < 3 * found.sigma * true)
    assert np.all(found.sigma < 0.35), "not by saying that nothing is known"


def test_a_turn_about_a_principal_axis_does_not_tell_all_ratios():
    known, _, rate = followed([0.0, 4.0, 0.0], 60)
    found = known.inertia()
    assert known.angular_rate == pytest.approx(rate, abs=np.radians(0.2))
    assert found.observed < PARTS
    assert found.share[-1] > 0.9
    assert np.trace(found.tensor) == pytest.approx(3.0)


def test_tensors_are_inverse_and_without_parts_a_sphere():
    parts = np.vstack([np.zeros(PARTS), np.random.default_rng(0).standard_normal((3, PARTS))])
    tensor, inverse = tensors(parts)
    assert tensor @ inverse == pytest.approx(np.tile(np.eye(3), (4, 1, 1)), abs=1e-12)
    assert tensor[0] == pytest.approx(np.eye(3))
    assert np.linalg.det(tensor) == pytest.approx(np.ones(4))
