"""Rows: the residual against the sweep model step by step, and its matrix against finite differences."""

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.rows import AT_ORIGIN, Rows, Station, linearise, packed
from estimators.lighthouse.sweep import (
    LIGHTHOUSE_1,
    Fan,
    FanErrors,
    ideal_theta,
    kernel_fans,
    lighthouse_1,
    lighthouse_2,
    measured_angle,
    measured_angles,
)
from estimators.lighthouse.tilted import TiltedErrors

TILT = np.radians(30.0)
ERRORS = FanErrors(0.02, 0.03, 0.2, 1.3, 0.01), FanErrors(-0.03, -0.02, -0.3, -2.1, -0.02)
STRAIGHT = lighthouse_1(*ERRORS)
# Two planes on one rotor whose axis points up (-y), 30 degrees to either side: Lighthouse 2.0.
TILTED = Fan((0.0, -1.0, 0.0), -TILT, ERRORS[0]), Fan((0.0, -1.0, 0.0), TILT, ERRORS[1])
# The same with the terms of a real station of that kind, ten times as bent.
BENT = lighthouse_2(
    TiltedErrors(0.01, 0.05, -3.6, 2.7, 0.007, 1.2, -2.9), TiltedErrors(0.003, -0.05, 4.2, 1.0, -0.016, 2.0, -2.8)
)
AHEAD = np.array([0.0, 0.0, 3.0])
POINT = np.random.default_rng(0).uniform(-0.1, 0.1, (6, 3))


class Craft:
    """One craft before two stations that stand askew in the world, and its rows: every fan sees every photodiode."""

    def __init__(self, fans: tuple[Fan, Fan], seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.rotation = rot.exp(rng.uniform(-2, 2, 3))
        self.position = rng.uniform(-0.3, 0.3, 3) + AHEAD
        self.velocity, self.angular_rate = rng.uniform(-0.3, 0.3, 3), rng.uniform(-4, 4, 3)
        turn = rot.exp(np.array([0.0, -0.6, 0.3]))
        self.stations = [
            Station(np.eye(3), np.zeros(3), fans),
            Station(turn, np.array([1.5, -0.5, 0.2]), fans),
        ]
        index = np.array([(s, f, k) for s in (0, 1) for f in (0, 1) for k in range(len(POINT))])
        count = len(index)
        offset, angle = rng.uniform(-4e-3, 4e-3, count), rng.uniform(-0.3, 0.3, count)
        self.rows = Rows(index[:, 0], index[:, 1], index[:, 2], np.zeros_like(index[:, 0]), offset, angle)

    def moved(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the state (rotation, position, velocity, angular rate) in error by x (12,)."""
        turned = rot.exp(x[:3]) @ self.rotation
        return turned, self.position + x[6:9], self.velocity + x[9:], self.angular_rate + x[3:6]

    def residual(self, x: Floats) -> Floats:
        return linearise(self.rows, packed(self.stations), POINT, *self.moved(x)).residual


@pytest.mark.parametrize("fans", [LIGHTHOUSE_1, STRAIGHT, TILTED, BENT])
@pytest.mark.parametrize("seed", range(5))
def test_residual_is_the_sweep_model_in_the_stations_frame(fans: tuple[Fan, Fan], seed: int) -> None:
    craft = Craft(fans, seed)
    for n, y in enumerate(craft.residual(np.zeros(12))):
        tau, station = craft.rows.offset_s[n], craft.stations[craft.rows.station[n]]
        arm = rot.exp(craft.angular_rate * tau) @ craft.rotation @ POINT[craft.rows.photodiode[n]]
        q = station.rotation.T @ (craft.position + craft.velocity * tau + arm - station.position)
        expected = measured_angles(q, station.fans)[craft.rows.fan[n]]
        # Some ten rounded operations on angles below 2 rad.
        assert craft.rows.angle[n] - expected == pytest.approx(y, abs=5e-15)


@pytest.mark.parametrize("fans", [LIGHTHOUSE_1, STRAIGHT, TILTED, BENT])
@pytest.mark.parametrize("seed", range(5))
def test_matrix_by_finite_differences(fans: tuple[Fan, Fan], seed: int) -> None:
    craft, step = Craft(fans, seed), 1e-5
    matrix = linearise(craft.rows, packed(craft.stations), POINT, *craft.moved(np.zeros(12))).matrix
    # Moving the estimate by x lowers the error by x: y changes by -H x.
    columns = [(craft.residual(-step * e) - craft.residual(step * e)) / (2 * step) for e in np.eye(12)]
    # Third derivatives are below 10 rad/m^3: step^2 of it, and rounding of 1e-16 over the step.
    np.testing.assert_allclose(matrix, np.stack(columns, axis=1), rtol=0, atol=1e-9)


def test_tilted_fans_are_planes_through_the_station() -> None:
    # A plane tilted by t about boresight, turned about the axis by alpha: its points are u + s d of the turned lines.
    rng = np.random.default_rng(3)
    alpha, height, way = rng.uniform(-0.8, 0.8, 50), rng.uniform(-0.5, 0.5, 50), rng.uniform(1.0, 4.0, 50)
    up, ahead, across = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([-1.0, 0.0, 0.0])
    for sign in (-1, 1):
        fan = Fan((0.0, -1.0, 0.0), sign * TILT)
        for a, h, r in zip(alpha, height, way, strict=True):
            # In the plane before it turns: r ahead, h along the tilted direction, which leans back against the turn.
            p = r * ahead + h * (np.cos(TILT) * up - sign * np.sin(TILT) * across)
            turned = rot.exp(a * up) @ p
            np.testing.assert_allclose(measured_angles(turned, [fan]), [a], rtol=0, atol=1e-15)


def test_two_tilted_planes_give_the_ideal_azimuth_and_elevation() -> None:
    p = np.random.default_rng(4).uniform(-1, 1, (200, 3)) + AHEAD
    first, second = measured_angles(p, [Fan((0.0, -1.0, 0.0), -TILT), Fan((0.0, -1.0, 0.0), TILT)]).T
    np.testing.assert_allclose((first + second) / 2, np.arctan2(-p[:, 0], p[:, 2]), rtol=0, atol=1e-14)
    tangent = np.sin(second - first) / (np.tan(TILT) * (np.cos(first) + np.cos(second)))
    np.testing.assert_allclose(tangent, -p[:, 1] / p[:, 2], rtol=0, atol=1e-14)


@pytest.mark.parametrize("fans", [LIGHTHOUSE_1, STRAIGHT, TILTED, BENT])
def test_kernel_equals_the_array_form(fans: tuple[Fan, Fan]) -> None:
    p = np.random.default_rng(5).uniform(-1, 1, (200, 3)) + AHEAD
    angles = [[measured_angle(q[0], q[1], q[2], fan) for fan in kernel_fans(fans)] for q in p]
    np.testing.assert_allclose(angles, measured_angles(p, fans), rtol=0, atol=3e-15)


def test_one_station_at_the_origin_measures_lighthouse_1() -> None:
    craft = Craft(LIGHTHOUSE_1, 7)
    p, here = craft.position + craft.rotation @ POINT[2], np.array([0, 0])
    rows = Rows(here, np.array([0, 1]), here + 2, here, np.zeros(2), ideal_theta(p) - np.pi / 2)
    linear = linearise(rows, packed([AT_ORIGIN]), POINT, *craft.moved(np.zeros(12)))
    np.testing.assert_allclose(linear.residual, 0, atol=2e-16)


def test_behind_the_station_is_nan() -> None:
    craft = Craft(LIGHTHOUSE_1, 8)
    craft.position[2] = -3.0
    linear = linearise(craft.rows, packed(craft.stations[:1] * 2), POINT, *craft.moved(np.zeros(12)))
    assert np.isnan(linear.residual).all()
    assert np.isnan(linear.matrix).all()


def test_mistakes_are_told() -> None:
    craft = Craft(LIGHTHOUSE_1, 9)
    state = craft.moved(np.zeros(12))
    with pytest.raises(ValueError, match="station"):
        linearise(craft.rows, packed(craft.stations[:1]), POINT, *state)
    with pytest.raises(ValueError, match="photodiode"):
        linearise(craft.rows, packed(craft.stations), POINT[:3], *state)
    with pytest.raises(ValueError, match="fan"):
        linearise(craft.rows._replace(fan=craft.rows.fan + 1), packed(craft.stations), POINT, *state)
    with pytest.raises(ValueError, match="offset_s"):
        linearise(craft.rows._replace(offset_s=np.zeros(3)), packed(craft.stations), POINT, *state)
    with pytest.raises(ValueError, match="axis"):
        kernel_fans([Fan((0.0, 0.6, 0.8))])
