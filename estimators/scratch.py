"""Small arrays for a kernel's own use, on the stack: nothing is allocated, freed or counted.

Their shapes are constants of the kernel, so that LLVM knows the place of every element, and that no other array shares
their memory. They hold whatever was there, and end with the kernel that makes them: it must not give them back.
"""

import hashlib
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import types
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array, populate_array

from estimators.arrays import Floats

KERNEL_SOURCE = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
"""Stands for this file in the digests of kernels."""
_ALIGNMENT = 64
"""Bytes, of a line of the processor's cache."""


def scratch(like: float | Floats, *shape: int) -> Floats:
    """Return an array of this shape, of numbers or of lanes as `like` is; in Python, of numbers.

    Args:
        like: a number, lanes, or an array of either.
        shape: constants.
    """
    return np.empty(shape)


@infer_global(scratch)
class _Scratch(AbstractTemplate):
    key = scratch

    def generic(self, args: Any, kws: Any) -> Any:
        """Type the array, once numba asks with the values of constants."""
        like, shape = args[0], args[1:]
        if kws or not shape or not all(isinstance(one, types.IntegerLiteral) for one in shape):
            return None
        element = like.dtype if isinstance(like, types.Array) else types.unliteral(like)
        element = types.float64 if isinstance(element, types.Number) else element
        return signature(types.Array(element, len(shape), "C", aligned=element == types.float64), like, *shape)


@lower_builtin(scratch, types.Any, types.VarArg(types.Any))
def _on_the_stack(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    shape = [one.literal_value for one in sig.args[1:]]
    element = context.get_data_type(sig.return_type.dtype)
    size = context.get_abi_sizeof(element)
    with builder.goto_entry_block():  # once, also where it is asked for in a loop
        memory = builder.alloca(ir.ArrayType(element, prod(shape)))
    memory.align = _ALIGNMENT
    array = make_array(sig.return_type)(context, builder)
    populate_array(
        array,
        data=builder.bitcast(memory, array.data.type),
        shape=[context.get_constant(types.intp, one) for one in shape],
        strides=[context.get_constant(types.intp, size * prod(shape[axis + 1 :])) for axis in range(len(shape))],
        itemsize=context.get_constant(types.intp, size),
        meminfo=None,
    )
    return impl_ret_borrowed(context, builder, sig.return_type, array._getvalue())
