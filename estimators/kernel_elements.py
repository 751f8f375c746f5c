"""Operators of numbers and elements of arrays, for a compiler that finds their types at once.

By itself numba asks every function that has ever been registered for an operator, texts' and sets' too, about the types
of its operands, each time that it meets the operator, and indexes an array by a general routine for slices, masks and
new axes. Half of the time that a kernel took to compile went there. Here numba is asked once per operator and types of
numbers, and an element whose index has one integer per axis is read or written by its address. The values, and what an
index below zero means, stay numba's.
"""

import hashlib
import operator
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.imputils import RefType, iternext_impl
from numba.core.typing.arraydecl import get_array_index_type
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.cpython import rangeobj as rangeobj  # whose lowering of a range is to stand before ours
from numba.extending import lower_builtin
from numba.np.arrayobj import load_item, store_item

SOURCE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
"""Stands for this file in the cache of kernels: the machine code of every kernel follows from it."""
OPERATORS = (
    *(operator.add, operator.iadd, operator.sub, operator.isub, operator.mul, operator.imul),
    *(operator.truediv, operator.itruediv, operator.floordiv, operator.mod, operator.neg, operator.and_, operator.or_),
    *(operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne, bool, abs, min, max),
)
"""Functions of numbers about whose types numba is asked once."""
_DATA, _SHAPE, _STRIDES = 4, 5, 6
"""Places in numba's record of an array."""
_Answer = tuple[Any, Any]


def _element(array: Any, index: Any) -> Any:
    """Name the reading of one element of an array."""
    return array[index]


def _set_element(array: Any, index: Any, value: Any) -> None:
    """Name the writing of one element of an array."""
    array[index] = value


class _First(AbstractTemplate):
    """Types of a call, asked for before numba's own."""

    metadata = {"target": "cpu"}  # noqa: RUF012
    implemented_by: Any = None

    def get_impl_key(self, sig: Any) -> Any:
        """Return what the call is lowered as."""
        return self.implemented_by or super().get_impl_key(sig)


def _remember(function: Any) -> None:
    """Ask numba once per types of numbers what `function` makes of them."""
    answers: dict[tuple[Any, ...], _Answer] = {}

    class Remembered(_First):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            if kws or not all(isinstance(a, types.Number | types.Boolean) for a in args):
                return None
            if any(isinstance(a, types.Literal) for a in args):
                return None
            if args not in answers:
                known = self.context.resolve_value_type(function).templates
                others = types.Function(tuple(t for t in known if t is not Remembered))
                sig: Any = others.get_call_type(self.context, args, {})
                answers[args] = sig, others.get_impl_key(sig)
            sig, self.implemented_by = answers[args]
            return sig

    infer_global(function, types.Function(Remembered))


for _operator in OPERATORS:
    _remember(_operator)


def _of_element(array: Any, index: Any) -> Any:
    """Return the type of the index, one integer per axis, or None where it is another index."""
    if not isinstance(array, types.Array) or isinstance(index, types.Literal):
        return None
    several = isinstance(index, types.BaseTuple)
    kinds = tuple(index) if several else (index,)
    if array.ndim == 0 or len(kinds) != array.ndim or not all(isinstance(kind, types.Integer) for kind in kinds):
        return None
    found = get_array_index_type(array, index)
    return found.index


@infer_global(operator.getitem)
class _GetElement(_First):
    key = operator.getitem
    implemented_by = staticmethod(_element)

    def generic(self, args: Any, kws: Any) -> Any:
        """Type the reading of an element."""
        index = _of_element(*args)
        return None if index is None else signature(args[0].dtype, args[0], index)


@infer_global(operator.setitem)
class _SetElement(_First):
    key = operator.setitem
    implemented_by = staticmethod(_set_element)

    def generic(self, args: Any, kws: Any) -> Any:
        """Type the writing of an element, of the array's type or of one that becomes it."""
        array, index, value = args
        kind = _of_element(array, index)
        if kind is None or not array.mutable or not array.dtype.is_precise() or isinstance(value, types.Array):
            return None
        if not self.context.can_convert(value, array.dtype):
            return None
        return signature(types.none, array, kind, value)


def _part(builder: Any, whole: Any, *place: int) -> Any:
    """Return a member of a record: itself where the record was put together in sight."""
    while isinstance(whole, ir.instructions.InsertValue):
        if tuple(whole.indices) == place:
            return whole.operands[1]
        if tuple(whole.indices) == place[: len(whole.indices)]:
            break
        whole = whole.operands[0]
    return builder.extract_value(whole, list(place))


def _integers(context: Any, builder: Any, kind: Any, index: Any) -> list[tuple[Any, Any]]:
    """Return each axis's index and its type."""
    if not isinstance(kind, types.BaseTuple):
        return [(index, kind)]
    kinds: Any = kind
    return [(_part(builder, index, at), one) for at, one in enumerate(kinds)]


def _address(context: Any, builder: Any, array_type: Any, array: Any, indices: Sequence[tuple[Any, Any]]) -> Any:
    """Return the address of an element; an index below zero counts from the end."""
    data, offset = _part(builder, array, _DATA), None
    for axis, (index, kind) in enumerate(indices):
        at = context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)
        constant = isinstance(at, ir.Constant) and isinstance(at.constant, int) and at.constant >= 0
        if kind.signed and not constant:
            beyond = builder.add(at, _part(builder, array, _SHAPE, axis))
            at = builder.select(builder.icmp_signed("<", at, ir.Constant(at.type, 0)), beyond, at)
        if array_type.layout != "C":
            step = builder.mul(at, _part(builder, array, _STRIDES, axis))
            offset = step if offset is None else builder.add(offset, step)
        elif offset is None:
            offset = at
        else:
            offset = builder.add(builder.mul(offset, _part(builder, array, _SHAPE, axis)), at)
    if array_type.layout == "C":
        return builder.gep(data, [offset])
    bytes_from = builder.bitcast(data, ir.IntType(8).as_pointer())
    return builder.bitcast(builder.gep(bytes_from, [offset]), data.type)


@lower_builtin(_element, types.Array, types.Any)
def _load(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array, index = args
    indices = _integers(context, builder, sig.args[1], index)
    return load_item(context, builder, sig.args[0], _address(context, builder, sig.args[0], array, indices))


@lower_builtin(_set_element, types.Array, types.Any, types.Any)
def _store(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    array, index, value = args
    indices = _integers(context, builder, sig.args[1], index)
    kept = context.cast(builder, value, sig.args[2], sig.args[0].dtype)
    store_item(context, builder, sig.args[0], kept, _address(context, builder, sig.args[0], array, indices))


@lower_builtin("iternext", types.range_iter64_type)
@iternext_impl(RefType.UNTRACKED)
def _next_of_range(context: Any, builder: Any, sig: Any, args: Any, result: Any) -> None:
    """Lower the next number of a range as numba does, and say that it does not run over: an index that counts upwards
    from zero or more is then known to be so.
    """
    state = cgutils.create_struct_proxy(types.range_iter64_type)(context, builder, args[0])
    left, value = builder.load(state.count), builder.load(state.iter)
    one = ir.Constant(left.type, 1)
    more = builder.icmp_signed(">", left, ir.Constant(left.type, 0))
    result.set_valid(more)
    with builder.if_then(more):
        result.yield_(value)
        builder.store(builder.sub(left, one, flags=["nsw"]), state.count)
        builder.store(builder.add(value, state.step, flags=["nsw"]), state.iter)
