"""The compiler of kernels: numba's, without the steps that no kernel needs.

A kernel is compiled once, from loops over numbers and arrays, so that much of numba's general way is spent for nothing:

- passes for closures, generators' closures, `with` and lists of several types, and an analysis of all variables after
  each pass, of which only the last is read;
- Python's cyclic garbage collector, which goes through the compiler's millions of live objects again and again;
- counts of references: a kernel that makes no array has none to free (`_makes_arrays`);
- LLVM's passes over single functions and its cheap ones over the module, which the full ones over the module repeat;
- machine code of what only other kernels call: LLVM compiles it within each of them.

The values are numba's: the same operations, in the same order.
"""

import gc
import hashlib
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from llvmlite.binding import parse_bitcode  # type: ignore[import-untyped]
from numba.core import ir, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, _make_subtarget, compile_result
from numba.core.compiler_machinery import PassManager
from numba.core.runtime.nrt import rtsys
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NoPythonSupportedFeatureValidation,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from estimators.kernel_fusion import FuseProducts
from estimators.lanes import fours_in, lanes_in, wide_in
from estimators.scratch import scratch

SOURCE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
"""Stands for this file in the cache of kernels."""
_VIEWS = {
    *("getattr", "static_getitem", "getitem", "typed_getitem", "build_tuple", "exhaust_iter", "pair_first"),
    *("pair_second", "getiter", "iternext", "cast", "phi", "null", "undef"),
}
"""Expressions that make no array: numbers, tuples, and views of arrays that there are."""
_UNCOUNTED = len, lanes_in, wide_in, fours_in, scratch
"""Functions of arrays that make none of which references are counted."""


@contextmanager
def _uncollected() -> Iterator[None]:
    """Let the cyclic garbage collector rest within the block."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class KernelCompiler(CompilerBase):
    """Compile one kernel for one set of argument types."""

    def __init__(self, typing_context: Any, target_context: Any, *rest: Any) -> None:
        """Take what every compiler of numba takes."""
        super().__init__(typing_context, target_context, *rest)
        self._target = target_context

    def compile_extra(self, func: Any) -> Any:
        """Compile a function without the garbage collector."""
        with _uncollected():
            return super().compile_extra(func)

    def define_pipelines(self) -> list[PassManager]:
        """Return the one way in which kernels are compiled."""
        return [_Passes("kernel")]

    def choose_library(self) -> None:
        """Choose what the kernel is made into: with counts of references or without, and by itself or as a part."""
        state = self.state
        counts = _makes_arrays(state)
        if not counts:
            flags = state.flags.copy()
            flags.nrt = False
            state.targetctx = _make_subtarget(self._target, flags)
        kind = PartLibrary if state.flags.no_cpython_wrapper else KernelLibrary
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.counts_references = counts
        state.library.enable_object_caching()


class _Passes(PassManager):
    """Passes one after the other, without the analysis of all variables after each."""

    def run(self, state: Any) -> None:
        for kind in _BEFORE:
            self._run(kind, state)
        state.pipeline.choose_library()
        for kind in (NativeLowering, NoPythonBackend):
            self._run(kind, state)

    def _run(self, kind: Any, state: Any) -> None:
        one = kind()
        one.analysis = defaultdict(set)  # no pass here takes in what another has found
        one.run_initialization(state)
        one.run_pass(state)
        one.run_finalizer(state)


class KernelLibrary(JITCodeLibrary):
    """Machine code of a kernel, after LLVM's full optimisation and no other."""

    counts_references = True

    def add_linking_library(self, library: Any) -> None:
        """Link another library, unless it only counts references, of which there are none."""
        if self.counts_references or library is not rtsys.library:
            super().add_linking_library(library)

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _NoEngine:
    """A generator of code that loads no machine code."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def set_env(self, name: str, environment: Any) -> None:
        """Leave the objects of Python that a kernel refers to alone: no part refers to any."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)


class PartLibrary(KernelLibrary):
    """LLVM's code of what other kernels call, which is compiled within theirs; it has no machine code of its own."""

    @property
    def codegen(self) -> Any:
        """The generator of code, which loads nothing."""
        return _NoEngine(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:
        """Return the null pointer: a part is not called from Python."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return the library's name and LLVM's code."""
        self._ensure_finalized()
        return self.name, self._get_module_for_linking().as_bitcode()

    def load(self, code: bytes) -> None:
        """Take LLVM's code from the cache."""
        self._final_module = parse_bitcode(code)
        self._finalized = True

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


def part_from_cache(target: Any, library: tuple[str, bytes], description: Any, environment: Any, *rest: Any) -> Any:
    """Return a compiled part as numba knows it.

    Args:
        target: numba's target context.
        library: name and LLVM's code, as `PartLibrary` gives them.
        description: numba's description of the function.
        environment: objects of Python that the function refers to.
        rest: signature, and whatever else `CompileResult` keeps in its file.
    """
    name, code = library
    loaded = PartLibrary(target.codegen(), name)
    loaded.load(code)
    signature, _, _, annotation, reload_init, _ = rest
    return compile_result(
        target_context=target,
        typing_context=target.typing_context,
        library=loaded,
        environment=environment,
        entry_point=target.get_executable(loaded, description, environment),
        fndesc=description,
        type_annotation=annotation,
        signature=signature,
        objectmode=False,
        lifted=(),
        reload_init=reload_init,
        referenced_envs=(),
    )


def _makes_arrays(state: Any) -> bool:
    """Return whether a kernel may make an array, or give one back, so that references to it have to be counted."""
    models, kinds = state.targetctx.data_model_manager, state.typemap

    def counted(*values: Any) -> bool:
        return any(models[kinds[value.name]].contains_nrt_meminfo() for value in values)

    def may_make(statement: Any) -> bool:
        if isinstance(statement, ir.SetItem | ir.StaticSetItem):
            return counted(statement.value)  # several elements at once
        if not isinstance(statement, ir.Assign):
            return not isinstance(statement, ir.Branch | ir.Jump | ir.Return | ir.Del)
        expression, result = statement.value, statement.target
        if not isinstance(expression, ir.Expr):
            return False
        if expression.op in ("binop", "inplace_binop", "unary"):
            return counted(result)
        if expression.op == "getitem" and counted(result):
            return counted(expression.index)  # a list of places copies; a slice does not
        if expression.op == "call":
            called = kinds[expression.func.name]
            if isinstance(called, types.Dispatcher):
                return counted(result)
            if isinstance(called, types.NamedTupleClass) or getattr(called, "typing_key", None) in _UNCOUNTED:
                return False
            return counted(result, *expression.args)
        return expression.op not in _VIEWS

    if state.func_ir.is_generator or models[state.return_type].contains_nrt_meminfo():
        return True
    return any(may_make(statement) for block in state.func_ir.blocks.values() for statement in block.body)


_BEFORE: tuple[Any, ...] = (
    *(TranslateByteCode, FixupArgs, IRProcessing, RewriteSemanticConstants, DeadBranchPrune, GenericRewrites),
    *(ReconstructSSA, DeadBranchPrune, NopythonTypeInference, FuseProducts, PreLowerStripPhis),
    *(NoPythonSupportedFeatureValidation, IRLegalization, AnnotateTypes),
)
"""Numba's passes before the lowering, those that a kernel needs, and one of ours."""
