"""The smoother: against the least squares of all measurements at once, against its closed form, and its consistency."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.compiled_interacting import CompiledInteractingBank
from estimators.filter.error_state import POSE_COLUMNS, process_noise_into
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.filter.filterpy_interacting import FilterpyInteractingBank
from estimators.filter.smoother import Estimates, Prediction, Smoother, predicted
from estimators.rotation import exp, left_jacobian, log
from estimators.state import STATES, State

DT = 1 / 60


def random_covariance(rng, scale):
    root = rng.normal(size=(len(scale), len(scale)))
    root = np.eye(len(scale)) + 0.3 * root / np.sqrt(len(scale))
    return (scale[:, None] * root) @ (scale[:, None] * root).T


def smooth_all(history):
    """Smooth [(prediction, estimates)] of successive periods."""
    smoother = Smoother(len(history[0][0].continued))
    return [smoother.step(estimates, prediction) for prediction, estimates in reversed(history)][::-1]


def kept(bank, prediction):
    return prediction.ended(bank, bank.active), Estimates(bank.state, bank.covariance)


def error(truth, estimate):
    """True minus estimated, (C, 12)."""
    return np.concatenate(
        [
            log(truth.rotation @ np.swapaxes(estimate.rotation, -1, -2)),
            truth.angular_rate - estimate.angular_rate,
            truth.position - estimate.position,
            truth.velocity - estimate.velocity,
        ],
        axis=-1,
    )


def pushed(truth: State, rng: np.random.Generator, linear: float, angular: float) -> State:
    """Return the true states a period later, of craft pushed at random by so much, 1 sigma [m/s^2], [rad/s^2]."""
    turning, pushing = (sigma * rng.normal(size=truth.position.shape) for sigma in (angular, linear))
    return State(
        exp(truth.angular_rate * DT + turning * DT**2 / 2) @ truth.rotation,
        truth.position + truth.velocity * DT + pushing * DT**2 / 2,
        truth.velocity + pushing * DT,
        truth.angular_rate + turning * DT,
    )


@pytest.mark.parametrize("kind", [PoseFilterBank, CompiledFilterBank])
def test_it_is_the_least_squares_of_all_measurements(kind):
    """One craft, 14 periods: a start with coupled rates, poses, own orders, the dark, and a pose that the gate refuses.

    The attitude moves by some 1e-5 rad: what is not linear in it is below 1e-9. The motion in space is exactly linear.
    """
    rng, one = np.random.default_rng(5), np.ones(1, dtype=bool)
    sigma = np.array([1e-5, 2e-5, 1e-5, 1e-3, 2e-3, 3e-3])
    acceleration, turning = 0.2, 1e-3
    bank = kind(1, acceleration_noise_m_s2=acceleration, angular_acceleration_noise_rad_s2=turning)
    prior, rates = (1e-4, 0.5), np.array([6e-5, 0.0, -3e-5, 0.2, 0.1, -0.2])
    coupling = np.zeros((1, 6, 6))
    coupling[0] = 0.004 * np.eye(6) + 1e-4 * rng.normal(size=(6, 6)) * np.kron(np.eye(2), np.ones((3, 3)))

    history, rows, right, orders = [], [], [], []
    q = np.zeros((STATES, STATES))
    process_noise_into(DT, acceleration, turning, q)
    for k in range(14):
        covariance = block_diag(random_covariance(rng, sigma[:3]), random_covariance(rng, sigma[3:]))[None]

        def move(k=k):
            bank.predict(DT, bank.active)
            order = np.array([1e-6, 0, 1e-6, 1e-5, 0, 0, 1e-4, 0, 2e-5 * k, 0.005, 0, 0.001])
            orders.append(order)
            bank.add_motion(bank.active, *(order[None, i : i + 3] for i in (0, 3, 6, 9)))

        prediction = predicted(bank, DT, move if k else lambda: orders.append(np.zeros(STATES)))
        # The pose is B rates off what it was solved with: nothing at the start, the predicted rates later.
        b, state = coupling[0], prediction.state
        solved_with = np.zeros(6) if k == 0 else np.concatenate([state.angular_rate[0], state.velocity[0]])
        drawn = k * DT * rates + b @ (rates - solved_with) + sigma * rng.normal(size=6)
        drawn += 0.5 if k == 9 else 0.0  # which no gate lets in
        rotation, position = exp(drawn[None, :3]), drawn[None, 3:]
        if k == 0:
            bank.start(one, rotation, position, covariance, prior, coupling)
        elif k not in (4, 5, 6):
            result = bank.update_pose(one, rotation, position, covariance, coupling)
            assert result.accepted[0] == (k != 9)
        history.append(kept(bank, prediction))
        if k in (4, 5, 6, 9):
            continue
        h = np.zeros((6, STATES))
        h[:, POSE_COLUMNS], h[:, 3:6], h[:, 9:12] = np.eye(6), b[:, :3], b[:, 3:]
        z = drawn + b @ solved_with
        white = np.linalg.inv(np.linalg.cholesky(covariance[0]))
        rows.append((k, white @ h))
        right.append(white @ z)
        if k == 0:
            of_rates = np.eye(STATES)[[3, 4, 5, 9, 10, 11]]
            rows.append((0, of_rates / np.repeat(prior, 3)[:, None]))
            right.append(np.zeros(6))

    # Unknown: the state of period 0 and the accelerations of every period after it.
    gamma = np.zeros((STATES, 6))
    for i, s in ((0, turning), (6, acceleration)):
        gamma[i : i + 3, i // 2 : i // 2 + 3] = np.eye(3) * s * DT**2 / 2
        gamma[i + 3 : i + 6, i // 2 : i // 2 + 3] = np.eye(3) * s * DT
    np.testing.assert_allclose(gamma @ gamma.T, q, rtol=1e-12, atol=1e-25)
    unknown = STATES + 6 * 13
    by, known = [np.eye(STATES, unknown)], [np.zeros(STATES)]
    for k in range(1, 14):
        f = history[k][0].transition[0]
        row = f @ by[-1]
        row[:, STATES + 6 * (k - 1) : STATES + 6 * k] += gamma
        by.append(row)
        known.append(f @ known[-1] + orders[k])
    a = np.concatenate([h @ by[k] for k, h in rows] + [np.eye(6 * 13, unknown, STATES)])
    y = np.concatenate([r - h @ known[k] for (k, h), r in zip(rows, right, strict=True)] + [np.zeros(6 * 13)])
    solution = np.linalg.lstsq(a, y, rcond=None)[0]
    spread = np.linalg.inv(a.T @ a)

    in_space = slice(6, 12)
    for k, found in enumerate(smooth_all(history)):
        x = by[k] @ solution + known[k]
        state = found.state
        mine = np.concatenate([log(state.rotation[0]), state.angular_rate[0], state.position[0], state.velocity[0]])
        np.testing.assert_allclose(mine, x, atol=1e-9)
        p = by[k] @ spread @ by[k].T
        size = np.sqrt(np.diag(p))
        difference = (found.covariance[0] - p) / np.outer(size, size)
        assert np.abs(difference[in_space, in_space]).max() < 1e-9
        # Here covariances turn with attitudes of 1e-5 rad.
        assert np.abs(difference).max() < 1e-4


def test_without_process_noise_the_past_is_the_future_carried_back():
    """F = I and P- = P: the gain is I, and what is known later was true before, however far the filter had been off."""
    rng, c = np.random.default_rng(2), 5
    wide = random_covariance(rng, np.full(STATES, 1.0))[None].repeat(c, axis=0)
    narrow = np.stack([random_covariance(rng, np.full(STATES, 1e-2)) for _ in range(c)])
    far = State(exp(rng.normal(size=(c, 3))), *rng.normal(size=(3, c, 3)))
    near = State(exp(rng.normal(size=(c, 3))), *rng.normal(size=(3, c, 3)))
    yes, still = np.ones(c, dtype=bool), np.eye(STATES)[None].repeat(c, axis=0)
    first, last = smooth_all(
        [(Prediction(~yes, far, wide, still), Estimates(far, wide)),
         (Prediction(yes, far, wide, still), Estimates(near, narrow))]
    )  # fmt: skip
    for found, true in zip(first.state, near, strict=True):
        np.testing.assert_allclose(found, true, atol=1e-12)
    # Whose covariance turns with the state it belongs to, there and back.
    np.testing.assert_allclose(first.covariance, narrow, atol=1e-13)
    np.testing.assert_array_equal(last.covariance, narrow)


def test_a_covariance_turns_with_the_state_that_it_belongs_to():
    """Half of the difference is believed (P- = 2 P): P then is counted from a state that is turned by J_l."""
    d = np.array([0.6, -0.4, 0.9])
    far, near = State(np.eye(3)[None], *np.zeros((3, 1, 3))), State(exp(d)[None], *np.zeros((3, 1, 3)))
    p, tiny = np.eye(STATES)[None], 1e-12 * np.eye(STATES)[None]
    yes = np.ones(1, dtype=bool)
    first, _ = smooth_all(
        [(Prediction(~yes, far, p, p), Estimates(far, p)), (Prediction(yes, far, 2 * p, p), Estimates(near, tiny))]
    )
    np.testing.assert_allclose(log(first.state.rotation[0]), d / 2, atol=1e-12)
    jacobian = left_jacobian(d / 2)
    np.testing.assert_allclose(first.covariance[0, :3, :3], jacobian @ jacobian.T / 2, atol=1e-11)
    np.testing.assert_allclose(first.covariance[0, 3:, 3:], np.eye(9) / 2, atol=1e-11)


C, PERIODS = 240, 90
DARK = range(40, 60)


@pytest.fixture(scope="module")
def flight():
    """Craft that turn and accelerate as the filter assumes; all are in the dark for a third of a second."""
    rng, yes = np.random.default_rng(11), np.ones(C, dtype=bool)
    bank = CompiledFilterBank(C)
    sigma = np.array([1e-3, 1e-3, 2e-3, 5e-4, 5e-4, 3e-3])
    covariance = np.stack([random_covariance(rng, sigma) for _ in range(C)])
    truth = State(exp(rng.normal(size=(C, 3))), *(s * rng.normal(size=(C, 3)) for s in (2.0, 0.5, 1.0)))
    none, root = np.zeros((C, 6, 6)), np.linalg.cholesky(covariance)
    history, truths = [], []
    for k in range(PERIODS):
        if k:
            truth = pushed(truth, rng, bank.acceleration_noise_m_s2, bank.angular_acceleration_noise_rad_s2)
        prediction = predicted(bank, DT, partial(bank.predict, DT, bank.active))
        drawn = np.einsum("cij,cj->ci", root, rng.normal(size=(C, 6)))
        rotation, position = exp(-drawn[:, :3]) @ truth.rotation, truth.position - drawn[:, 3:]
        if k == 0:
            bank.start(yes, rotation, position, covariance, (1.0, 0.5))
        elif k not in DARK:
            bank.update_pose(yes, rotation, position, covariance, none)
        history.append(kept(bank, prediction))
        truths.append(truth)
    return history, truths, smooth_all(history)


def nees(truth, estimates):
    e = error(truth, estimates.state)
    return np.einsum("ci,ci->c", e, np.linalg.solve(estimates.covariance, e[..., None])[..., 0])


@pytest.mark.parametrize("k", [0, 20, 41, 50, 59, 70, PERIODS - 1])
def test_it_is_consistent(flight, k):
    """The craft are independent: 12 degrees of freedom each, and a band that chance leaves once in 10 000 cases."""
    _, truths, smoothed = flight
    low, high = chi2.ppf([5e-5, 1 - 5e-5], STATES * C) / C
    assert low < nees(truths[k], smoothed[k]).mean() < high


def test_it_gains_on_the_filter_most_in_the_dark(flight):
    history, truths, smoothed = flight

    def rms(estimates, k):
        return np.sqrt(np.mean(error(truths[k], estimates.state)[:, POSE_COLUMNS] ** 2, axis=0))

    steady = [rms(history[k][1], k) / rms(smoothed[k], k) for k in (25, 75)]
    assert np.min(np.mean(steady, axis=0)) > 1.6
    # The end of the dark is the filter's worst instant, and the smoother's is its middle.
    assert np.all(rms(history[59][1], 59) > 4 * rms(smoothed[59], 59))
    for k in (0, 50, 59):
        variance = [np.trace(e.covariance, axis1=1, axis2=2) for e in (history[k][1], smoothed[k])]
        assert np.all(variance[1] < variance[0])


def test_a_craft_does_not_depend_on_others(flight):
    history, _, smoothed = flight
    only = slice(7, 8)
    alone = smooth_all(
        [
            (
                Prediction(p.continued[only], State(*(x[only] for x in p.state)), p.covariance[only],
                           p.transition[only]),
                Estimates(State(*(x[only] for x in e.state)), e.covariance[only]),
            )
            for p, e in history
        ]
    )  # fmt: skip
    for one, every in zip(alone, smoothed, strict=True):
        np.testing.assert_array_equal(one.covariance[0], every.covariance[7])
        np.testing.assert_array_equal(one.state.rotation[0], every.state.rotation[7])


def test_it_ends_where_a_filter_was_started_again():
    """Nothing of what came after a restart reaches back behind it, and a filter that is off has no smoothed state."""
    rng, bank, yes = np.random.default_rng(0), CompiledFilterBank(2), np.ones(2, dtype=bool)
    second = np.array([False, True])
    covariance = np.stack([random_covariance(rng, np.full(6, 1e-3))] * 2)
    here = np.stack([np.eye(3)] * 2), np.zeros((2, 3))
    history = []
    for k in range(8):
        prediction = predicted(bank, DT, partial(bank.predict, DT, bank.active))
        if k == 4:
            bank.stop(second)
        elif k in (0, 5):
            bank.start(yes if k == 0 else second, *here, covariance, (1.0, 0.5))
        else:
            bank.update_pose(bank.active, here[0], here[1] + 1e-3 * rng.normal(size=(2, 3)), covariance,
                             np.zeros((2, 6, 6)))  # fmt: skip
        history.append(kept(bank, prediction))
    smoothed = smooth_all(history)
    assert np.isnan(smoothed[4].state.position[1]).all()
    assert np.isnan(smoothed[4].covariance[1]).all()
    before = smooth_all(history[:4])
    for k in range(4):
        np.testing.assert_array_equal(smoothed[k].covariance[1], before[k].covariance[1])
        assert not np.array_equal(smoothed[k].covariance[0], before[k].covariance[0])
    np.testing.assert_array_equal(smoothed[3].state.position[1], history[3][1].state.position[1])


@pytest.mark.parametrize("kind", [FilterpyInteractingBank, CompiledInteractingBank])
def test_one_model_of_several_is_smoothed_as_a_filter_with_one(kind):
    """Craft whose bank could run several models, but which have one: the same smoother by another way."""
    rng, yes = np.random.default_rng(3), np.ones(2, dtype=bool)
    banks = [
        CompiledFilterBank(2, acceleration_noise_m_s2=0.2, angular_acceleration_noise_rad_s2=0.3),
        kind([(0.2, 0.3), (0.02, 0.03)], 30.0, 2.0, np.ones(2, dtype=np.int64)),
    ]
    covariance = np.stack([random_covariance(rng, np.full(6, 1e-3))] * 2)
    couplings = np.eye(6) + 1e-2 * rng.normal(size=(20, 2, 6, 6))
    still = np.zeros((2, 3))
    histories: tuple[list[Any], list[Any]] = ([], [])
    for k in range(20):
        rotation, position = exp(1e-3 * rng.normal(size=(2, 3))), 1e-3 * rng.normal(size=(2, 3))
        for bank, history in zip(banks, histories, strict=True):

            def move(bank=bank, k=k):
                bank.predict(DT, bank.active)
                if k:
                    bank.add_motion(yes, 1e-3 + still, still, still, still, couplings[k])
                return couplings[k] if k else None

            prediction = predicted(bank, DT, move)
            if k == 0:
                bank.start(yes, rotation, position, covariance, (1.0, 0.5))
            elif k not in (6, 7):
                bank.update_pose(yes, rotation, position, covariance, np.zeros((2, 6, 6)))
            history.append(kept(bank, prediction))
    for one, other in zip(*(smooth_all(history) for history in histories), strict=True):
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-7, atol=1e-15)
        np.testing.assert_allclose(other.state.position, one.state.position, atol=1e-12)
        np.testing.assert_allclose(other.state.rotation, one.state.rotation, atol=1e-12)


def test_models_of_motion_are_smoothed_by_what_shows_later():
    """Craft that manoeuvre all the time, and a filter that takes some of it for the motion of a quiet craft.

    Smoothed as if the mixture were one filter they have errors beyond their band; model by model they have not.
    """
    rng, c = np.random.default_rng(8), 160
    yes, none = np.ones(c, dtype=bool), np.zeros((c, 6, 6))
    noises = [(0.2 / 5**i, 0.3 / 5**i) for i in range(5)]
    bank = CompiledInteractingBank(noises, 30.0, 2.0, np.full(c, len(noises)))
    sigma = np.array([1e-3, 1e-3, 2e-3, 5e-4, 5e-4, 3e-3])
    covariance = np.stack([random_covariance(rng, sigma) for _ in range(c)])
    root = np.linalg.cholesky(covariance)
    truth = State(exp(rng.normal(size=(c, 3))), *(s * rng.normal(size=(c, 3)) for s in (2.0, 0.5, 1.0)))
    history, truths = [], []
    for k in range(120):
        truth = pushed(truth, rng, *noises[0])
        prediction = predicted(bank, DT, partial(bank.predict, DT, bank.active))
        drawn = np.einsum("cij,cj->ci", root, rng.normal(size=(c, 6)))
        rotation, position = exp(-drawn[:, :3]) @ truth.rotation, truth.position - drawn[:, 3:]
        if k == 0:
            bank.start(yes, rotation, position, covariance, (1.0, 0.5))
        else:
            bank.update_pose(yes, rotation, position, covariance, none)
        history.append(kept(bank, prediction))
        truths.append(truth)
    by_models = smooth_all(history)
    as_one = smooth_all([(prediction._replace(models=None), estimates) for prediction, estimates in history])
    instants = range(60, 110, 10)
    means = [np.mean([nees(truths[k], found[k]).mean() for k in instants]) for found in (by_models, as_one)]
    low, high = chi2.ppf([5e-5, 1 - 5e-5], STATES * c * len(instants)) / c / len(instants)
    assert low < means[0] < high < means[1]


def test_a_prediction_that_is_no_covariance_is_named():
    state = State(np.eye(3)[None], *np.zeros((3, 1, 3)))
    eye, yes = np.eye(STATES)[None], np.ones(1, dtype=bool)
    smoother = Smoother(1)
    smoother.step(Estimates(state, eye), Prediction(yes, state, -eye, eye))
    with pytest.raises(ValueError, match="craft 0 is not positive definite"):
        smoother.step(Estimates(state, eye), Prediction(yes, state, eye, eye))
