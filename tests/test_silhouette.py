"""Silhouette edges as intervals: what they say together, against integrals over a grid."""

import numpy as np
from lidar_target import DISTANCE, NOISE_M, attitudes, brick, crooked, scan_of
from scipy.special import ndtr
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.lidar.registration import register
from estimators.lidar.scan import Scan
from estimators.lidar.silhouette import Intervals, propagated

GRID = np.linspace(-4.0, 4.0, 1601)


def _posterior(intervals: Intervals, sigma: float) -> tuple[float, float]:
    """Return mean and standard deviation of one coordinate, of a normal prior and intervals, by integration."""
    density = np.exp(-(GRID**2) / (2 * sigma**2))
    for centre, half, blur, doubt in zip(*intervals[1:], strict=True):
        inside = ndtr((centre + half - GRID) / blur) - ndtr((centre - half - GRID) / blur)
        density *= (1 - doubt) * inside + doubt
    density /= density.sum()
    mean = float(np.sum(density * GRID))
    return mean, float(np.sqrt(np.sum(density * (GRID - mean) ** 2)))


def test_many_intervals_say_what_integration_says():
    """20 intervals about the same value, one of them an edge that is none: mean and spread as the integral has them."""
    rng = np.random.default_rng(0)
    truth, half = 0.3, np.full(20, 0.5)
    centre = truth + rng.uniform(-0.5, 0.5, 20)
    centre[-1] = truth + 2.0
    column = np.zeros((20, 6))
    column[:, 2] = 1.0
    intervals = Intervals(column, centre, half, np.full(20, 0.03), np.full(20, 0.01))
    normal, right = propagated(np.eye(6), np.zeros(6), intervals)
    mean, sigma = _posterior(intervals, 1.0)
    assert abs(np.linalg.solve(normal, right)[2] - mean) < 0.1 * sigma
    assert abs(1 / np.sqrt(normal[2, 2]) / sigma - 1) < 0.1
    # As normal errors of their size they would promise half a step over the root of three times their number.
    assert sigma < 0.6 * 0.5 / np.sqrt(3 * 20)
    # What no edge speaks of stays as it was.
    np.testing.assert_allclose(np.delete(np.diag(normal), 2), 1.0)


def test_a_ray_that_was_lost_is_no_edge():
    """A single ray amid the surface that does not return leaves the scan's edges as they are."""
    scan = scan_of(crooked(), attitudes(1)[0], DISTANCE, np.random.default_rng(1))
    before = scan.edges(0.1 * crooked().radius_m)
    back = scan.returned
    # On a line, returns at whose two neighbours on either side the surface goes on.
    order = np.lexsort((scan.step, scan.line))
    runs = [
        order[i]
        for i in range(2, len(order) - 2)
        if back[order[i - 2 : i + 3]].all() and np.ptp(scan.range_m[order[i - 2 : i + 3]]) < 0.1
    ]
    lost = scan.range_m.copy()
    lost[runs[len(runs) // 2]] = np.nan
    np.testing.assert_array_equal(scan._replace(range_m=lost).edges(0.1 * crooked().radius_m).point, before.point)


def test_a_face_straight_ahead_is_told_by_its_edges():
    """A face that points leave free to turn and shift, aslant to the lines, 20 views: edges tell both, and how well."""
    rng, turned, nees = np.random.default_rng(5), [], []
    for _ in range(20):
        truth = rot.exp(np.radians([*rng.uniform(25, 65, 1), *rng.uniform(-2, 2, 2)]))
        scan: Scan = scan_of(brick(), truth, DISTANCE, rng)
        fit = register(scan.point, brick(), truth, DISTANCE, NOISE_M, edges=scan.edges(0.1 * brick().radius_m))
        error = np.concatenate([rot.log(truth @ fit.rotation.T), DISTANCE - fit.position])
        turned.append(np.degrees(abs(error[0])))
        nees.append(error @ np.linalg.solve(fit.covariance, error))
    assert np.mean(turned) < 0.5
    assert np.mean(nees) < chi2.ppf(0.999, 120) / 20
