"""Kernels read and write elements, and calculate with numbers of all kinds, as NumPy and Python do."""

from typing import Any

import numpy as np
import pytest

from estimators.arrays import Floats
from estimators.kernel import kernel


@kernel
def _inner(row: Floats, at: int) -> float:
    row[at] += 1
    return row[-1] + at


@kernel
def _use(a: Floats, strided: Floats, flags: Any, i: int, unsigned: Any, small: Any) -> tuple[float, ...]:
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k, -1] * 2 - a[-k, i] / 3
        a[k, 0] = k
        strided[-1, k, 0] = total
    strided[0][unsigned, 1] = 3
    flags[-1] = True
    flags[i] = a[0, 0] > strided[0, 0, 0] or not flags[0]
    row = strided[1]
    row[2, -2] = a[0][-1]
    total += _inner(a[1], i) + _inner(a[1], -i)
    whole = (7 * i - 3) // 2 % 4 + (unsigned & 1)
    return (
        total + whole,
        small * a[0, 1],
        abs(-i) + max(i, 1) - min(2.5, a[0, 1]),
        1.0 if flags[1] == flags[-1] else 0.0,
        row[-1, -1],
    )


@pytest.mark.filterwarnings("error")
def test_elements_and_operators_are_those_of_numpy() -> None:
    results = []
    for run in (_use, _use.py_func):  # type: ignore[attr-defined]
        rng = np.random.default_rng(0)
        a, flags = rng.normal(size=(3, 4)), np.zeros(4, dtype=np.bool_)
        strided = rng.normal(size=(2, 3, 8))[:, :, ::2]
        results.append((run(a, strided, flags, 2, np.uint32(1), np.float32(0.3)), a, strided, flags))
    compiled, plain = results
    for one, other in zip(compiled, plain, strict=True):
        np.testing.assert_array_equal(one, other)
