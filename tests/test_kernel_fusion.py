"""Products in sums: one rounding each, found in the source, the same for numbers and for lanes."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.kernel_fusion import FUSES
from estimators.lanes import WIDE, wide_in

ROWS = 200
fused = pytest.mark.skipif(not FUSES, reason="this processor has no fused multiply-add")


@kernel
def sums(given: Floats, out: Floats) -> None:
    """Sums with products in them, of numbers or of lanes: given (ROWS, 4), out (9, ROWS)."""
    for i in range(given.shape[0]):
        a, b, c, d = given[i, 0], given[i, 1], given[i, 2], given[i, 3]
        named = a * b
        total = c
        total += a * b
        less = c
        less -= a * b
        out[0, i] = a * b + c
        out[1, i] = c - a * b
        out[2, i] = a * b - c
        out[3, i] = total
        out[4, i] = less
        out[5, i] = c * d + a * b
        out[6, i] = a * b + c * d + a * d
        out[7, i] = named + c
        out[8, i] = 3 * i * a + i


@kernel
def sums_of_lanes(given: Floats, out: Floats) -> None:
    sums(wide_in(given), wide_in(out))


def exactly(row: Floats) -> list[float]:
    """The sums of a row with one rounding for each product in a sum, by exact fractions."""
    a, b, c, d = map(Fraction, row)
    first = Fraction(float(c * d + Fraction(float(a * b))))
    plus, minus = float(a * b + c), float(c - a * b)
    # Of two products the right one is exact.
    return [plus, minus, float(a * b - c), plus, minus, float(Fraction(float(c * d)) + a * b), float(first + a * d)]


@fused
def test_a_product_in_a_sum_is_rounded_with_it() -> None:
    given = np.random.default_rng(3).standard_normal((ROWS, 4))
    out = np.empty((9, ROWS))
    sums(given, out)
    np.testing.assert_array_equal(out[:7].T, [exactly(row) for row in given])


def test_a_product_that_has_a_name_is_rounded_by_itself() -> None:
    given = np.random.default_rng(4).standard_normal((ROWS, 4))
    out = np.empty((9, ROWS))
    sums(given, out)
    a, b, c, _ = given.T
    assert (out[7] == a * b + c).all()


@fused
def test_whole_numbers_join_in() -> None:
    given = np.random.default_rng(5).standard_normal((ROWS, 4))
    out = np.empty((9, ROWS))
    sums(given, out)
    assert out[8].tolist() == [float(Fraction(3 * i) * Fraction(one) + i) for i, one in enumerate(given[:, 0])]


def test_lanes_have_the_bits_of_numbers() -> None:
    given = np.random.default_rng(6).standard_normal((ROWS, 4, WIDE))
    wide, alone = np.empty((9, ROWS, WIDE)), np.empty((9, ROWS))
    sums_of_lanes(given, wide)
    for at in range(WIDE):
        sums(np.ascontiguousarray(given[..., at]), alone)
        assert (wide[..., at] == alone).all()


@kernel
def by_conditions(given: Floats, out: Floats) -> None:
    for i in range(given.shape[0]):
        a, b, c = given[i, 0], given[i, 1], given[i, 2]
        out[i] = a * b + (c if c > 0 else 2 * c)


@kernel
def by_whole_numbers(given: Floats, out: Floats) -> None:
    for i in range(given.shape[0]):
        out[i] = given[2 * i - i, i % 2 * 3 - i % 2]


@pytest.mark.parametrize(
    ("function", "wanted"),
    [
        (by_conditions, lambda row, i: row[0] * row[1] + (row[2] if row[2] > 0 else 2 * row[2])),
        (by_whole_numbers, lambda row, i: row[i % 2 * 2]),
    ],
)
def test_sums_across_branches_and_of_whole_numbers_stay_right(
    function: Callable[[Floats, Floats], None], wanted: Callable[[Floats, int], float]
) -> None:
    given = np.random.default_rng(7).standard_normal((ROWS, 4))
    out = np.empty(ROWS)
    function(given, out)
    np.testing.assert_allclose(out, [wanted(row, i) for i, row in enumerate(given)], rtol=1e-14, atol=1e-15)
