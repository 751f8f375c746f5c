"""The digest of a kernel: a hash of all that its machine code follows from, wherever in the code it stands.

By itself numba keeps machine code for as long as the kernel's own file stays the same, whatever becomes of what the
kernel calls or reads elsewhere. The digest covers the kernel's bytecode and everything that its globals stand for: an
edit of a kernel or of a constant changes the digest of whatever rests on it, and of nothing else.
"""

import hashlib
from enum import Enum
from types import CodeType, FunctionType, ModuleType

import numpy as np
from numba.core.dispatcher import Dispatcher

INLINED = "inlined"
"""Attribute of a function whose machine code stands in that of its callers."""


class KernelDigest:
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
        if INLINED in vars(function):
            self._say(INLINED)
        # A file that extends numba says what stands for it: machine code follows from more than bytecode there.
        self._add(function.__globals__.get("KERNEL_SOURCE"))
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
