"""The residual test and the search for false photodiodes, against full matrices, SciPy's distributions and Monte Carlo.

Jacobians are central differences of (2), (3), so that nothing of the kernels is in the oracles.
"""

from typing import Any

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, angle_errors, angles, draw, sweep_offsets
from scipy import linalg
from scipy.stats import binom, chi2, kstest, ncx2, norm

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.integrity import (
    FEWEST_KEPT,
    AngleNoise,
    Sweeps,
    consistent_subset,
    noncentralities,
    statistic,
    thresholds,
)
from estimators.lighthouse.pnp import refine

OWN, SHARED = ANGLE_NOISE * np.sqrt(1 - RHO), ANGLE_NOISE * np.sqrt(RHO)
NOISE = AngleNoise(OWN, SHARED)
RATES = np.diag(np.square([0.3, 0.3, 0.3, 0.2, 0.2, 0.2]))
"""Covariance of the error of the assumed rates [rad/s, m/s]: of a craft that hardly knows them."""
THRESHOLD = thresholds(12, 1e-7)


class Scene:
    """Craft at 1 m to 5 m whose assumed rates are off."""

    def __init__(self, seed: int, craft: int, fewest: int = 5) -> None:
        self.rng = np.random.default_rng(seed)
        self.truth = draw(self.rng, craft, 1.0, 5.0, fewest)
        self.offset = sweep_offsets(self.rng, craft, 12)
        self.rate = 0.2 * self.rng.standard_normal((2, craft, 3))
        error = self.rng.standard_normal((craft, 6)) @ np.sqrt(RATES)
        d = self.truth
        true_rate = self.rate[0] + error[:, :3], self.rate[1] + error[:, 3:]
        self.exact = angles(d.rotation, d.position, d.point, self.offset, *true_rate)
        self.theta = self.exact + angle_errors(self.rng, craft, 12)
        self.rates = np.broadcast_to(RATES, (craft, 6, 6))

    def sweeps(self, theta: Floats | None = None) -> Sweeps:
        d = self.truth
        return Sweeps(self.theta if theta is None else theta, d.lit, d.point, self.offset, *self.rate)

    def solved(self, theta: Floats | None = None):
        s = self.sweeps(theta)
        return refine(*s[:3], self.truth.rotation, self.truth.position, *s[3:])

    def rows(self, craft: int, rotation: Floats, position: Floats) -> tuple[Floats, Floats, Floats]:
        """J (2 n, 6), the residuals and the instants of one craft's lit angles, fan X first."""
        one, lit, h = slice(craft, craft + 1), self.truth.lit[craft], 1e-6
        point, offset = self.truth.point[one][:, lit], self.offset[one][:, lit]

        def at(error: Floats) -> Floats:
            pose = (rot.exp(error[:3]) @ rotation)[None], (position + error[3:])[None]
            return angles(*pose, point, offset, self.rate[0][one], self.rate[1][one])[0].T.reshape(-1)

        jacobian = np.stack([(at(h * e) - at(-h * e)) / (2 * h) for e in np.eye(6)], axis=-1)
        residual = self.theta[craft, lit].T.reshape(-1) - at(np.zeros(6))
        return jacobian, residual, offset[0].T.reshape(-1)


def test_the_statistic_is_that_of_the_full_covariance_of_the_residuals():
    scene = Scene(1, 12)
    solution = scene.solved()
    ours = statistic(scene.sweeps(), solution.rotation, solution.position, NOISE, scene.rates)
    for c in range(12):
        j, r, tau = scene.rows(c, solution.rotation[c], solution.position[c])
        n = len(r) // 2
        shared = np.kron(np.eye(2), np.ones((n, n)))
        moved = tau[:, None] * j
        e = OWN**2 * np.eye(2 * n) + SHARED**2 * shared + moved @ RATES @ moved.T
        m = np.eye(2 * n) - j @ np.linalg.pinv(j)
        expected = r @ np.linalg.pinv(m @ e @ m, rcond=1e-9, hermitian=True) @ r
        # The residual is of angles here, of cotangents weighted by (13) there: second order of noise of 15 urad.
        assert ours[c] == pytest.approx(expected, rel=2e-3)
        assert ours[c] <= solution.cost[c] / OWN**2


@pytest.mark.parametrize("seed", [2, 3])
def test_honest_residuals_are_chi_square_whatever_the_rotor_and_the_rates_do(seed):
    scene = Scene(seed, 2000)
    solution = scene.solved()
    value = statistic(scene.sweeps(), solution.rotation, solution.position, NOISE, scene.rates)
    share = chi2.sf(value, 2 * scene.truth.lit.sum(axis=1) - 6)
    assert kstest(share, "uniform").pvalue > 0.01
    # Without the nuisances nearly every one of these would look false.
    bare = chi2.sf(solution.cost / OWN**2, 2 * scene.truth.lit.sum(axis=1) - 6)
    assert np.mean(bare < 1e-7) > 0.5


def test_thresholds_and_noncentralities_are_scipys():
    missed = noncentralities(THRESHOLD, 1e-4)
    assert np.all(np.isinf(THRESHOLD[:4])), "three photodiodes leave nothing to test"
    assert np.all(np.isinf(missed[:4]))
    for n in range(4, 13):
        assert chi2.sf(THRESHOLD[n], 2 * n - 6) == pytest.approx(1e-7, rel=1e-6)
        assert ncx2.cdf(THRESHOLD[n], 2 * n - 6, missed[n]) == pytest.approx(1e-4, rel=1e-3)


def oracle_slopes(scene: Scene, craft: int) -> tuple[float, float, int, Floats]:
    """Slopes of attitude and position [deg/rad, m/rad]; the lit photodiode and the fault (2,) of the latter."""
    j, _, _ = scene.rows(craft, scene.truth.rotation[craft], scene.truth.position[craft])
    n = len(j) // 2
    gain = np.linalg.pinv(j)
    m = np.eye(2 * n) - j @ gain
    u = m @ np.kron(np.eye(2), np.ones((n, 1)))
    a = m - u @ np.linalg.inv((1 - RHO) / RHO * np.eye(2) + u.T @ u) @ u.T
    worst: list[Any] = [0.0, 0.0, 0, np.zeros(2)]
    for k in range(n):
        pick = [k, n + k]
        for i, rows in enumerate((slice(0, 3), slice(3, 6))):
            g = gain[rows][:, pick]
            value, vector = linalg.eigh(g.T @ g, a[np.ix_(pick, pick)])
            if value[-1] > worst[i] ** 2:
                worst[i] = float(np.sqrt(value[-1]))
                if i == 1:
                    worst[2:] = k, vector[:, -1]
    return np.rad2deg(worst[0]), worst[1], worst[2], worst[3]


def test_slopes_are_the_greatest_generalised_eigenvalues():
    scene = Scene(4, 30)
    d = scene.truth
    rate, velocity = scene.rate
    every = np.ones(30, np.bool_)
    ours = dilution(d.rotation, d.position, d.lit, d.point, scene.offset, rate, velocity, RHO, every)
    for c in range(30):
        attitude, position, _, _ = oracle_slopes(scene, c)
        # Central differences leave 1e-10 of J, which the geometry amplifies by up to 1e4.
        assert ours.attitude_slope_deg_per_rad[c] == pytest.approx(attitude, rel=1e-4)
        assert ours.position_slope_m_per_rad[c] == pytest.approx(position, rel=1e-4)


def test_a_fault_that_would_not_show_has_no_slope():
    # Four photodiodes of which three lie on a line: the fourth alone tells the turn about it.
    point = np.array([[[-0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]])
    pose = rot.exp(np.array([[2.8, 0.3, 0.0]])), np.array([[0.1, 0.2, 3.0]])
    still = np.zeros((1, 3))
    made = dilution(
        *pose, np.ones((1, 4), np.bool_), point, np.zeros((1, 4, 2)), still, still, RHO, np.ones(1, np.bool_)
    )
    assert np.isinf(made.position_slope_m_per_rad[0])
    assert np.isinf(made.attitude_slope_deg_per_rad[0])


def test_a_fault_as_large_as_the_level_allows_for_is_missed_as_seldom_as_it_says():
    # Chances large enough to be counted: one alarm in 100, one miss in 10.
    scene, samples = Scene(5, 1, fewest=8), 3000
    d, still = scene.truth, (np.zeros((1, 3)), np.zeros((1, 3)))
    n = int(d.lit.sum())
    limit = thresholds(12, 0.01)
    noncentrality = noncentralities(limit, 0.1)[n]
    scene.rate = np.zeros((2, 1, 3))
    _, slope, k, fault = oracle_slopes(scene, 0)
    # eigh scales the fault to b^T A b = 1.
    bias = fault * np.sqrt(noncentrality) * OWN
    exact = angles(d.rotation, d.position, d.point, scene.offset, *still)
    theta = np.repeat(exact, samples, axis=0) + angle_errors(np.random.default_rng(6), samples, 12)
    theta[:, np.flatnonzero(d.lit[0])[k]] += bias
    many: list[Any] = [
        np.repeat(part, samples, axis=0) for part in (d.lit, d.point, d.rotation, d.position, scene.offset)
    ]
    rest = np.zeros((samples, 3))
    solution = refine(theta, many[0], many[1], many[2], many[3], many[4], rest, rest)
    sweeps = Sweeps(theta, many[0], many[1], many[4], rest, rest)
    value = statistic(sweeps, solution.rotation, solution.position, NOISE, np.zeros((samples, 6, 6)))
    low, high = binom.ppf([0.0005, 0.9995], samples, 0.1)
    assert low <= np.count_nonzero(value <= limit[n]) <= high
    shift = np.linalg.norm(np.mean(solution.position, axis=0) - d.position[0])
    assert shift == pytest.approx(slope * np.sqrt(noncentrality) * OWN, rel=0.05)


@pytest.mark.parametrize("false", [1, 2, 4])
def test_false_photodiodes_are_found_and_the_pose_is_that_of_the_others(false):
    scene = Scene(7 + false, 25, fewest=FEWEST_KEPT + false + 1)
    sweeps, found = scene.sweeps(), 0
    d = scene.truth
    for c in range(25):
        who = scene.rng.choice(np.flatnonzero(d.lit[c]), false, replace=False)
        theta = scene.theta[c : c + 1].copy()
        # One of the two angles, or both, by half a degree to five.
        size = np.deg2rad(scene.rng.uniform(0.5, 5, (false, 2))) * scene.rng.choice([-1, 1], (false, 2))
        size[:, 0] *= scene.rng.integers(0, 2, false)
        theta[0, who] += size
        one = sweeps.of(np.array([c]))._replace(theta=theta)
        # A prediction that is off by centimetres and a degree.
        start = rot.exp(0.01 * scene.rng.standard_normal(3)) @ d.rotation[c]
        subset = consistent_subset(one, start, d.position[c] + 0.02, NOISE, RATES, THRESHOLD)
        assert subset is not None
        assert not subset.lit[who].any()
        found += int(subset.lit.sum() == d.lit[c].sum() - false)
        honest = one._replace(theta=scene.theta[c : c + 1], lit=subset.lit[None])
        other = refine(*honest[:3], d.rotation[c][None], d.position[c][None], *honest[3:])
        np.testing.assert_allclose(subset.solution.position, other.position, atol=1e-8)
    # More than need be are dropped where only a fit without them starts well: hardly ever.
    assert found >= 23


def test_five_photodiodes_detect_and_find_nothing_six_find():
    scene = Scene(12, 40, fewest=6)
    for c in range(40):
        lit = np.zeros((1, 12), dtype=np.bool_)
        chosen = np.flatnonzero(scene.truth.lit[c])
        theta = scene.theta[c : c + 1].copy()
        theta[0, chosen[0]] += np.deg2rad([2.0, -1.0])
        start = scene.truth.rotation[c], scene.truth.position[c]
        for count in (5, 6):
            lit[0] = False
            lit[0, chosen[:count]] = True
            one = scene.sweeps().of(np.array([c]))._replace(theta=theta, lit=lit)
            subset = consistent_subset(one, *start, NOISE, RATES, THRESHOLD)
            if count == 5:
                assert subset is None
            elif subset is not None:
                assert not subset.lit[chosen[0]]


def test_a_photodiode_that_agrees_is_left_in():
    scene = Scene(13, 200)
    solution = scene.solved()
    value = statistic(scene.sweeps(), solution.rotation, solution.position, NOISE, scene.rates)
    assert np.all(value <= THRESHOLD[scene.truth.lit.sum(axis=1)])


def test_no_gaussian_exceeds_its_root_trace_more_often_than_one_normal_variable():
    # What the protection level's first term rests on (Szekely and Bakirov 2003), for K = 2 and spectra of all shapes.
    rng = np.random.default_rng(14)
    samples = rng.standard_normal((200_000, 3)) ** 2
    limit = 2 * norm.sf(2.0)
    for spectrum in ([1, 0, 0], [1, 0.1, 0], [1, 1, 0], [1, 0.5, 0.2], [1, 1, 1]):
        beyond = np.mean(samples @ np.array(spectrum) > 4 * sum(spectrum))
        assert beyond <= limit + 4 * np.sqrt(limit / len(samples))


def test_wrong_shapes_name_the_argument():
    scene = Scene(15, 2)
    s = scene.sweeps()
    with pytest.raises(ValueError, match="theta"):
        statistic(s._replace(theta=s.theta[..., :1]), scene.truth.rotation, scene.truth.position, NOISE, scene.rates)
    with pytest.raises(ValueError, match="rate_covariance"):
        statistic(s, scene.truth.rotation, scene.truth.position, NOISE, scene.rates[0])
