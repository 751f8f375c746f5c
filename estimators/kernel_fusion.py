"""Products in sums, fused: `a * b + c` with one rounding, which is one instruction of a processor and not two.

A pass of the compiler finds them as C's contraction does, within an expression: `a * b + c`, `c - a * b`, `c += a * b`
and their like, of numbers or of lanes. Which products are fused follows from the source alone, the right one of two in
`a * b + c * d`, and neither from what LLVM makes of loops nor from how many lanes there are, so that lanes have the
bits of numbers. A product that has a name is rounded by itself.

A processor that cannot fuse rounds twice; its results differ by rounding.
"""

import hashlib
import operator
import platform
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from llvmlite import ir as llvm  # type: ignore[import-untyped]
from llvmlite.binding import get_host_cpu_features  # type: ignore[import-untyped]
from numba.core import ir, types
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin

from estimators.lanes import is_lanes

FUSES = bool(get_host_cpu_features().get("fma", False)) or platform.machine().lower() in ("arm64", "aarch64")
"""Whether the processor has the instruction."""
SOURCE = f"{hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]}, {FUSES}"
"""Stands for this file in the cache of kernels."""
_MUL = (operator.mul, operator.imul)
_ADD = (operator.add, operator.iadd)
_SUB = (operator.sub, operator.isub)


def sum_of_product(a: float, b: float, c: float) -> float:
    """Return a b + c, of numbers or of lanes, rounded once.

    Args:
        a: a factor.
        b: the other one.
        c: what is added to the product.
    """
    raise NotImplementedError


def product_less(a: float, b: float, c: float) -> float:
    """Return a b - c, of numbers or of lanes, rounded once.

    Args:
        a: a factor.
        b: the other one.
        c: what is taken off the product.
    """
    raise NotImplementedError


def less_product(a: float, b: float, c: float) -> float:
    """Return c - a b, of numbers or of lanes, rounded once.

    Args:
        a: a factor.
        b: the other one.
        c: what the product is taken off.
    """
    raise NotImplementedError


def _is_real(kind: Any) -> bool:
    return kind == types.float64 or is_lanes(kind)


def _define(function: Any, minus_product: bool, minus_rest: bool) -> None:
    """Let kernels call `function`, of which the product or the rest counts with the opposite sign."""

    class Typed(AbstractTemplate):
        key = function
        metadata = {"target": "cpu"}  # noqa: RUF012

        def generic(self, args: Any, kws: Any) -> Any:
            return signature(args[0], *args) if len({*args}) == 1 and _is_real(args[0]) else None

    infer_global(function, types.Function(Typed))

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b, c = args
        if minus_product:
            a = builder.fneg(a)
        if minus_rest:
            c = builder.fneg(c)
        return builder.fma(a, b, c) if isinstance(a.type, llvm.DoubleType) else _fused_lanes(builder, a, b, c)

    lower_builtin(function, types.Any, types.Any, types.Any)(lower)


def _fused_lanes(builder: Any, a: Any, b: Any, c: Any) -> Any:
    kind = llvm.FunctionType(a.type, [a.type] * 3)
    name = f"llvm.fma.v{a.type.count}f64"
    function = builder.module.globals.get(name) or llvm.Function(builder.module, kind, name)
    return builder.call(function, [a, b, c])


_define(sum_of_product, minus_product=False, minus_rest=False)
_define(product_less, minus_product=False, minus_rest=True)
_define(less_product, minus_product=True, minus_rest=False)


@register_pass(mutates_CFG=False, analysis_only=False)
class FuseProducts(FunctionPass):
    """Put a fused call into the place of each sum that has a product in it, once types are known."""

    _name = "fuse_products"

    def __init__(self) -> None:
        """Begin as every pass of numba does."""
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Rewrite the kernel of `state`; return whether anything has changed."""
        if not FUSES:
            return False
        blocks = state.func_ir.blocks.values()
        uses = Counter(var.name for block in blocks for statement in block.body for var in _used(statement))
        return sum(_fuse_block(block, uses, state) for block in blocks) > 0


def _used(statement: Any) -> Iterator[Any]:
    """Yield the variables that an assignment reads, as often as it does, and all those of other statements."""
    value = statement.value if isinstance(statement, ir.Assign) else None
    if isinstance(value, ir.Var):
        yield value
    elif isinstance(value, ir.Expr) and value.op in ("binop", "inplace_binop"):
        yield value.lhs
        yield value.rhs
    elif isinstance(value, ir.Expr) or value is None:
        yield from (value or statement).list_vars()


def _fuse_block(block: Any, uses: Counter[str], state: Any) -> int:
    """Rewrite the sums of a block that have a product; return how many there were.

    Args:
        block: of numba's representation of a kernel, changed in place.
        uses: how often each variable of the kernel is read.
        state: of the compiler.
    """
    products: dict[str, Any] = {}
    body: list[Any] = []
    fused = 0
    for statement in block.body:
        body.append(statement)
        expression = statement.value if isinstance(statement, ir.Assign) else None
        if not isinstance(expression, ir.Expr) or expression.op not in ("binop", "inplace_binop"):
            continue
        name = statement.target.name
        if not _is_real(state.typemap[name]):
            continue
        if expression.fn in _MUL and name.startswith("$") and uses[name] == 1:
            products[name] = statement
            continue
        for at, side in ((1, expression.rhs), (0, expression.lhs)):
            if expression.fn in _ADD + _SUB and side.name in products:
                product = products.pop(side.name)
                body.remove(product)
                body[-1:] = _fused(statement, product, at, state)
                fused += 1
                break
    block.body = body
    return fused


def _fused(statement: Any, product: Any, at: int, state: Any) -> list[Any]:
    """Return the statements of a sum whose operand `at`, 0 or 1, is a product."""
    total, times, kind = statement.value, product.value, state.typemap[statement.target.name]
    less, rest = (less_product, total.lhs) if at else (product_less, total.rhs)
    function = sum_of_product if total.fn in _ADD else less
    called = ir.Var(statement.target.scope, f"$fused.{statement.target.name}", statement.loc)
    state.typemap[called.name] = callee = state.typingctx.resolve_value_type(function)
    call = ir.Expr.call(called, [times.lhs, times.rhs, rest], (), statement.loc)
    state.calltypes[call] = callee.get_call_type(state.typingctx, (kind,) * 3, {})
    for old in (total, times):
        state.calltypes.pop(old)
    return [
        ir.Assign(ir.Global(function.__name__, function, statement.loc), called, statement.loc),
        ir.Assign(call, statement.target, statement.loc),
    ]
