"""The one door to numba: `kernel` compiles a plain loop, cached on disk, without the GIL.

Kernels are written per craft, as loops that read like the equations, and mapped over the craft axis by
their caller; `np.linalg` stays out of them (it costs many seconds of compile time).

By itself numba keeps machine code for as long as the kernel's own file stays the same, whatever becomes of what the
kernel calls or reads elsewhere. Here the key in the cache has a digest too, of the kernel's code and of everything that
its globals stand for: an edit of a kernel or of a constant compiles anew whatever rests on it, and nothing else.
"""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import cached_property
from types import CodeType, FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with numba: cached, NumPy's division by zero (inf, nan), strict IEEE order."""
    compiled: Callable[P, R] = numba.njit(nogil=True, error_model="numpy", fastmath=False)(function)
    if isinstance(compiled, Dispatcher):  # not where NUMBA_DISABLE_JIT is set
        compiled._cache = _Cache(function)  # type: ignore[attr-defined,no-untyped-call]
    return compiled


def formula(function: Callable[P, R]) -> Callable[P, R]:
    """Let kernels call `function` with numbers; from Python it stays what it is, and takes arrays as well."""
    shared: Callable[P, R] = register_jitable(function)
    return shared


class _Cache(FunctionCache):
    """The cache that numba's `cache=True` installs, with keys that know what a kernel is made of."""

    @cached_property
    def _digest(self) -> str:
        # Not before it is asked for: what the kernel calls may be defined further down in its file.
        return _Digest().of(self._py_func)

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        key: tuple[Any, ...] = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, self._digest)


class _Digest:
    """A hash of what a function's machine code follows from, beside its arguments' types and the processor.

    Functions count by their bytecode, which is what numba compiles, whatever has become of the file since.
    """

    def __init__(self) -> None:
        self._sha = hashlib.sha256()
        self._seen: dict[FunctionType, int] = {}

    def of(self, function: FunctionType) -> str:
        """The digest, in hexadecimal."""
        self._add(function)
        return self._sha.hexdigest()

    def _say(self, *words: object) -> None:
        self._sha.update(f"{words!r};".encode())

    def _add(self, value: object) -> None:
        if isinstance(value, Dispatcher):
            value = value.py_func
        if isinstance(value, FunctionType):
            self._add_function(value)
        elif isinstance(value, Enum):
            self._say(type(value).__name__, value.name)
            self._add(value.value)
        elif isinstance(value, bool | int | float | complex | str | bytes | np.generic) or value is None:
            self._say(type(value).__name__, repr(value))
        elif isinstance(value, np.ndarray):
            self._say("array", value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest())
        elif isinstance(value, tuple):
            self._say(type(value).__name__, getattr(value, "_fields", ()), len(value))
            for inner in value:
                self._add(inner)
        elif isinstance(value, frozenset):
            self._say("set", sorted(map(repr, value)))
        elif isinstance(value, type):
            self._say("class", value.__name__, getattr(value, "_fields", ()))
            for member in value if issubclass(value, Enum) else ():
                self._add(member)
        else:
            # A ufunc or a built-in: its library's, and no kernel can take more of it than its name.
            self._say(type(value).__name__, getattr(value, "__name__", ""))

    def _add_function(self, function: FunctionType) -> None:
        known = function in self._seen
        self._say("function", self._seen.setdefault(function, len(self._seen)))
        if known:  # a recursion, or one that is called from two places
            return
        names = self._add_code(function.__code__)
        self._add(function.__defaults__ or ())
        for cell in function.__closure__ or ():
            self._add(cell.cell_contents)
        for name in sorted(names & function.__globals__.keys()):
            value = function.__globals__[name]
            self._say("global", name)
            if isinstance(value, ModuleType):
                self._add_module(value, names)
            else:
                self._add(value)

    def _add_code(self, code: CodeType) -> set[str]:
        """Add bytecode and constants; all names in it, of globals and of attributes, nested functions' too."""
        self._say(code.co_code, code.co_varnames, code.co_names, code.co_freevars, code.co_cellvars)
        names = set(code.co_names)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                names |= self._add_code(constant)
            else:
                self._add(constant)
        return names

    def _add_module(self, module: ModuleType, names: set[str]) -> None:
        """A library by its version; what may be taken of a module of our own, by `module.name`, one by one."""
        self._say("module", module.__name__, getattr(module, "__version__", ""))
        library = module.__name__.partition(".")[0]
        if library in ("math", "cmath", "numpy", "numba"):
            return
        for name in sorted(names & vars(module).keys()):
            value = vars(module)[name]
            if not isinstance(value, ModuleType):
                self._say("attribute", name)
                self._add(value)


class _Counter(event.Listener):
    def __init__(self, tell: Callable[[int], None]) -> None:
        self._tell, self._done = tell, 0

    def on_start(self, event: Any) -> None:
        self._tell(self._done)

    def on_end(self, event: Any) -> None:
        self._done += 1
        self._tell(self._done)


@contextmanager
def told_of_compilation(tell: Callable[[int], None]) -> Iterator[None]:
    """Within the block, call `tell` with the number of kernels compiled so far as each one begins and ends.

    What comes out of the cache on disk is not compiled, and not told.
    """
    counter = _Counter(tell)
    event.register("numba:compile", counter)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", counter)  # type: ignore[no-untyped-call]
