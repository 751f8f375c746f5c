"""The cache of compiled kernels on disk: one file per kernel, argument types and processor.

A file's name follows from what the machine code follows from, and from nothing else, neither from the place of the
source nor from its time: the same version of the code finds its machine code again after a reinstallation, in another
virtual environment and in a working tree. Files are written whole and moved into place, so that any number of
processes may share the folder.
"""

import hashlib
import os
import pickle
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache, cached_property
from glob import escape
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba.core import config
from numba.core.caching import _Cache as NumbaCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from platformdirs import user_cache_path

from estimators.kernel_compiler import SOURCE as COMPILER
from estimators.kernel_compiler import part_from_cache
from estimators.kernel_digest import KernelDigest
from estimators.kernel_elements import SOURCE
from estimators.kernel_fusion import SOURCE as FUSION

KEPT_FOR_S = 90 * 86400.0
"""Files that no process has loaded for so long are removed when a new one is written, s."""
TOUCHED_EVERY_S = 86400.0
"""A file that is loaded has its time set anew if it is older than this, s."""
_LOST: set[str] = set()
"""Names of the kernels that could not be written to the folder."""


class KernelCache(NumbaCache):
    """The cache of one kernel, in the form that numba's dispatcher calls.

    A folder that cannot be written leaves the kernel uncached; it never stops the program.
    """

    def __init__(self, function: FunctionType, form: str = "") -> None:
        """Keep the machine code of `function`, in one of the forms that it is compiled in."""
        self._function, self._form = function, form
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder that holds the files."""
        return str(folder())

    def enable(self) -> None:
        """Load from the folder and write to it."""
        self._enabled = True

    def disable(self) -> None:
        """Leave the folder alone."""
        self._enabled = False

    def flush(self) -> None:
        """Remove the files of this kernel, those of all its versions."""
        for file in folder().glob(f"{escape(self._name)}.*.nbc"):
            with suppress(OSError):
                file.unlink()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for the argument types `sig`, or None where the folder does not hold it."""
        if not self._enabled:
            return None
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        file = self._file(key)
        try:
            written, payload = pickle.loads(file.read_bytes())
            _touch(file)
        except Exception:
            # Whatever a damaged or a foreign pickle raises: the kernel is compiled anew.
            return None
        if written != key:
            return None
        rebuild = part_from_cache if self._form else CompileResult._rebuild
        return rebuild(target_context, *payload)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled kernel `data` for the argument types `sig`, unless the folder cannot be written."""
        if not self._enabled or data.library.has_dynamic_globals:
            return
        key = self._key(sig, data.codegen)
        try:
            _write(self._file(key), dumps((key, data._reduce())))  # type: ignore[no-untyped-call]
        except OSError:
            _LOST.add(self._name)

    @cached_property
    def _name(self) -> str:
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        return name.replace("<", "").replace(">", "")

    @cached_property
    def _digest(self) -> str:
        # Not before it is asked for: what the kernel calls may be defined further down in its file.
        return KernelDigest().of(self._function)

    @property
    def _version(self) -> tuple[Any, ...]:
        return numba.__version__, sys.version_info[:2], SOURCE, COMPILER, FUSION, self._digest

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return (sig, self._form, codegen.magic_tuple(), *self._version)

    def _file(self, key: tuple[Any, ...]) -> Path:
        return folder() / f"{self._name}.{_short(self._version)}.{_short(key)}.nbc"


def _short(key: tuple[Any, ...]) -> str:
    return hashlib.sha256(repr(key).encode()).hexdigest()[:24]


@cache
def folder() -> Path:
    """Return the folder of the cache: `NUMBA_CACHE_DIR` where it is set, else the user's cache of this program.

    Where neither can be written, it is a folder beside the code.
    """
    chosen = config.CACHE_DIR  # type: ignore[attr-defined]
    wanted = (
        [Path(chosen)]
        if chosen
        else [user_cache_path("lighthouse-swarm") / "kernels", Path(__file__).parent / "__pycache__"]
    )
    for place in wanted:
        with suppress(OSError):
            place.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=place):
                return place
    return wanted[0]


def kept() -> bool:
    """Return whether kernels are kept for the next run: whether all that were compiled could be written to `folder`."""
    return not _LOST and os.access(folder(), os.W_OK)


def _write(file: Path, data: bytes) -> None:
    _remove_old_files(file.parent)
    number, name = tempfile.mkstemp(dir=file.parent, suffix=".partial")
    try:
        with os.fdopen(number, "wb") as partial:
            partial.write(data)
        Path(name).replace(file)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


@cache
def _remove_old_files(place: Path) -> None:
    """Remove the files that no process has loaded for a long time, once per process."""
    oldest = time.time() - KEPT_FOR_S
    for file in place.glob("*.nbc"):
        with suppress(OSError):
            if file.stat().st_mtime < oldest:
                file.unlink()


def _touch(file: Path) -> None:
    with suppress(OSError):
        if file.stat().st_mtime < time.time() - TOUCHED_EVERY_S:
            os.utime(file)
