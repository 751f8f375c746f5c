"""An observer's own error in its target's filter: as in a filter of both that estimates but one."""

import numpy as np
import pytest

from estimators.filter.error_state import process_noise_into, transition_into
from estimators.filter.filterpy_bank import PoseFilterBank
from swarm.onboard.own_error import OwnErrors, own_part

DT, NOISE = 0.1, (0.2, 0.2)
ARM, AGE_S = np.array([3.0, -1.0, 0.5]), -0.04


def spread(rng, size, scale=1.0):
    a = rng.standard_normal((size, size))
    return scale * (a @ a.T / size + 0.1 * np.eye(size))


def bank_of(covariance):
    bank = PoseFilterBank(1, gate_probability=1 - 1e-12)
    still = np.zeros((1, 3))
    bank.start(np.array([True]), np.eye(3)[None], still, 1e-2 * np.eye(6)[None], (0.1, 0.1), np.zeros((1, 6, 6)))
    bank.adopt(np.array([True]), bank.state, covariance[None].copy())
    return bank


def test_an_update_is_that_of_a_filter_of_both_errors():
    """Schmidt's: the gain of the target's rows of the joint filter, none for the observer's."""
    rng = np.random.default_rng(0)
    joint = spread(rng, 24, 1e-4)
    p, c, o = joint[:12, :12], joint[:12, 12:], joint[12:, 12:]
    h, a, r = rng.standard_normal((6, 12)), own_part(ARM, AGE_S), spread(rng, 6, 1e-5)
    both = np.hstack([h, -a])
    gain = joint @ both.T @ np.linalg.inv(both @ joint @ both.T + r)
    gain[12:] = 0
    left = np.eye(24) - gain @ both
    wanted = left @ joint @ left.T + gain @ r @ gain.T
    errors = OwnErrors([(0, 0)], *NOISE)
    errors._correlation[0, 0] = c.copy()
    known, noise = errors.decorrelated(0, 0, p, h, a, a @ o @ a.T + r)
    bank = bank_of(p)
    assert bank.update(np.array([True]), np.zeros((1, 6)), known[None], noise[None]).accepted[0]
    errors.update(0, 0, gain[:12], h, a, o)
    assert known @ p @ known.T + noise == pytest.approx(both @ joint @ both.T + r, rel=1e-9, abs=1e-15)
    assert bank.covariance[0] == pytest.approx(wanted[:12, :12], rel=1e-6, abs=1e-12)
    assert errors._correlation[0, 0] == pytest.approx(wanted[:12, 12:], rel=1e-9, abs=1e-15)


def test_what_an_own_filter_keeps_of_its_error_is_read_off_its_covariances():
    """E[x o^T] after a period: C M^T with M = (I - K H) F of the own filter, whatever it measured."""
    rng = np.random.default_rng(1)
    rate, before = np.array([0.3, -0.2, 0.1]), spread(rng, 12, 1e-4)
    f, q = np.empty((12, 12)), np.empty((12, 12))
    transition_into(rate, DT, f)
    process_noise_into(DT, *NOISE, q)
    predicted = f @ before @ f.T + q
    h, r = rng.standard_normal((4, 12)), spread(rng, 4, 1e-4)
    gain = predicted @ h.T @ np.linalg.inv(h @ predicted @ h.T + r)
    left = np.eye(12) - gain @ h
    errors, c = OwnErrors([(0, 0)], *NOISE), spread(rng, 12, 1e-4)
    errors.predict(DT, np.eye(12)[None], {0: (rate, before)})
    errors._correlation[0, 0] = c.copy()
    errors.predict(DT, np.eye(12)[None], {0: (rate, left @ predicted)})
    assert errors._correlation[0, 0] == pytest.approx(c @ (left @ f).T, rel=1e-6, abs=1e-12)
    # A filter that starts anew has a new error.
    errors.predict(DT, np.eye(12)[None], {0: (rate, 100 * predicted)})
    assert not errors._correlation[0, 0].any()
