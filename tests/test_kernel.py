"""Kernels in the cache on disk: what an edit compiles again, seen from outside, in programs that share a cache."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import cast

import pytest

from estimators import kernel_cache
from estimators.kernel import inlined
from estimators.kernel_digest import KernelDigest

ROOT = Path(__file__).parents[1]
INNER = """
from estimators.kernel import kernel

STEP = 1.0

@kernel
def inner(x):
    return x + STEP
"""
OUTER = """
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from estimators.kernel import kernel
from rest.inner import STEP, inner

class Kind(IntEnum):
    ONE = 1
    TWO = 2

class Pair(NamedTuple):
    a: float
    b: float

TABLE = np.array([0.0, 100.0])
BOTH = Pair(0.0, 1000.0)

@kernel
def outer(x, n):
    made = Pair(0.0, x)
    return inner(made.b) + 10 * STEP + TABLE[Kind.ONE] + BOTH.b + later(n) + ping(n)

@kernel
def later(n):
    return 0 if n <= 0 else later(n - 1) + 10000

@kernel
def ping(n):
    return 0.0 if n <= 0 else later(0)
"""
PROGRAM = """
from estimators.kernel import told_of_compilation
from rest.outer import outer
told = []
with told_of_compilation(told.append):
    print(outer(0.5, 2))
print(max((state.done for state in told), default=0))
"""
FIRST = 1.5 + 10 + 100 + 1000 + 20000


class Package:
    """The package `rest`, its kernels, and the cache that they share."""

    def __init__(self, place: Path) -> None:
        self.folder = place / "site" / "rest"
        self.environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(place / "site"), str(ROOT)]),
            "NUMBA_CACHE_DIR": str(place / "cache"),
            # Python's own cache goes by times and sizes, which these tests forge.
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        self.folder.mkdir(parents=True)
        for name, text in (("__init__", ""), ("inner", INNER), ("outer", OUTER)):
            (self.folder / f"{name}.py").write_text(text)

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace text by other text of the same length, and leave the file's times as they were."""
        file = self.folder / f"{name}.py"
        text, times = file.read_text(), file.stat()
        assert text.count(old) == 1
        assert len(old) == len(new)
        file.write_text(text.replace(old, new))
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))

    def run(self) -> tuple[float, int]:
        """What `outer(0.5, 2)` is, in a new process, and how many kernels that compiled."""
        command = [sys.executable, "-c", PROGRAM]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        value, compiled = done.stdout.split()
        return float(value), int(compiled)


@pytest.fixture
def package(tmp_path: Path) -> Package:
    return Package(tmp_path)


def test_an_edit_below_a_kernel_compiles_it_again(package: Package) -> None:
    value, compiled = package.run()
    assert value == FIRST
    assert compiled > 0
    assert package.run() == (FIRST, 0), "unedited, all comes out of the cache"
    package.edit("inner", "x + STEP", "x - STEP")
    value, compiled = package.run()
    assert value == FIRST - 2
    assert compiled == 2, "inner and outer, and not the kernels beside them"
    package.edit("inner", "STEP = 1.0", "STEP = 3.0")
    assert package.run()[0] == FIRST - 2 - 2 + 20, "STEP counts once in inner and ten times in outer"
    package.edit("inner", "STEP = 3.0", "STEP = 1.0")
    assert package.run() == (FIRST - 2, 0), "what was compiled before an edit serves again after it is taken back"


def test_an_edit_of_a_constant_in_the_same_file(package: Package) -> None:
    value = FIRST
    assert package.run()[0] == value
    for old, new, change in (
        ("100.0]", "200.0]", 100),
        ("ONE = 1", "ONE = 0", -200),
        ("1000.0)", "2000.0)", 1000),
        ("+ 10000", "+ 20000", 20000),
    ):
        package.edit("outer", old, new)
        value += change
        assert package.run()[0] == value, new
    assert package.run() == (value, 0)


def test_the_digest_tells_whether_callers_take_a_kernel_into_themselves() -> None:
    def part(x: float) -> float:
        return x + 1

    def caller(x: float) -> float:
        return part(x)

    plain = KernelDigest().of(cast(FunctionType, caller))
    assert KernelDigest().of(cast(FunctionType, caller)) == plain
    inlined(part)
    assert KernelDigest().of(cast(FunctionType, caller)) != plain


@pytest.fixture
def homed(package: Package, tmp_path: Path) -> Package:
    """Return the package with a home of its own, and no folder named for the cache."""
    package.environment.pop("NUMBA_CACHE_DIR")
    package.environment |= {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}
    return package


def test_the_same_code_in_another_place_is_not_compiled_again(homed: Package, tmp_path: Path) -> None:
    assert homed.run()[0] == FIRST
    shutil.move(tmp_path / "site", tmp_path / "elsewhere")
    homed.environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path / "elsewhere"), str(ROOT)])
    assert homed.run() == (FIRST, 0)
    assert list((tmp_path / "home" / "lighthouse-swarm" / "kernels").glob("rest.outer.outer.*.nbc"))


def test_files_that_nothing_loads_are_removed(package: Package, tmp_path: Path) -> None:
    assert package.run()[0] == FIRST
    cache = tmp_path / "cache"
    used_no_more = [*cache.glob("rest.outer.outer.*.nbc"), *cache.glob("rest.inner.inner.*.nbc")]
    still_used = [*cache.glob("rest.outer.later.*.nbc"), *cache.glob("rest.outer.ping.*.nbc")]
    assert len(used_no_more) == 2
    assert still_used
    for file in cache.glob("*.nbc"):  # last loaded 100 days ago
        os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 100 * 86400))
    package.edit("inner", "x + STEP", "x - STEP")
    assert package.run()[0] == FIRST - 2
    assert not [file for file in used_no_more if file.exists()]
    assert [file for file in still_used if file.exists()] == still_used


def test_a_damaged_file_is_compiled_anew(package: Package, tmp_path: Path) -> None:
    assert package.run()[0] == FIRST
    for number, file in enumerate(sorted((tmp_path / "cache").glob("*.nbc"))):
        file.write_bytes([b"", b"no pickle", file.read_bytes()[:100], b"cnowhere\nnothing\n."][number % 4])
    assert package.run()[0] == FIRST
    assert package.run() == (FIRST, 0)


def test_kernels_that_could_not_be_written_are_not_promised_to_the_next_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(file))

    monkeypatch.setattr(kernel_cache, "_LOST", set())
    monkeypatch.setattr(kernel_cache, "_write", full)
    monkeypatch.setattr(kernel_cache, "folder", lambda: ROOT)
    compiled = SimpleNamespace(
        library=SimpleNamespace(has_dynamic_globals=False),
        codegen=SimpleNamespace(magic_tuple=lambda: ("x86",)),
        _reduce=lambda: (),
    )
    assert kernel_cache.kept()
    kernel_cache.KernelCache(cast(FunctionType, full)).save_overload((), compiled)
    assert not kernel_cache.kept()


def test_where_no_folder_can_be_written_it_compiles_each_time(homed: Package, tmp_path: Path) -> None:
    # A file in the way of a folder stops root too.
    (tmp_path / "home").write_text("")
    (homed.folder.parent / "estimators").symlink_to(ROOT / "estimators")
    homed.environment["NUMBA_CACHE_DIR"] = str(tmp_path / "home" / "cache")
    first, again = homed.run(), homed.run()
    assert first[0] == FIRST
    assert first == again
    assert again[1] > 0
