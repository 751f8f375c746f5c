"""The compiler of kernels: numba's values, references counted where there are arrays to free, parts in the cache."""

import gc
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.runtime.nrt import rtsys

from estimators.arrays import Floats
from estimators.kernel import OPTIONS, kernel
from estimators.kernel_compiler import KernelLibrary, PartLibrary

PLAIN = {name: value for name, value in OPTIONS.items() if name != "pipeline_class"}


class Pair(NamedTuple):
    first: Floats
    second: Floats


def _length(row: Floats) -> float:
    total = 0.0
    for i in range(len(row)):
        total += row[i] * row[i]
    return float(np.sqrt(total))


length = kernel(_length)


def _by_views(pair: Pair, out: Floats) -> int:
    """Take rows, tuples and a named tuple apart, and make no array."""
    both = pair.first, pair.second
    for i in range(out.shape[0]):
        row, other = both[0][i], both[1][i, 1:]
        out[i] = length(row) / length(other) if length(other) > 0 else np.nan
    return len(out)


def _by_arrays(pair: Pair, out: Floats) -> Floats:
    """Make arrays, and give one back."""
    work = np.empty(3)
    for i in range(out.shape[0]):
        for j in range(3):
            work[j] = pair.first[i, j] * pair.second[i, j]
        out[i] = length(work)
    return out * 2.0


def _gathered(pair: Pair, out: Floats) -> int:
    """Make an array by a list of places."""
    rows = pair.first[np.array([0, 1])]
    out[0] = rows[1, 2]
    return 1


def _copied(pair: Pair, out: Floats) -> int:
    """Write several elements at once."""
    out[:3] = pair.first[1]
    return 3


def _factorial(n: int) -> int:
    return 1 if n < 2 else n * factorial(n - 1)


factorial = kernel(_factorial)


@pytest.fixture
def pair() -> Pair:
    return Pair(*np.random.default_rng(1).standard_normal((2, 500, 3)))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("estimators.kernel_cache.folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def counting() -> Iterator[None]:
    """Numba's counts of what is allocated and freed."""
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


def library(compiled: Any) -> Any:
    (overload,) = compiled.overloads.values()
    return overload.library


def part_of(compiled: Any) -> Any:
    """Return numba's dispatcher of what other kernels call."""
    return compiled.get_overload.__self__


@pytest.mark.parametrize(
    ("function", "counts"), [(_by_views, False), (_by_arrays, True), (_gathered, True), (_copied, True)]
)
def test_values_are_numbas_and_references_are_counted_where_arrays_are_made(function, counts, pair, counting):
    ours, theirs = kernel(function), numba.njit(**PLAIN)(function)
    out, wanted = np.zeros(500), np.zeros(500)
    given = np.asarray(ours(pair, out)), np.asarray(theirs(pair, wanted))
    np.testing.assert_array_equal(out, wanted)
    np.testing.assert_array_equal(*given)
    assert isinstance(library(ours), KernelLibrary)
    assert library(ours).counts_references == counts
    before, held = rtsys.get_allocation_stats(), [sys.getrefcount(x) for x in (*pair, out)]
    for _ in range(100):
        ours(pair, out)
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free
    assert counts or after.alloc == before.alloc
    assert [sys.getrefcount(x) for x in (*pair, out)] == held


def test_a_kernel_that_calls_itself_is_compiled():
    assert [factorial(n) for n in (1, 5, 10)] == [1, 120, 3628800]


def test_parts_have_no_machine_code_and_come_back_from_the_cache(folder, pair):
    """A caller that is compiled later, with its part from the cache, gives the same values."""
    first, second = np.zeros(500), np.zeros(500)
    kernel(_by_views)(pair, first)
    part = library(part_of(length))
    assert isinstance(part, PartLibrary)
    part_of(length).overloads.clear()
    (file,) = folder.glob("*_by_views*")
    file.unlink()
    kernel(_by_views)(pair, second)
    assert library(part_of(length)) is not part
    np.testing.assert_array_equal(first, second)


def test_the_garbage_collector_is_as_it_was(pair):
    assert gc.isenabled()
    kernel(_by_views)(pair, np.zeros(500))
    assert gc.isenabled()
