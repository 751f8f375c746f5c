"""The one door to numba: `kernel` compiles a plain loop, cached on disk, without the GIL.

Kernels are written per craft, as loops that read like the equations, and mapped over the craft axis by
their caller; `np.linalg` stays out of them (it costs many seconds of compile time).

Machine code is kept in `estimators.kernel_cache`, where an edit of a kernel or of a constant compiles anew whatever
rests on it, and nothing else.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.types import unliteral
from numba.extending import register_jitable

from estimators.kernel_cache import KernelCache

P = ParamSpec("P")
R = TypeVar("R")
_KERNELS: list[Dispatcher] = []
"""Every kernel of the modules that have been imported."""


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` with numba: cached, NumPy's division by zero (inf, nan), strict IEEE order."""
    compiled: Callable[P, R] = numba.njit(nogil=True, error_model="numpy", fastmath=False)(function)
    if isinstance(compiled, Dispatcher):  # not where NUMBA_DISABLE_JIT is set
        compiled._cache = KernelCache(function)  # type: ignore[arg-type,attr-defined]
        compiled.get_call_template = _of_any_value(compiled)  # type: ignore[method-assign]
        _KERNELS.append(compiled)
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
        return find([unliteral(a) for a in args], {name: unliteral(a) for name, a in kws.items()})

    return found


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
