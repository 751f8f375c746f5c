"""Sweep angles: against hand-written equations, libsurvive's formula in its own frame, and round trips."""

import numpy as np
import pytest

from estimators.arrays import Floats
from estimators.lighthouse.sweep import (
    FanErrors,
    correct,
    direction,
    from_libsurvive,
    ideal_theta,
    kernel_fans,
    lighthouse_1,
    measured_angle,
    measured_theta,
    theta_from_time,
    time_from_theta,
)

FIELD = np.deg2rad(60.0)
TYPICAL = (FanErrors(0.05, 0.01, 0.002, 1.3, 0.01), FanErrors(-0.03, -0.008, -0.003, -2.1, -0.02))
# Factory calibration of the second station of the real recording (../shared/data/lighthouse-v1).
STATION = {
    "phase": (0.022842, 0.029099),
    "tilt": (-0.009453, -0.007851),
    "curve": (0.002314, 0.002054),
    "gibbous_phase": (1.810547, -1.176758),
    "gibbous_magnitude": (0.020615, -0.012276),
}


def points_in_field(seed: int, count: int = 2000) -> Floats:
    """Points in the whole field of 120 x 120 degrees, at 0.3 m to 20 m of depth."""
    rng = np.random.default_rng(seed)
    u = np.tan(rng.uniform(-FIELD, FIELD, (count, 2)))
    return np.column_stack([u, np.ones(count)]) * rng.uniform(0.3, 20.0, (count, 1))


def test_boresight_and_signs() -> None:
    theta = ideal_theta(np.array([[0.0, 0, 2], [1.0, 0, 1], [0.0, 1, 1]]))
    # Right of boresight (x > 0) means cot > 0: the fan comes by before pi/2; the same below (y > 0).
    np.testing.assert_allclose(theta, np.pi * np.array([[0.5, 0.5], [0.25, 0.5], [0.5, 0.25]]), atol=1e-15)


def test_ideal_theta_fulfils_equation_2_and_direction_inverts_it() -> None:
    p = points_in_field(1)
    theta = ideal_theta(p)
    np.testing.assert_allclose(1 / np.tan(theta), p[:, :2] / p[:, 2:], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(direction(theta) * p[:, 2:], p, rtol=1e-13, atol=1e-13)


def test_equation_1() -> None:
    period = 1 / 60
    np.testing.assert_allclose(theta_from_time(np.array([period / 4, period / 2]), 60.0), [np.pi / 2, np.pi])
    assert time_from_theta(np.array(np.pi / 2), 60.0) == pytest.approx(period / 4)


def test_behind_or_beside_is_nan() -> None:
    p = np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]])
    assert np.all(np.isnan(ideal_theta(p)))
    assert np.all(np.isnan(measured_theta(p, TYPICAL)))


def test_zero_errors_are_ideal() -> None:
    p = points_in_field(2)
    perfect = (FanErrors(), FanErrors())
    np.testing.assert_array_equal(measured_theta(p, perfect), ideal_theta(p))
    np.testing.assert_array_equal(correct(ideal_theta(p), perfect), ideal_theta(p))


@pytest.mark.parametrize(
    ("errors", "change"),
    [
        (FanErrors(phase_rad=0.01), -0.01),
        # At (x, y, z) = (0, 1, 1): other/r = 1, other_angle = pi/4, a = 0.
        (FanErrors(tilt_rad=0.01), -np.arcsin(np.tan(0.01))),
        (FanErrors(curve=0.002), 0.002 * (np.pi / 4) ** 2),
        (FanErrors(gibbous_phase_rad=0.3, gibbous_magnitude=0.01), 0.01 * np.sin(0.3)),
    ],
)
def test_sign_of_every_term(errors: FanErrors, change: float) -> None:
    p = np.array([0.0, 1.0, 1.0])
    theta = measured_theta(p, (errors, FanErrors()))
    # A rounding error of pi/2.
    assert theta[0] - np.pi / 2 == pytest.approx(change, abs=4e-16)
    assert theta[1] == pytest.approx(np.pi / 4, abs=4e-16)


def libsurvive(point: Floats, axis: int) -> float:
    """libsurvive's own equations, in its own frame (x right, y up, looking along -z)."""
    x, y, forward = point[0], point[1], -point[2]
    along, other, sign = (x, y, -1) if axis == 0 else (y, x, 1)
    a = np.pi / 2 + sign * np.arctan2(along, forward) - STATION["phase"][axis]
    a -= np.arcsin(STATION["tilt"][axis] * other / np.hypot(along, forward))
    a -= STATION["gibbous_magnitude"][axis] * np.cos(STATION["gibbous_phase"][axis] + a)
    a += STATION["curve"][axis] * np.arctan2(other, forward) ** 2
    return float(a - np.pi / 2)


def test_from_libsurvive_measures_the_same_angles() -> None:
    p = points_in_field(3)
    in_their_frame = p * [1, -1, -1]
    expected = np.array([[libsurvive(q, 0), libsurvive(q, 1)] for q in in_their_frame])
    # Both are some ten rounded operations on angles below 2 rad.
    np.testing.assert_allclose(measured_theta(p, from_libsurvive(**STATION)) - np.pi / 2, expected, atol=5e-15)


@pytest.mark.parametrize("errors", [TYPICAL, from_libsurvive(**STATION)])
def test_correct_inverts_the_model(errors: tuple[FanErrors, FanErrors]) -> None:
    p = points_in_field(4).reshape(40, 50, 3)
    np.testing.assert_allclose(correct(measured_theta(p, errors), errors), ideal_theta(p), rtol=0, atol=1e-12)


def test_correct_gives_nan_without_an_answer() -> None:
    theta = np.array([[1.5, np.nan], [1.5, 1.6], [-0.2, 1.5]])
    ideal = correct(theta, TYPICAL)
    assert np.isnan(ideal).tolist() == [[True, True], [False, False], [True, True]]
    # Slopes above one: the iteration cannot settle, and says so.
    wild = (FanErrors(gibbous_magnitude=1.9), FanErrors(gibbous_magnitude=1.9))
    assert np.all(np.isnan(correct(np.array([2.4, 2.4]), wild)))


def test_out_of_reach_of_a_tilted_fan_is_nan_not_clipped() -> None:
    steep = (FanErrors(tilt_rad=1.0), FanErrors())
    theta = measured_theta(np.array([0.0, 1.0, 1.0]), steep)
    assert np.isnan(theta[0])
    assert np.isnan(measured_angle(0.0, 1.0, 1.0, kernel_fans(lighthouse_1(*steep))[0]))
    assert np.isfinite(theta[1])


@pytest.mark.parametrize("errors", [(FanErrors(), FanErrors()), TYPICAL])
def test_kernel_equals_numpy(errors: tuple[FanErrors, FanErrors]) -> None:
    p = points_in_field(5, 200)
    theta = measured_theta(p, errors)
    fans = kernel_fans(lighthouse_1(*errors))
    angles = np.array([[measured_angle(x, y, z, fan) for fan in fans] for x, y, z in p.tolist()])
    np.testing.assert_allclose(angles, theta - np.pi / 2, rtol=0, atol=2e-15)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"\(\.\.\., 3\)"):
        ideal_theta(np.zeros((5, 2)))
    with pytest.raises(ValueError, match=r"\(\.\.\., 2\)"):
        correct(np.zeros((5, 3)), TYPICAL)
