"""The filter's door for rows, y = H x + noise: both banks against a textbook Kalman update, and poses as a caller."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.error_state import innovation_into
from estimators.filter.filterpy_bank import PoseFilterBank

T, COUNT = 1 / 60, 5
BANKS: list[type[FilterBank]] = [PoseFilterBank, CompiledFilterBank]
SCALE = np.repeat([1e-3, 0.1, 1e-3, 0.05], 3)
"""Sizes of an error state: attitude, angular rate, position, velocity."""


def every(count: int = COUNT) -> Bools:
    return np.ones(count, dtype=np.bool_)


def covariance(rng: np.random.Generator, rows: int, scale: float = 1e-3) -> Floats:
    root = scale * rng.standard_normal((COUNT, rows, rows))
    return np.asarray(root @ np.swapaxes(root, 1, 2) + (0.1 * scale) ** 2 * np.eye(rows))


def started(kind: type[FilterBank], seed: int, **options: float) -> FilterBank:
    """A bank some periods on, whose covariance has correlations of every kind."""
    rng, bank = np.random.default_rng(seed), kind(COUNT, **options)
    pose = rot.exp(rng.standard_normal((COUNT, 3))), rng.standard_normal((COUNT, 3))
    bank.start(every(), *pose, covariance(rng, 6), (0.5, 0.2), T / 4 * rng.uniform(-1, 1, (COUNT, 6, 6)))
    for _ in range(4):
        bank.predict(T, every())
    return bank


def rows_of(rng: np.random.Generator, bank: FilterBank, rows: int) -> tuple[Floats, Floats, Floats]:
    """Consistent measurements: H of every size, and y drawn from H P H^T + R."""
    h = rng.standard_normal((COUNT, rows, 12)) / SCALE * 1e-3
    r = covariance(rng, rows)
    s = h @ bank.covariance @ np.swapaxes(h, 1, 2) + r
    return (np.linalg.cholesky(s) @ rng.standard_normal((COUNT, rows, 1)))[..., 0], h, r


def textbook(p: Floats, y: Floats, h: Floats, r: Floats) -> tuple[Floats, Floats, float]:
    """x = K y, P = (I - K H) P and NIS of one craft, K = P H^T S^-1."""
    s = h @ p @ h.T + r
    gain = np.linalg.solve(s, h @ p).T
    return gain @ y, (np.eye(12) - gain @ h) @ p, float(y @ np.linalg.solve(s, y))


@pytest.mark.parametrize("kind", BANKS)
@pytest.mark.parametrize("rows", range(1, 9))
def test_update_is_the_textbooks(kind: type[FilterBank], rows: int) -> None:
    rng, bank = np.random.default_rng(rows), started(kind, rows, gate_probability=1.0)
    y, h, r = rows_of(rng, bank, rows)
    before, p = bank.state, bank.covariance
    result = bank.update(every(), y, h, r)
    after = bank.state
    assert result.accepted.all()
    for c in range(COUNT):
        x, expected, nis = textbook(p[c], y[c], h[c], r[c])
        # S has a condition of some 1e4: nine digits are left of it, in units of the error state.
        np.testing.assert_allclose(
            bank.covariance[c] / np.outer(SCALE, SCALE), expected / np.outer(SCALE, SCALE), atol=1e-9
        )
        assert result.nis[c] == pytest.approx(nis, rel=1e-9)
        np.testing.assert_allclose(after.rotation[c], rot.exp(x[:3]) @ before.rotation[c], rtol=0, atol=1e-12)
        moved = np.concatenate(
            [
                after.angular_rate[c] - before.angular_rate[c],
                after.position[c] - before.position[c],
                after.velocity[c] - before.velocity[c],
            ]
        )
        np.testing.assert_allclose(moved, x[3:], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rows", range(1, 9))
def test_both_banks_agree_where_craft_have_different_numbers_of_rows(rows: int) -> None:
    banks = [started(kind, 10 + rows, gate_probability=0.8) for kind in BANKS]
    count = np.random.default_rng(rows).integers(0, rows + 1, COUNT)
    for period in range(20):
        given = rows_of(np.random.default_rng(100 * rows + period), banks[0], rows)
        results = [bank.update(every(), *given, count) for bank in banks]
        np.testing.assert_array_equal(results[0].accepted, results[1].accepted)
        np.testing.assert_array_equal(results[0].accepted & (count == 0), False)
        np.testing.assert_array_equal(np.isnan(results[0].nis), count == 0)
        np.testing.assert_allclose(results[0].nis, results[1].nis, rtol=1e-9)
        for name in ("rotation", "angular_rate", "position", "velocity", "covariance"):
            one, other = (getattr(bank, name) for bank in banks)
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12, err_msg=name)
            for bank in banks:
                bank.predict(0.0, every())


@pytest.mark.parametrize("kind", BANKS)
def test_rows_beyond_the_count_are_not_read(kind: type[FilterBank]) -> None:
    one, other = started(kind, 3), started(kind, 3)
    y, h, r = rows_of(np.random.default_rng(3), one, 2)
    more: list[Any] = [np.full((COUNT, 5), np.nan), np.full((COUNT, 5, 12), np.nan), np.full((COUNT, 5, 5), np.nan)]
    more[0][:, :2], more[1][:, :2], more[2][:, :2, :2] = y, h, r
    results = one.update(every(), y, h, r), other.update(every(), more[0], more[1], more[2], np.full(COUNT, 2))
    np.testing.assert_array_equal(results[0].nis, results[1].nis)
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize("kind", BANKS)
@pytest.mark.parametrize("rows", [1, 3, 8])
def test_the_gate_goes_by_the_number_of_rows(kind: type[FilterBank], rows: int) -> None:
    bank, gate = started(kind, 4, gate_probability=0.99), float(chi2.ppf(0.99, rows))
    y, h, r = rows_of(np.random.default_rng(5), bank, rows)
    s = h @ bank.covariance @ np.swapaxes(h, 1, 2) + r
    size = np.sqrt([y[c] @ np.linalg.solve(s[c], y[c]) for c in range(COUNT)])
    wanted = np.sqrt(gate) * np.array([0.5, 0.999, 1.001, 2.0, 0.9])
    before = bank.position
    result = bank.update(every(), y * (wanted / size)[:, None], h, r)
    assert result.accepted.tolist() == [True, True, False, False, True]
    np.testing.assert_allclose(result.nis, wanted**2, rtol=1e-9)
    np.testing.assert_array_equal((bank.position == before).all(axis=1), ~result.accepted)


@pytest.mark.parametrize("kind", BANKS)
def test_a_pose_is_six_rows(kind: type[FilterBank]) -> None:
    one, other, rng = started(kind, 6), started(kind, 6), np.random.default_rng(6)
    seen = rot.exp(1e-3 * rng.standard_normal((COUNT, 3))) @ one.rotation, one.position + 1e-3
    r, coupling = covariance(rng, 6), T / 4 * rng.uniform(-1, 1, (COUNT, 6, 6))
    y, h = np.empty((COUNT, 6)), np.empty((COUNT, 6, 12))
    for c in range(COUNT):
        innovation_into(seen[0][c], seen[1][c], one.rotation[c], one.position[c], coupling[c], y[c], h[c])
    by_rows, by_pose = one.update(every(), y, h, r), other.update_pose(every(), *seen, r, coupling)
    np.testing.assert_array_equal(by_rows.nis, by_pose.nis)
    np.testing.assert_array_equal(one.covariance, other.covariance)
    np.testing.assert_array_equal(one.state.rotation, other.state.rotation)


@pytest.mark.parametrize("kind", BANKS)
def test_mistakes_name_the_argument(kind: type[FilterBank]) -> None:
    bank = started(kind, 7)
    y, h, r = rows_of(np.random.default_rng(7), bank, 3)
    for name, given in (
        ("y", (y[0], h, r)),
        ("y", (y + np.nan, h, r)),
        ("h", (y, h[:, :, :6], r)),
        ("r", (y, h, r[:, :2])),
        ("r", (y, h, -r)),
        ("count", (y, h, r, np.full(COUNT, 4))),
    ):
        before = bank.covariance
        with pytest.raises(ValueError, match=rf"^{name}: "):
            bank.update(every(), *given)
        np.testing.assert_array_equal(bank.covariance, before)
