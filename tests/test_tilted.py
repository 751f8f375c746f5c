"""The error terms of Lighthouse 2.0: against libsurvive's and Bitcraze's formulas, in their own frames."""

import math

import numpy as np
import pytest

from estimators.arrays import Floats
from estimators.lighthouse.sweep import LIGHTHOUSE_2, Fan, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TILT_RAD, TiltedErrors, from_station

# Factory calibration of the first station of the real recording (../shared/data/lighthouse-v2), by plane.
STATION = (
    (0.0, -0.047119, 0.154785, 2.369141, -0.004402, 0.476562, -0.176636),
    (-0.00742, 0.04599, 0.326416, 2.714844, -0.003576, 0.965332, -0.218994),
)
FANS = lighthouse_2(from_station(*STATION[0]), from_station(*STATION[1]))


def points(seed: int, count: int = 200) -> Floats:
    """Points in a field of 100 x 80 degrees, 0.5 m to 8 m away."""
    rng = np.random.default_rng(seed)
    u = np.tan(np.radians([50.0, 40.0]) * rng.uniform(-1, 1, (count, 2)))
    return np.column_stack([u, np.ones(count)]) * rng.uniform(0.5, 8.0, (count, 1))


def libsurvives(point: Floats, plane: int) -> float:
    """Return libsurvive's angle of a point of our frame, in its own: x right, y up, looking along -z."""
    phase, tilt, curve, gibbous_phase, gibbous, ogee_phase, ogee = STATION[plane]
    x, y, ahead = point[0], -point[1], point[2]
    whole = tilt + (math.pi / 6 if plane == 0 else -math.pi / 6)
    azimuth = math.atan2(ahead, x)
    ideal = math.tan(whole) * y / math.hypot(x, ahead)
    within = math.asin(y / math.sqrt(x * x + y * y + ahead * ahead) / math.cos(whole))
    value, slope = 0.0, 0.0
    for factor in (-8.0108022e-06, 0.0028679863, 5.3685255e-06, 0.0076069798, 0.0, 0.0):
        slope = slope * within + value
        value = value * within + factor
    weight = curve + ogee * math.sin(azimuth - math.asin(ideal) + ogee_phase)
    bent = ideal + value * weight / (math.cos(whole) - slope * weight * math.sin(whole))
    turned = azimuth - math.asin(bent)
    return turned + gibbous * math.sin(turned + gibbous_phase) - phase - math.pi / 2


def test_equals_libsurvives_formula() -> None:
    p = points(1)
    found = measured_angles(p, FANS)
    for q, angles in zip(p, found, strict=True):
        np.testing.assert_allclose(angles, [libsurvives(q, 0), libsurvives(q, 1)], rtol=0, atol=1e-14)


def test_without_curve_and_ogee_bitcrazes_formula_is_near() -> None:
    """The firmware evaluates the gibbous term at the azimuth instead, 4 mrad times sin of at most 50 degrees."""
    p = points(2)
    without = [errors._replace(curve=0.0, ogee_magnitude=0.0) for errors in (from_station(*s) for s in STATION)]
    found = measured_angles(p, lighthouse_2(without[0], without[1]))
    x, y, z = p[:, 2], -p[:, 0], -p[:, 1]
    for plane, (phase, tilt, _, gibbous_phase, gibbous, _, _) in enumerate(STATION):
        turned = np.arctan2(y, x)
        t = math.pi / 6 * (-1, 1)[plane]
        theirs = turned + np.arcsin(z * math.tan(t - tilt) / np.hypot(x, y)) - phase
        theirs += gibbous * np.cos(turned + gibbous_phase)
        away = np.abs(found[:, plane] - theirs)
        assert away.max() < abs(gibbous)
        assert np.median(away) < 0.2 * abs(gibbous)


def test_a_perfect_station_has_two_ideal_planes() -> None:
    p = points(3)
    ideal = [Fan((0.0, -1.0, 0.0), -TILT_RAD), Fan((0.0, -1.0, 0.0), TILT_RAD)]
    np.testing.assert_allclose(measured_angles(p, LIGHTHOUSE_2), measured_angles(p, ideal), rtol=0, atol=1e-15)


def test_every_term_has_the_size_that_the_factory_gives_it() -> None:
    """Curve and ogee of 0.4 bend a plane by less than 2 mrad within 40 degrees: their unit is the series."""
    p = points(4)
    for errors in (TiltedErrors(curve=0.4), TiltedErrors(ogee_magnitude=0.4, ogee_phase_rad=1.0)):
        away = np.abs(measured_angles(p, lighthouse_2(errors, errors)) - measured_angles(p, LIGHTHOUSE_2))
        assert 2e-4 < away.max() < 5e-3
    np.testing.assert_allclose(
        measured_angles(p, LIGHTHOUSE_2) - measured_angles(p, lighthouse_2(TiltedErrors(0.01), TiltedErrors(0.02))),
        np.tile([0.01, 0.02], (len(p), 1)),
    )


@pytest.mark.parametrize("point", [[0.0, -3.0, 0.1], [0.1, 0.2, -1.0], [0.1, 0.2, 0.0]])
def test_a_point_that_a_plane_never_meets_is_nan(point: list[float]) -> None:
    assert np.isnan(measured_angles(np.array(point), FANS)).all()
