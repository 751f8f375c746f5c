"""The pose filter against finite differences, a plain linear Kalman filter, raw filterpy and its own statistics."""

from typing import Any

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.error_state import (
    POSE_COLUMNS,
    RATE_COLUMNS,
    innovation_into,
    process_noise_into,
    propagate,
    transition_into,
)
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.rotation import log_into

T = 1 / 60
RATES = [np.zeros(3), np.array([1e-6, 0, 2e-6]), np.array([0.02, -0.1, 0.05]), np.array([3.0, -20.0, 40.0])]
COUPLING = T / 4 * np.random.default_rng(3).uniform(-1, 1, (6, 6))
"""As large as a coupling can be (a sweep is T/4 from the epoch), in all its elements."""
POSE_COVARIANCE = np.diag([1.3e-3, 1.5e-3, 0.8e-3, 1.3e-4, 1.3e-4, 1e-3]) ** 2
"""About a 12-photodiode craft at 3 m: 0.05 to 0.09 degrees, 0.13 mm across, 1 mm in range."""


def every(count: int) -> Any:
    return np.ones(count, dtype=np.bool_)


def tile(array: Floats, count: int) -> Floats:
    return np.tile(array, (count,) + (1,) * array.ndim)


def a_rotation() -> Floats:
    return rot.exp(np.array([0.4, -1.1, 2.0]))


def started(count: int, coupling: Floats | None = None, **options: float) -> PoseFilterBank:
    bank = PoseFilterBank(count, **options)
    position = tile(np.array([0.3, -0.2, 3.0]), count)
    b = None if coupling is None else tile(coupling, count)
    bank.start(every(count), tile(a_rotation(), count), position, tile(POSE_COVARIANCE, count), (0.2, 0.1), b)
    return bank


def moved(rotation: Floats, rates: Floats, position: Floats, dt: float) -> tuple[Floats, Floats]:
    """The propagated pose, by the kernel under test."""
    r, p = rotation.copy(), position.copy()
    propagate(r, rates[:3].copy(), p, rates[3:].copy(), dt)
    return r, p


def nees(bank: PoseFilterBank, error: Floats, columns: Any) -> Floats:
    p = bank.covariance[:, columns][:, :, columns]
    out: Floats = np.einsum("ci,ci->c", error, np.linalg.solve(p, error[..., None])[..., 0])
    return out


def pose_error(bank: PoseFilterBank, rotation: Floats, position: Floats) -> Floats:
    return np.concatenate([rot.log(rotation @ np.swapaxes(bank.rotation, -1, -2)), position - bank.position], axis=-1)


@pytest.mark.parametrize("angular_rate", RATES)
def test_transition_is_the_derivative_of_the_propagation(angular_rate: Floats) -> None:
    rates = np.concatenate([angular_rate, [0.3, -0.2, 0.5]])
    rotation, position = a_rotation(), np.array([1.0, 2.0, 3.0])
    base_r, base_p = moved(rotation, rates, position, T)
    step = 1e-5
    numeric = np.zeros((12, 12))
    for j in range(12):
        ends = []
        for sign in (1, -1):
            x = np.zeros(12)
            x[j] = sign * step
            r, p = moved(rot.exp(x[:3]) @ rotation, rates + x[RATE_COLUMNS], position + x[6:9], T)
            ends.append(np.concatenate([rot.log(r @ base_r.T), x[3:6], p - base_p, x[9:]]))
        numeric[:, j] = (ends[0] - ends[1]) / (2 * step)
    f = np.empty((12, 12))
    transition_into(angular_rate, T, f)
    # Central differences: rounding 1e-15 / 1e-5 and a third-order term of 1e-10.
    np.testing.assert_allclose(f, numeric, rtol=0, atol=2e-9)
    # The closed form of the rotation library, across the switch from series to sines.
    np.testing.assert_allclose(f[:3, :3], rot.exp(angular_rate * T), rtol=0, atol=1e-15)
    np.testing.assert_allclose(f[:3, 3:6], T * rot.left_jacobian(angular_rate * T), rtol=0, atol=1e-15)


def test_process_noise_is_the_covariance_of_random_accelerations() -> None:
    """Integrate constant random accelerations in 64 substeps: the sample covariance must be Q."""
    rng = np.random.default_rng(11)
    count, substeps, dt = 40_000, 64, T
    rates = np.array([0.5, -0.3, 0.8])
    acceleration = rng.normal(size=(count, 6)) * np.repeat([0.7, 0.3], 3)
    r, v = tile(a_rotation(), count), np.zeros((count, 3))
    w, p = tile(rates, count), np.zeros((count, 3))
    h = dt / substeps
    for _ in range(substeps):
        r = rot.exp((w + acceleration[:, :3] * h / 2) * h) @ r
        p += v * h + acceleration[:, 3:] * h * h / 2
        w, v = w + acceleration[:, :3] * h, v + acceleration[:, 3:] * h
    straight = rot.exp(rates * dt) @ a_rotation()
    x = np.concatenate([rot.log(r @ straight.T), w - rates, p, v], axis=-1)
    q = np.empty((12, 12))
    process_noise_into(dt, 0.3, 0.7, q)
    np.testing.assert_allclose(q, q.T, rtol=0, atol=0)
    scale = np.sqrt(np.diag(q))
    # An element of a sample correlation scatters by at most sqrt(2 / n); six of these for 144 elements. What Gamma
    # neglects while the craft turns is w dt / 3 of it, below 0.6 %.
    np.testing.assert_allclose(
        x.T @ x / count / np.outer(scale, scale), q / np.outer(scale, scale), rtol=0, atol=6 * np.sqrt(2 / count)
    )


def test_measurement_matrix_is_the_derivative_of_the_innovation() -> None:
    rotation, position = a_rotation(), np.array([1.0, 2.0, 3.0])
    step, y, h = 1e-6, np.empty(6), np.empty((6, 12))
    numeric = np.zeros((6, 12))
    for j in range(12):
        for sign in (1, -1):
            x = np.zeros(12)
            x[j] = sign * step
            # PnP's answer: the true pose, shifted by B times (true - assumed rates).
            shift = COUPLING @ x[RATE_COLUMNS]
            solved = rot.exp(shift[:3]) @ rot.exp(x[:3]) @ rotation
            innovation_into(solved, position + x[6:9] + shift[3:], rotation, position, COUPLING, y, h)
            numeric[:, j] += sign * y / (2 * step)
    np.testing.assert_allclose(h, numeric, rtol=0, atol=2e-9)  # rounding 4e-16 / 1e-6


def test_start_knows_what_the_unknown_rates_did_to_the_pose() -> None:
    """Sample covariance of the error of a pose that was solved as if the craft were at rest."""
    rng = np.random.default_rng(5)
    count = 50_000
    rates = rng.normal(size=(count, 6)) * np.repeat([0.2, 0.1], 3)
    noise = rng.multivariate_normal(np.zeros(6), POSE_COVARIANCE, size=count)
    x = np.empty((count, 12))
    x[:, RATE_COLUMNS], x[:, POSE_COLUMNS] = rates, -(rates @ COUPLING.T + noise)
    p = started(1, COUPLING).covariance[0]
    scale = np.sqrt(np.diag(p))
    np.testing.assert_allclose(
        x.T @ x / count / np.outer(scale, scale), p / np.outer(scale, scale), rtol=0, atol=6 * np.sqrt(2 / count)
    )


@pytest.mark.parametrize("coupling", [COUPLING, np.zeros((6, 6))], ids=["coupled", "uncoupled"])
def test_own_model_motion_is_consistent(coupling: Floats) -> None:
    """Random motion of the filter's own model: NEES and NIS inside their 95 % chi-square bands."""
    rng = np.random.default_rng(2024)
    count, periods = 300, 60
    noise = {"acceleration_noise_m_s2": 0.5, "angular_acceleration_noise_rad_s2": 1.0}
    sigma, root = np.repeat([1.0, 0.5], 3), np.linalg.cholesky(POSE_COVARIANCE)
    r, p = tile(a_rotation(), count), tile(np.array([0.3, -0.2, 3.0]), count)
    rates = rng.normal(size=(count, 6)) * np.repeat([0.2, 0.1], 3)
    bank = PoseFilterBank(count, gate_probability=1.0, **noise)
    h, b, mask = tile(POSE_COVARIANCE, count), tile(coupling, count), every(count)
    nis = []
    for period in range(periods):
        if period:
            a = rng.normal(size=(count, 6)) * sigma
            r = rot.exp(rates[:, :3] * T + a[:, :3] * T * T / 2) @ r
            p = p + rates[:, 3:] * T + a[:, 3:] * T * T / 2
            rates = rates + a * T
            bank.predict(T, mask)
        assumed = np.concatenate([bank.angular_rate, bank.velocity], axis=-1) if period else np.zeros((count, 6))
        e = (rates - assumed) @ coupling.T + rng.normal(size=(count, 6)) @ root.T
        solved_r, solved_p = rot.exp(e[:, :3]) @ r, p + e[:, 3:]
        if period == 0:
            bank.start(mask, solved_r, solved_p, h, (0.2, 0.1), b)
        else:
            nis.append(bank.update_pose(mask, solved_r, solved_p, h, b).nis)
    x = np.empty((count, 12))
    x[:, POSE_COLUMNS] = pose_error(bank, r, p)
    x[:, RATE_COLUMNS] = rates - np.concatenate([bank.angular_rate, bank.velocity], axis=-1)
    all_nis = np.concatenate(nis)  # innovations of a consistent filter are independent in time, too
    for total, dof in (
        (nees(bank, x, np.arange(12)).sum(), 12 * count),
        (nees(bank, x[:, POSE_COLUMNS], POSE_COLUMNS).sum(), 6 * count),
        (all_nis.sum(), 6 * all_nis.size),
    ):
        low, high = chi2.ppf([0.025, 0.975], dof)
        assert low < total < high, (total / dof, low / dof, high / dof)


def test_translation_equals_a_plain_linear_kalman_filter() -> None:
    """Textbook equations with other algebra: measurement moved by B v, gain by a solve, short covariance form."""
    rng = np.random.default_rng(8)
    bank = PoseFilterBank(1, acceleration_noise_m_s2=0.4, gate_probability=1.0)
    coupling = np.zeros((6, 6))
    coupling[3:, 3:] = COUPLING[3:, 3:]
    attitude, start = np.eye(3)[None], np.array([0.3, -0.2, 3.0])
    bank.start(every(1), attitude, start[None], POSE_COVARIANCE[None], (0.1, 0.1))
    x, p = np.concatenate([start, np.zeros(3)]), np.zeros((6, 6))
    p[:3, :3], p[3:, 3:] = POSE_COVARIANCE[3:, 3:], np.eye(3) * 0.01
    h = np.hstack([np.eye(3), coupling[3:, 3:]])
    gamma = np.vstack([np.eye(3) / 2, np.eye(3)])
    for _ in range(300):
        dt = rng.uniform(0.5, 2) * T
        f = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
        g = gamma * np.repeat([dt * dt, dt], 3)[:, None] * 0.4
        x, p = f @ x, f @ p @ f.T + g @ g.T
        bank.predict(dt, every(1))
        solved = start + rng.normal(size=3) * 1e-3
        innovation = solved + coupling[3:, 3:] @ x[3:] - h @ x
        s = h @ p @ h.T + POSE_COVARIANCE[3:, 3:]
        gain = np.linalg.solve(s, h @ p).T
        x, p = x + gain @ innovation, p - gain @ h @ p
        result = bank.update_pose(every(1), attitude, solved[None], POSE_COVARIANCE[None], coupling[None])
        # Both round at 1e-16 of metres; the loop forgets within some ten periods.
        np.testing.assert_allclose(np.concatenate([bank.position[0], bank.velocity[0]]), x, rtol=0, atol=1e-12)
        np.testing.assert_allclose(bank.covariance[0, 6:, 6:], p, rtol=1e-9, atol=1e-16)
        np.testing.assert_allclose(result.nis[0], innovation @ np.linalg.solve(s, innovation), rtol=1e-9)
    np.testing.assert_array_equal(bank.rotation[0], np.eye(3))


def test_filterpy_is_the_filter() -> None:
    """The bank's numbers are those of a bare filterpy filter, with F and H of NumPy's own rotation formulas."""
    rng = np.random.default_rng(9)
    bank = started(1, COUPLING)
    bare = ExtendedKalmanFilter(12, 6)
    bare.P, r, p, w, v = bank.covariance[0], bank.rotation[0], bank.position[0], np.zeros(3), np.zeros(3)
    h = np.zeros((6, 12))
    h[:, POSE_COLUMNS], h[:, RATE_COLUMNS] = np.eye(6), COUPLING
    for _ in range(100):
        bare.F = np.eye(12)
        bare.F[:3, :3], bare.F[:3, 3:6], bare.F[6:9, 9:] = rot.exp(w * T), T * rot.left_jacobian(w * T), T * np.eye(3)
        gamma = np.kron(np.eye(2), np.kron([[T * T / 2], [T]], np.eye(3)))
        sigma = np.repeat([bank.angular_acceleration_noise_rad_s2, bank.acceleration_noise_m_s2], 3)
        bare.Q = gamma @ np.diag(sigma**2) @ gamma.T
        r, p = rot.exp(w * T) @ r, p + v * T
        bare.predict()
        bank.predict(T, every(1))
        e = rng.multivariate_normal(np.zeros(6), POSE_COVARIANCE)
        solved_r, solved_p = rot.exp(e[:3]) @ a_rotation(), np.array([0.3, -0.2, 3.0]) + e[3:]
        y = np.concatenate([rot.log(solved_r @ r.T), solved_p - p])[:, None]
        bare.update(y, lambda x: h, lambda x: h @ x, R=POSE_COVARIANCE)
        d, dw, dp, dv = bare.x[:, 0].reshape(4, 3)
        r, w, p, v = rot.exp(d) @ r, w + dw, p + dp, v + dv
        bare.x = np.zeros((12, 1))
        nis = bank.update_pose(every(1), solved_r[None], solved_p[None], POSE_COVARIANCE[None], COUPLING[None]).nis
        # The same operations in the same order but for a few roundings in log, exp and Q.
        np.testing.assert_allclose(bank.rotation[0], r, rtol=0, atol=1e-13)
        np.testing.assert_allclose(bank.position[0], p, rtol=0, atol=1e-13)
        np.testing.assert_allclose(bank.covariance[0], bare.P, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(nis[0], bare.mahalanobis**2, rtol=1e-9)
    np.testing.assert_array_equal(bank.covariance[0], bank._filter[0].P)


def test_gate_leaves_the_state_untouched() -> None:
    bank = started(3)
    bank.predict(T, every(3))
    assert bank.gate == pytest.approx(chi2.ppf(0.99999, 6), rel=1e-12)
    before = [bank.rotation, bank.angular_rate, bank.position, bank.velocity, bank.covariance]
    sigma = np.sqrt(bank.covariance[0, 8, 8] + POSE_COVARIANCE[5, 5])
    position = bank.position
    position[:, 2] += sigma * np.sqrt(bank.gate) * np.array([0.999, 1.001, 0.0])  # the whole innovation is in range
    b = np.zeros((3, 6, 6))
    mask = np.array([True, True, False])
    result = bank.update_pose(mask, bank.rotation, position, tile(POSE_COVARIANCE, 3), b)
    np.testing.assert_array_equal(result.accepted, [True, False, False])
    np.testing.assert_allclose(result.nis[:2], bank.gate * np.array([0.999, 1.001]) ** 2, rtol=1e-9)
    assert np.isnan(result.nis[2])
    after = [bank.rotation, bank.angular_rate, bank.position, bank.velocity, bank.covariance]
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old[1:], new[1:])
    assert bank.position[0, 2] > before[2][0, 2]
    # And it goes on as if the rejected pose had never come.
    twin = started(3)
    for either in (bank, twin):
        either.predict(T, mask)
    twin.predict(T, mask)
    np.testing.assert_array_equal(bank.covariance[1], twin.covariance[1])


def test_coasting_grows_as_the_model_says() -> None:
    sigma, periods = 0.3, 90
    bank = started(1, acceleration_noise_m_s2=sigma)
    grown = []
    for _ in range(periods):
        bank.predict(T, every(1))
        grown.append(np.trace(bank.covariance[0, 6:9, 6:9]))
    assert np.all(np.diff(grown) > 0)
    # An acceleration of the k-th last period moves the craft by (k - 1/2) dt^2 until now.
    weights = (np.arange(1, periods + 1) - 0.5) * T * T
    variance = np.diag(POSE_COVARIANCE)[3:] + (0.1 * periods * T) ** 2 + sigma**2 * np.sum(weights**2)
    np.testing.assert_allclose(np.diag(bank.covariance[0])[6:9], variance, rtol=1e-12)


def test_numbers_do_not_depend_on_the_rest_of_the_bank() -> None:
    rng = np.random.default_rng(4)
    count, chosen, periods = 7, 4, 50
    e = rng.normal(size=(periods, count, 6)) * np.sqrt(np.diag(POSE_COVARIANCE))
    r = rot.exp(e[..., :3]) @ rot.exp(rng.normal(size=(count, 3)))
    p = rng.uniform(1, 3, (count, 3)) + e[..., 3:]
    h = POSE_COVARIANCE * rng.uniform(1, 4, (count, 1, 1))
    b = COUPLING * rng.uniform(0, 1, (count, 1, 1))
    lit = rng.random((periods, count)) < 0.8
    lit[0] = True

    def fly(craft: Any) -> list[Floats]:
        bank = PoseFilterBank(len(craft))
        bank.start(every(len(craft)), r[0, craft], p[0, craft], h[craft], (0.2, 0.1), b[craft])
        for k in range(1, periods):
            bank.predict(T, every(len(craft)))
            bank.update_pose(lit[k, craft], r[k, craft], p[k, craft], h[craft], b[craft])
        return [bank.rotation, bank.angular_rate, bank.position, bank.velocity, bank.covariance]

    for alone, together in zip(fly([chosen]), fly(list(range(count))), strict=True):
        assert alone[0].tobytes() == together[chosen].tobytes()


def test_logarithm_equals_scipy_everywhere() -> None:
    rng = np.random.default_rng(6)
    axis = rng.normal(size=(2000, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    axis[:3] = np.eye(3)
    angle = np.concatenate([np.geomspace(1e-12, 1, 1000), np.pi - np.geomspace(1e-7, 2, 1000)])
    for v in axis * rng.permutation(angle)[:, None]:
        m, out = Rotation.from_rotvec(v).as_matrix(), np.empty(3)
        log_into(m, out)
        # Near pi the axis is read from the diagonal: still the rounding of a matrix element.
        np.testing.assert_allclose(out, v, rtol=0, atol=4e-15)
    log_into(np.diag([-1.0, -1.0, 1.0]), out)
    np.testing.assert_allclose(np.abs(out), [0, 0, np.pi], rtol=0, atol=1e-15)


@pytest.mark.parametrize("turn", [np.pi - 1e-3, np.pi - 1e-9, np.pi, np.pi + 1e-3])
def test_innovation_near_half_a_turn(turn: float) -> None:
    """Gated out by default; where everything is let in, the certain measurement wins over the vague prediction."""
    axis = np.array([0.6, 0.0, 0.8])
    solved = rot.exp(turn * axis)[None] @ a_rotation()
    position = np.array([[0.3, -0.2, 3.0]])
    for probability, accepted in ((0.99999, False), (1.0, True)):
        bank = PoseFilterBank(1, gate_probability=probability)
        prior = np.diag([0.1] * 3 + [1e-4] * 3)
        bank.start(every(1), a_rotation()[None], position, prior[None], (0.1, 0.1))
        result = bank.update_pose(every(1), solved, position, np.eye(6)[None] * 1e-8, np.zeros((1, 6, 6)))
        assert result.accepted[0] == accepted
        short = np.pi - abs(turn - np.pi)
        np.testing.assert_allclose(result.nis, short**2 / (0.1 + 1e-8), rtol=1e-9)
        # The gain is 1 - 1e-7 of pi.
        expected = solved if accepted else a_rotation()[None]
        np.testing.assert_allclose(bank.rotation, expected, rtol=0, atol=1e-6)


def test_stays_symmetric_and_orthonormal_over_minutes() -> None:
    bank = started(1, COUPLING)
    b, h = COUPLING[None], POSE_COVARIANCE[None]
    for k in range(5000):
        bank.predict(T, every(1))
        if k % 3:
            turned = rot.exp(np.array([[0.0, 0.5 * T * k, 0.0]])) @ a_rotation()
            bank.update_pose(every(1), turned, np.array([[0.3, -0.2, 3.0]]), h, b)
    p = bank.covariance[0]
    scale = np.sqrt(np.outer(np.diag(p), np.diag(p)))
    np.testing.assert_allclose(p / scale, p.T / scale, rtol=0, atol=1e-12)
    assert np.linalg.eigvalsh(p / scale).min() > 0
    # One rounding per period at most, adding up.
    np.testing.assert_allclose(bank.rotation[0] @ bank.rotation[0].T, np.eye(3), rtol=0, atol=5000 * 4.4e-16)
    # At a steady rate the filter has no lag but B times the rates, which this measurement does not contain.
    np.testing.assert_allclose(bank.angular_rate[0], [0, 0.5, 0], rtol=0, atol=1e-3)


@pytest.mark.parametrize("rate", [0.0, 6.0], ids=["static", "ring"])
def test_default_noise_is_consistent_and_worth_it(rate: float) -> None:
    """One set of defaults: the mean NEES between 4.5 and 7.5, errors at most 0.6 of the raw ones, at 3 m."""
    rng = np.random.default_rng(10)
    count, periods = 8, 900
    bank, mask = PoseFilterBank(count), every(count)
    h, b = tile(POSE_COVARIANCE, count), np.zeros((count, 6, 6))
    root = np.sqrt(POSE_COVARIANCE)
    score, error, raw = [], [], []
    for k in range(periods):
        angle = np.radians(rate) * k * T + 2 * np.pi * np.arange(count) / count
        p = np.stack([np.cos(angle), np.sin(angle), np.full(count, 3.0)], axis=-1)
        r = rot.exp(p * np.array([0.3, 0.0, 0.0])) @ a_rotation()
        e = rng.normal(size=(count, 6)) @ root
        if k:
            bank.predict(T, mask)
            bank.update_pose(mask, rot.exp(e[:, :3]) @ r, p + e[:, 3:], h, b)
        else:
            bank.start(mask, rot.exp(e[:, :3]) @ r, p + e[:, 3:], h, (0.5, 0.5))
        x = pose_error(bank, r, p)
        score.append(nees(bank, x, POSE_COLUMNS))
        error.append(x)
        raw.append(e)
    assert 4.5 < np.mean(score) < 7.5
    for part in (slice(0, 3), slice(3, 6)):
        ratio = np.linalg.norm(np.array(error)[..., part]) / np.linalg.norm(np.array(raw)[..., part])
        assert ratio < 0.6


def test_attributes_are_copies_and_idle_craft_are_nan() -> None:
    bank = PoseFilterBank(2)
    assert not bank.active.any()
    for name in ("rotation", "angular_rate", "position", "velocity", "covariance"):
        assert np.isnan(getattr(bank, name)).all()
    bank = started(2)
    bank.covariance[:] = 0
    bank.position[:] = 0
    assert bank.covariance[0, 0, 0] == POSE_COVARIANCE[0, 0]
    assert bank.position[0, 2] == 3.0
    bank.stop(np.array([True, False]))
    np.testing.assert_array_equal(bank.active, [False, True])
    for name in ("rotation", "angular_rate", "position", "velocity", "covariance"):
        assert np.isnan(getattr(bank, name)[0]).all()
        assert np.isfinite(getattr(bank, name)[1]).all()
    with pytest.raises(ValueError, match=r"mask: craft \[0\] have not been started"):
        bank.predict(T, every(2))


def test_arguments_of_masked_out_craft_are_not_read() -> None:
    bank = started(2)
    mask = np.array([True, False])
    r, p, h, b = bank.rotation, bank.position, tile(POSE_COVARIANCE, 2), np.zeros((2, 6, 6))
    for array in (r, p, h, b):
        array[1] = np.nan
    bank.predict(np.array([T, np.nan]), mask)
    bank.update_pose(mask, r, p, h, b)
    assert np.isfinite(bank.covariance).all()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mask", np.ones(3, dtype=np.bool_)),
        ("mask", np.ones(2)),
        ("rotation", np.eye(3)),
        ("position", np.zeros((3, 2))),
        ("position", np.full((2, 3), np.nan)),
        ("covariance", np.ones((2, 6))),
        ("covariance", np.ones((2, 12, 12))),
        ("covariance", tile(-np.eye(6), 2)),
        ("rate_coupling", np.zeros((6, 6))),
    ],
)
def test_misuse_names_the_argument(name: str, value: Any) -> None:
    bank = started(2)
    arguments = {
        "mask": every(2),
        "rotation": bank.rotation,
        "position": bank.position,
        "covariance": tile(POSE_COVARIANCE, 2),
        "rate_coupling": np.zeros((2, 6, 6)),
    }
    before = bank.covariance
    with pytest.raises(ValueError, match=f"^{name}: "):
        bank.update_pose(**(arguments | {name: value}))
    np.testing.assert_array_equal(bank.covariance, before)


def test_misuse_of_the_rest() -> None:
    for options in ({"acceleration_noise_m_s2": -1.0}, {"angular_acceleration_noise_rad_s2": np.inf}):
        with pytest.raises(ValueError, match=next(iter(options))):
            PoseFilterBank(1, **options)
    for probability in (0.0, 1.1, np.nan):
        with pytest.raises(ValueError, match="gate_probability"):
            PoseFilterBank(1, gate_probability=probability)
    bank = started(2)
    for dt in (-T, np.nan, np.full(3, T)):
        with pytest.raises(ValueError, match=r"^dt: "):
            bank.predict(dt, every(2))
    with pytest.raises(ValueError, match=r"^rate_sigma: "):
        bank.start(every(2), bank.rotation, bank.position, tile(POSE_COVARIANCE, 2), (0.1, np.nan))


def test_indefinite_covariance_is_refused_and_leaves_no_trace() -> None:
    """Variances are positive, but the covariance is not: filterpy would take the root of a negative number."""
    bank = started(1)
    before = [bank.rotation, bank.position, bank.covariance]
    h = np.eye(6)[None]
    h[0, 3, 4] = h[0, 4, 3] = 10.0
    with pytest.raises(ValueError, match="covariance: not positive definite for craft 0"):
        bank.update_pose(every(1), bank.rotation, bank.position + np.array([1.0, -1.0, 0.0]), h, np.zeros((1, 6, 6)))
    bank.predict(0.0, every(1))
    for old, new in zip(before, [bank.rotation, bank.position, bank.covariance], strict=True):
        np.testing.assert_array_equal(old, new)
