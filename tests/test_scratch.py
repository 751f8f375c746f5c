"""Arrays on the stack: of numbers and of lanes, each with memory of its own, also in a loop and in what is called."""

import numpy as np

from estimators.arrays import Floats
from estimators.kernel import kernel
from estimators.lanes import lanes_in
from estimators.scratch import scratch

ROWS = 3


@kernel
def row_times(row: Floats, factor: float) -> float:
    """The sum of a row, times a factor, by an array of its own."""
    own = scratch(row, ROWS)
    for i in range(ROWS):
        own[i] = factor * row[i]
    return own[0] + own[1] + own[2]


@kernel
def gram(given: Floats, out: Floats) -> None:
    """Write A^T A of matrices (N, 3, 3), scaled, by arrays that are asked for in every round."""
    for n in range(len(given)):
        product, other = scratch(given, ROWS, ROWS), scratch(given, ROWS, ROWS)
        for i in range(ROWS):
            for j in range(ROWS):
                other[i, j] = -given[n, i, j]
                product[i, j] = given[n, 0, i] * given[n, 0, j]
                for k in range(1, ROWS):
                    product[i, j] += given[n, k, i] * given[n, k, j]
        for i in range(ROWS):
            for j in range(ROWS):
                out[n, i, j] = product[i, j] + 0.0 * other[i, j]
            out[n, i, i] = row_times(product[i], 2.0)


@kernel
def gram_of_lanes(given: Floats, out: Floats) -> None:
    gram(lanes_in(given), lanes_in(out))


def test_numbers_and_lanes_have_the_same_bits_as_arrays_of_numpys() -> None:
    # Whole numbers: no sum of them is rounded, whether fused or not.
    given = np.random.default_rng(4).integers(-99, 100, (5, 3, 3, 4)).astype(float)
    out, alone = np.empty_like(given), np.empty((5, 3, 3))
    gram_of_lanes(given, out)
    for lane in range(4):
        gram(np.ascontiguousarray(given[..., lane]), alone)
        assert out[..., lane].tobytes() == alone.tobytes()
    a = given[..., 0]
    wanted = a[:, 0, :, None] * a[:, 0, None] + a[:, 1, :, None] * a[:, 1, None] + a[:, 2, :, None] * a[:, 2, None]
    sums = 2.0 * wanted[..., 0] + 2.0 * wanted[..., 1] + 2.0 * wanted[..., 2]
    wanted[:, [0, 1, 2], [0, 1, 2]] = sums
    np.testing.assert_array_equal(out[..., 0], wanted)


def test_from_python_it_is_an_array() -> None:
    assert scratch(0.0, 2, 3).shape == (2, 3)
