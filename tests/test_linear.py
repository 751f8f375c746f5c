"""Small positive definite systems against NumPy, and the word False where there is none."""

import numpy as np
import pytest

from estimators.arrays import Floats
from estimators.linear import (
    cholesky_into,
    invert_spd_into,
    invert_symmetric,
    solve_cholesky,
    solve_spd,
    sweep_out,
)

SIZES = [1, 2, 3, 6, 12]


def positive_definite(n: int, condition: float, seed: int) -> Floats:
    """A random symmetric matrix (n, n) with eigenvalues from 1 down to 1 / condition."""
    basis, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, n)))
    out = basis @ np.diag(np.geomspace(1, 1 / condition, n)) @ basis.T
    return np.asarray((out + out.T) / 2)


@pytest.mark.parametrize("n", SIZES)
def test_cholesky_is_numpy(n: int) -> None:
    for seed in range(20):
        a, lower = positive_definite(n, 1e4, seed), np.full((n, n), np.nan)
        assert cholesky_into(a, lower)
        # Backward stable: the error of L is the rounding, 1e-16, times the condition, 1e4, times n.
        np.testing.assert_allclose(lower, np.linalg.cholesky(a), atol=1e-11)
        np.testing.assert_allclose(lower @ lower.T, a, atol=1e-15 * n)


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("condition", [1.0, 1e4, 1e9])
def test_solution_and_inverse(n: int, condition: float) -> None:
    for seed in range(20):
        a, lower, inverse = positive_definite(n, condition, seed), np.empty((n, n)), np.empty((n, n))
        truth = np.random.default_rng(seed).standard_normal(n)
        b = a @ truth
        assert cholesky_into(a, lower)
        solve_cholesky(lower, b)
        # Error bound of Cholesky: some n roundings times the condition.
        np.testing.assert_allclose(b, truth, atol=1e-14 * n * condition)
        assert invert_spd_into(a, inverse)
        np.testing.assert_allclose(inverse @ a, np.eye(n), atol=1e-14 * n * condition)


@pytest.mark.parametrize("n", SIZES[1:])
def test_two_unknowns_that_enter_alike_are_false(n: int) -> None:
    for seed in range(50):
        rows = np.random.default_rng(seed).standard_normal((2 * n, n))
        rows[:, -1] = rows[:, 0]
        a, out = rows.T @ rows, np.full((n, n), 7.0)
        assert not invert_spd_into(a, out)
        assert (out == 7.0).all()


@pytest.mark.parametrize("n", SIZES[1:])
def test_singular_is_false_or_shows(n: int) -> None:
    for seed in range(50):
        rows = np.random.default_rng(seed).standard_normal((n - 1, n))
        a, inverse = rows.T @ rows, np.empty((n, n))
        # Rank n - 1: the last pivot is rounding, 1e-16, grown by the other pivots (here to 1e-12 at most). Where it
        # passes for a positive one, the share of an unknown that the others do not explain, 1 / (a_ii inverse_ii), is
        # of that size: a caller who must know the rank asks the geometry.
        if invert_spd_into(a, inverse):
            assert np.max(np.diag(a) * np.diag(inverse)) > 1e11


@pytest.mark.parametrize("a", [np.zeros((3, 3)), -np.eye(3), np.full((3, 3), np.nan), np.diag([1.0, -1.0, 1.0])])
def test_not_positive_definite_is_false(a: Floats) -> None:
    assert not cholesky_into(a, np.empty((3, 3)))


@pytest.mark.parametrize("n", SIZES)
def test_solve_spd_is_numpy_and_says_where_there_is_no_solution(n: int) -> None:
    for seed in range(20):
        a, b = positive_definite(n, 1e4, seed), np.random.default_rng(seed).standard_normal(n)
        x, lower = b.copy(), np.full((n, n), np.nan)
        assert solve_spd(a, lower, x)
        # Rounding, 1e-16, times the condition, 1e4, of a solution of size up to 1e4, some times over.
        np.testing.assert_allclose(x, np.linalg.solve(a, b), atol=1e-7)
        np.testing.assert_allclose(a @ x, b, atol=1e-10)
    assert not solve_spd(np.ones((n + 1, n + 1)), np.empty((n + 1, n + 1)), np.ones(n + 1))


@pytest.mark.parametrize("n", SIZES)
def test_the_inverse_of_a_symmetric_matrix_is_symmetric_and_says_where_there_is_none(n: int) -> None:
    for seed in range(20):
        a, row, out = positive_definite(n, 1e4, seed), np.empty(n), np.full((n, n), np.nan)
        assert invert_symmetric(np.where(np.tri(n) > 0, a, np.nan), row, out)
        np.testing.assert_array_equal(out, out.T)
        np.testing.assert_allclose(out, np.linalg.inv(a), atol=1e-7)
    assert not invert_symmetric(np.ones((n + 1, n + 1)), np.empty(n + 1), np.empty((n + 1, n + 1)))


def test_a_matrix_is_inverted_in_its_place() -> None:
    rng = np.random.default_rng(5)
    root = np.logspace(-1.5, 1.5, 12)[:, None] * rng.normal(size=(12, 20))
    a = root @ root.T
    out = a.copy()
    assert sweep_out(out, np.empty(12))
    np.testing.assert_allclose(out, np.linalg.inv(a), rtol=1e-7, atol=1e-12)
    assert not sweep_out(np.outer(a[0], a[0]), np.empty(12))
