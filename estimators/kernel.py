"""The door to numba: `kernel` compiles a plain loop, cached on disk, without the GIL.

Kernels are written per craft, as loops that read like the equations, and mapped over the craft axis by
their caller; `np.linalg` stays out of them (it costs many seconds of compile time), and arrays are copied number by
number (an array assigned to a slice compiles numba's text of a wrong shape, 1.4 s). Some take four craft at once
(`estimators.lanes`).

Operators and elements of arrays compile by `estimators.kernel_elements`, which the cache imports: the machine code of
every kernel follows from it. Machine code is kept in `estimators.kernel_cache`, where an edit of a kernel or of a
constant compiles anew whatever rests on it, and nothing else.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.types import unliteral
from numba.extending import register_jitable

from estimators.kernel_cache import KernelCache
from estimators.kernel_compiler import KernelCompiler
from estimators.kernel_digest import INLINED

P = ParamSpec("P")
R = TypeVar("R")
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": False,
    "no_cfunc_wrapper": True,
    "pipeline_class": KernelCompiler,
}
"""No kernel is called from C."""
PART: dict[str, Any] = OPTIONS | {"no_cpython_wrapper": True}
"""What other kernels call takes and gives no objects of Python."""
_KERNELS: set[Any] = set()
"""The functions of all kernels of the modules that have been imported."""


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with numba: cached, NumPy's division by zero (inf, nan), strict IEEE order."""
    return _compiled(function, PART)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` as `kernel` does, for a place in what calls it: a call of its own hands every array over in
    seven words, which takes as long as the work where there are many arrays, and little work.
    """
    vars(function)[INLINED] = True
    return _compiled(function, PART | {"forceinline": True})


def _compiled(function: Callable[P, R], options: dict[str, Any]) -> Callable[P, R]:
    compiled: Callable[P, R] = numba.njit(**OPTIONS)(function)
    if isinstance(compiled, Dispatcher):  # not where NUMBA_DISABLE_JIT is set
        part: Any = numba.njit(**options)(function)
        compiled._cache = KernelCache(function)  # type: ignore[arg-type,attr-defined]
        part._cache = KernelCache(function, "part")  # type: ignore[arg-type]
        compiled.get_call_template = _of_any_value(part)  # type: ignore[assignment,method-assign]
        compiled.get_overload = part.get_overload  # type: ignore[method-assign]
        compiled._compiling_counter = part._compiling_counter  # a recursion is seen by it
        _KERNELS.add(function)
    return compiled


def formula(function: Callable[P, R]) -> Callable[P, R]:
    """Let kernels call `function` with numbers; from Python it stays what it is, and takes arrays as well."""
    shared: Callable[P, R] = register_jitable(function)
    return shared


def _of_any_value(compiled: Dispatcher) -> Callable[[Any, Any], Any]:
    """Return the kernel's way to compile for a call by another kernel, in which a constant counts as any value.

    By itself numba compiles once more for every constant of every call, such as a flag or the start of a count.
    """
    find = compiled.get_call_template

    def found(args: Any, kws: Any) -> Any:
        plain: Callable[[Any], Any] = unliteral
        return find([plain(a) for a in args], {name: plain(a) for name, a in kws.items()})

    return found


class Compilation(NamedTuple):
    """The state of compiling.

    busy: a kernel is being compiled. done: number of kernels compiled so far.
    """

    busy: bool
    done: int


class _Counter(event.Listener):
    def __init__(self, tell: Callable[[Compilation], None]) -> None:
        self._tell, self._depth = tell, 0
        self._done: set[Any] = set()

    def on_start(self, event: Any) -> None:
        self._depth += 1
        self._say()

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        function = event.data["dispatcher"].py_func
        if function in _KERNELS:  # else a function of numba's own
            self._done.add(function)
        self._say()

    def _say(self) -> None:
        self._tell(Compilation(self._depth > 0, len(self._done)))


@contextmanager
def told_of_compilation(tell: Callable[[Compilation], None]) -> Iterator[None]:
    """Within the block, call `tell` with the state of compiling as each kernel begins and ends.

    What comes out of the cache on disk is not compiled, and not told.
    """
    counter = _Counter(tell)
    event.register("numba:compile", counter)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        event.unregister("numba:compile", counter)  # type: ignore[no-untyped-call]
