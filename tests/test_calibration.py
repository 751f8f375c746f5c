"""The bundle adjustment: derivatives, gauge and elimination against dense algebra, answers against a known truth."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2
from synthetic_survey import LAYOUT, NOISE, PERFECT, REAL, Truth, survey

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.calibration.arrow import Whitening, arrow
from estimators.calibration.model import linear_fans
from estimators.calibration.problem import Problem, Survey, to_gauge
from estimators.calibration.solve import Calibration, Unobservable, calibrate

KNOWN = [pytest.param(True, id="poses known"), pytest.param(False, id="poses unknown")]


def disturbed(made: Survey, angle: float = 0.02, distance: float = 0.02) -> Survey:
    """The survey with poses as wrong as an uncalibrated craft's."""
    random = np.random.default_rng(8)
    count = len(made.rotation)
    return made._replace(
        rotation=rot.exp(random.normal(0, angle, (count, 3))) @ made.rotation,
        position=made.position + random.normal(0, distance, (count, 3)),
    )


def somewhere(problem: Problem) -> Floats:
    """Unknowns away from the start."""
    random = np.random.default_rng(9)
    x = problem.start()
    x[: problem.local] += random.normal(0, 0.1, problem.local)
    x[problem.local :] += random.normal(0, 3e-3, problem.size - problem.local)
    return x


def error(found: Calibration, truth: Truth, believed: Floats, poses_known: bool) -> Floats:
    """All shared parameters minus the truth, in the same gauge."""
    point = truth.point_m
    if not poses_known:
        crafts = len(point) // len(LAYOUT)
        pairs = zip(np.split(point, crafts), np.split(believed, crafts), strict=True)
        point = np.concatenate([to_gauge(*pair) for pair in pairs])
    return np.concatenate([(found.fans - linear_fans(truth.fans)).ravel(), (found.point_m - point).ravel()])


@pytest.mark.parametrize("poses_known", KNOWN)
def test_the_jacobian_is_that_of_finite_differences(poses_known):
    made, _ = survey(3, crafts=2)
    problem = Problem(made, NOISE, poses_known=poses_known)
    x, step = somewhere(problem), 1e-6
    analytic = problem.jacobian(x).toarray()
    for column in range(problem.size):
        move = step * np.eye(problem.size)[column]
        numeric = (problem.residuals(x + move) - problem.residuals(x - move)) / (2 * step)
        # In angles: third derivatives (below 100, of an arm of centimetres at a metre) times step^2, and rounding.
        np.testing.assert_allclose(analytic[:, column], numeric, rtol=0, atol=2e-9 / NOISE.own_rad)


def test_the_jacobian_is_sparse():
    made, _ = survey(50)
    for poses_known, entries in ((True, 9), (False, 15)):
        problem = Problem(made, NOISE, poses_known=poses_known)
        jacobian = problem.jacobian(problem.start())
        assert jacobian.nnz == entries * len(made.theta) + 2 * problem.blocks


def test_without_known_poses_a_turned_shifted_scaled_craft_measures_the_same():
    made, truth = survey(20, speed=0.0, noisy=False, fans=PERFECT)
    turn, shift, scale = rot.exp(np.array([0.3, -0.2, 0.5])), np.array([0.02, -0.01, 0.03]), 1.7
    twin = made._replace(
        point_m=scale * truth.point_m @ turn.T + shift,
        rotation=made.rotation @ turn.T,
        position=scale * made.position - (made.rotation @ turn.T) @ shift,
    )
    residuals = [Problem(each, NOISE, poses_known=False) for each in (made._replace(point_m=truth.point_m), twin)]
    for problem in residuals:
        # A few rounding errors of an angle over its noise.
        np.testing.assert_allclose(problem.residuals(problem.start()), 0, atol=1e-14 / NOISE.own_rad)


def test_the_basis_leaves_out_the_gauge_and_only_that():
    made, _ = survey(20, speed=0.0, crafts=2)
    known, unknown = (Problem(made, NOISE, poses_known=k).basis for k in (True, False))
    assert known.shape[1] == 10 + 6 * len(LAYOUT)
    assert unknown.shape[1] == known.shape[1] - 2 * 7
    np.testing.assert_allclose(unknown.T @ unknown, np.eye(unknown.shape[1]), atol=1e-13)
    # With all of them free, S has exactly the gauge as its null space.
    problem = Problem(disturbed(made), NOISE, poses_known=False)
    problem.basis = known
    rows = len(made.theta) + 2 * problem.blocks
    value = np.linalg.eigvalsh(arrow(problem, problem.jacobian(problem.start()), np.ones(rows)).schur)
    assert value[13] < 1e-9 * value[-1]
    assert value[14] > 1e3 * abs(value[13])


def test_to_gauge_undoes_a_similarity_and_meets_its_conditions():
    random = np.random.default_rng(3)
    moved = LAYOUT + 1e-3 * random.standard_normal(LAYOUT.shape)
    found = to_gauge(1.3 * moved @ rot.exp(np.array([0.4, 0.5, -2.0])).T + np.array([1.0, 2, 3]), LAYOUT)
    np.testing.assert_allclose(found, to_gauge(moved, LAYOUT), atol=1e-15)
    centre = LAYOUT - LAYOUT.mean(axis=0)
    np.testing.assert_allclose(found.mean(axis=0), LAYOUT.mean(axis=0), atol=1e-16)
    np.testing.assert_allclose(np.cross(centre, found - LAYOUT).sum(axis=0), 0, atol=1e-16)
    assert np.sum(centre * (found - LAYOUT)) == pytest.approx(0, abs=1e-16)
    problem = Problem(survey(5)[0], NOISE, poses_known=False)
    outside = (found - LAYOUT).ravel() - problem.basis[10:] @ (problem.basis[10:].T @ (found - LAYOUT).ravel())
    np.testing.assert_allclose(outside, 0, atol=1e-15)


@pytest.mark.parametrize("poses_known", KNOWN)
def test_eliminating_the_poses_is_dense_algebra(poses_known):
    made, _ = survey(6, crafts=2)
    problem = Problem(disturbed(made), NOISE, poses_known=poses_known)
    jacobian = problem.jacobian(problem.start())
    weight = np.random.default_rng(1).uniform(0.2, 1, jacobian.shape[0])
    normal = arrow(problem, jacobian, weight)
    free = np.zeros((problem.size, problem.local + problem.basis.shape[1]))
    free[: problem.local, : problem.local] = np.eye(problem.local)
    free[problem.local :, problem.local :] = problem.basis
    dense = weight[:, None] * (jacobian.toarray() @ free)
    matrix = dense.T @ dense
    own, shared = slice(problem.local), slice(problem.local, None)
    schur = matrix[shared, shared] - matrix[shared, own] @ np.linalg.solve(matrix[own, own], matrix[own, shared])
    np.testing.assert_allclose(normal.schur, schur, rtol=0, atol=1e-9 * np.abs(schur).max())

    whitening = Whitening(problem, normal)
    identity = np.eye(whitening.shape[1])
    white = np.stack([whitening.forward(e) for e in identity], axis=1)
    back = np.stack([whitening.backward(e) for e in np.eye(problem.size)], axis=1)
    np.testing.assert_allclose(white.T, back, rtol=0, atol=1e-12 * np.abs(white).max())
    whole = weight[:, None] * (jacobian @ white)
    # Cholesky's error is the condition of S, 1e6 here, times a rounding error.
    np.testing.assert_allclose(whole.T @ whole, identity, atol=1e-7)
    np.testing.assert_allclose(
        whitening.of(jacobian) @ identity, jacobian @ white, rtol=0, atol=1e-9 * np.abs(jacobian @ white).max()
    )


@pytest.mark.parametrize("poses_known", KNOWN)
def test_the_sparse_answer_is_the_dense_one(poses_known):
    made, truth = survey(25)
    found = calibrate(made if poses_known else disturbed(made), NOISE, poses_known=poses_known)
    assert found.used.all()
    # The dense solver, without rounds, starts from the true poses and fans: from further off it gets stuck.
    made = made._replace(fans=linear_fans(truth.fans))
    problem = Problem(made, NOISE, poses_known=poses_known)
    free = np.zeros((problem.size, problem.local + problem.basis.shape[1]))
    free[: problem.local, : problem.local] = np.eye(problem.local)
    free[problem.local :, problem.local :] = problem.basis
    angles = len(made.theta)

    def huber(square: Floats) -> Floats:
        far = (square > 4) & (np.arange(len(square)) < angles)
        size = np.sqrt(square)
        return np.stack(
            [
                np.where(far, 4 * size - 4, square),
                np.where(far, 2 / np.maximum(size, 1), 1.0),
                np.where(far, -1 / np.maximum(size, 1) ** 3, 0.0),
            ]
        )

    dense = least_squares(
        lambda q: problem.residuals(problem.start() + free @ q),
        np.zeros(free.shape[1]),
        jac=lambda q: problem.jacobian(problem.start() + free @ q).toarray() @ free,
        x_scale="jac",
        loss=huber,
        tr_solver="exact",
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
        max_nfev=200,
    )
    fans, point_m = problem.shared(problem.start() + free @ dense.x)
    # Both stop within a hundredth of a standard deviation of the minimum.
    assert np.abs((found.fans - fans) / found.fan_sigma).max() < 0.02
    assert np.abs((found.point_m - point_m) / np.maximum(found.point_sigma_m, 1e-9)).max() < 0.02


@pytest.mark.parametrize("poses_known", KNOWN)
def test_errors_are_as_large_as_their_covariance_says(poses_known):
    total, freedom, residual = 0.0, 0, []
    for seed in range(6):
        made, truth = survey(100, seed=seed)
        found = calibrate(made, NOISE, poses_known=poses_known)
        basis = Problem(made, NOISE, poses_known=poses_known).basis
        off = basis.T @ error(found, truth, made.point_m, poses_known)
        total += float(off @ np.linalg.solve(basis.T @ found.covariance @ basis, off))
        freedom += len(off)
        residual.append(found.residual)
    low, high = chi2.ppf([0.001, 0.999], freedom)
    assert low < total < high
    assert np.mean(residual) == pytest.approx(1, abs=0.03)


def test_without_noise_it_finds_the_truth():
    for poses_known in (True, False):
        # At rest within the period: the true rates are those of the true body frame and size, not of the gauge's.
        made, truth = survey(60, noisy=False, speed=0.0)
        found = calibrate(disturbed(made) if not poses_known else made, NOISE, poses_known=poses_known)
        # It stops when a step is below a hundredth of a standard deviation.
        scale = np.sqrt(np.diagonal(found.covariance))
        assert np.abs(error(found, truth, made.point_m, poses_known)).max() < 0.01 * scale.max()


@pytest.mark.parametrize("poses_known", KNOWN)
def test_five_per_cent_of_bad_angles_do_no_harm(poses_known):
    made, truth = survey(300, seed=4)
    random = np.random.default_rng(6)
    bad = random.random(len(made.theta)) < 0.05
    made = made._replace(theta=made.theta + np.where(bad, random.uniform(-0.02, 0.02, len(bad)), 0.0))
    found = calibrate(made if poses_known else disturbed(made), NOISE, poses_known=poses_known)
    off = error(found, truth, made.point_m, poses_known)
    sigma = np.sqrt(np.diagonal(found.covariance))
    # 37 parameters: one in 400 such surveys has one beyond 4 standard deviations.
    assert np.abs(off[sigma > 0] / sigma[sigma > 0]).max() < 4
    # What is left of the bad ones are those within 5 standard deviations, 1 in 260.
    assert np.count_nonzero(found.used & bad) < 0.02 * np.count_nonzero(bad)
    assert np.count_nonzero(~found.used & ~bad) < 0.1 * len(bad)


@pytest.mark.parametrize("poses_known", KNOWN)
@pytest.mark.parametrize("spread", [0.0, 0.01])
def test_a_craft_at_rest_is_refused(poses_known, spread):
    made, _ = survey(200, spread=spread, speed=0.0)
    with pytest.raises(Unobservable, match=r"not observable.*fan_x\.curve.*photodiodes"):
        calibrate(made, NOISE, poses_known=poses_known)


def test_what_a_poor_survey_cannot_tell_can_be_held():
    made, truth = survey(200, spread=0.05)
    made = made._replace(fans=linear_fans(REAL))
    with pytest.raises(Unobservable):
        calibrate(made, NOISE, poses_known=True)
    found = calibrate(made, NOISE, poses_known=True, hold=["phase", "tilt", "curve", "gibbous"])
    np.testing.assert_array_equal(found.fans, made.fans)
    assert (found.fan_sigma == 0).all()
    assert np.abs((found.point_m - truth.point_m) / found.point_sigma_m).max() < 4


def test_a_photodiode_that_is_never_lit_stays_where_it_is_believed_to_be():
    made, truth = survey(100)
    dark = made.photodiode == 3
    made = made._replace(
        **{name: getattr(made, name)[~dark] for name in ("theta", "fan", "photodiode", "pose", "offset_s")}
    )
    found = calibrate(made, NOISE, poses_known=True)
    assert found.placed.tolist() == [k != 3 for k in range(len(LAYOUT))]
    np.testing.assert_array_equal(found.point_m[3], made.point_m[3])
    assert np.abs((found.fans - linear_fans(truth.fans)) / found.fan_sigma).max() < 4


def test_mistakes_are_named():
    made, _ = survey(5)
    with pytest.raises(ValueError, match=r"fan has shape"):
        calibrate(made._replace(fan=np.zeros(3, dtype=np.int64)), NOISE, poses_known=True)
    with pytest.raises(ValueError, match="position must be finite"):
        calibrate(made._replace(position=np.full_like(made.position, np.nan)), NOISE, poses_known=True)
    with pytest.raises(ValueError, match="fan must lie"):
        calibrate(made._replace(fan=made.fan + 1), NOISE, poses_known=True)
    with pytest.raises(ValueError, match="must belong"):
        calibrate(made._replace(owner=made.owner + 1), NOISE, poses_known=True)
    with pytest.raises(ValueError, match="noise must be positive"):
        calibrate(made, NOISE._replace(own_rad=0.0), poses_known=True)
    with pytest.raises(ValueError, match="'mirror' is none of"):
        calibrate(made, NOISE, poses_known=True, hold=["mirror"])
    with pytest.raises(ValueError, match="nothing is left"):
        calibrate(made, NOISE, poses_known=True, hold=["phase", "tilt", "curve", "gibbous", "photodiodes"])


def test_no_angle_at_all_is_a_poor_survey():
    made, _ = survey(5)
    empty = made._replace(
        **{name: getattr(made, name)[:0] for name in ("theta", "fan", "photodiode", "pose", "offset_s")}
    )
    for poses_known in (True, False):
        with pytest.raises(Unobservable):
            calibrate(empty, NOISE, poses_known=poses_known)
