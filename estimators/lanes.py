"""Four or eight numbers side by side: types of numba that are one vector of doubles of LLVM, <4 x double>.

A kernel that is written with operators, `select` and the functions here takes a number, or the numbers of several craft
at once: lane by lane the same operations in the same order, so that the bits are those of as many calls with numbers.
Nothing is reassociated, and what is fused follows from the source (`estimators.kernel_fusion`). On a processor without
AVX, LLVM makes two operations with two lanes of each.

There are LANES, four, for what comes in fours, and wide ones, `WIDE` of them, for what comes in any number: eight on a
processor with AVX-512, else four. Wide lanes hold FOURS fours side by side.

A comparison of lanes is a mask, which `&`, `|`, `opposite`, `select`, `all_of` and `any_of` take; there is no branch by
a mask. Numbers become equal lanes where they meet lanes. An array of doubles (..., LANES) becomes an array of lanes
(...) by `lanes_in`, and one (..., WIDE) by `wide_in`: its elements are read and written by index, as those of any
array. Fours become wide lanes by `beside`, and are read out of an array of these by `fours_in`.

Types are told to Python as `float` and `bool`. In Python the functions do what they do for one number.
"""

import hashlib
import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from llvmlite.binding import get_host_cpu_features  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, models, register_model, type_callable
from numba.np.arrayobj import make_array, populate_array

from estimators.arrays import Floats

LANES = 4
"""Numbers side by side."""
WIDE = 2 * LANES if get_host_cpu_features().get("avx512f", False) else LANES
"""Numbers side by side where any number of them serves: as many as a vector of this processor holds."""

FOURS = WIDE // LANES
"""Fours in wide lanes: two or one."""
KERNEL_SOURCE = f"{hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]}, {WIDE}"
"""Stands for this file in the digests of kernels: what it makes of an operator is not in their bytecode."""

_DOUBLE, _WORD = ir.DoubleType(), ir.IntType(64)
_Make = Callable[..., Any]


class _Lanes(types.Type):
    """Doubles side by side."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Lanes{count}({KERNEL_SOURCE})")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Numbers become lanes."""
        return Conversion.safe if _is_number(other) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is a number first, and lanes then, is lanes."""
        return self if _is_number(other) else None


class _Mask(types.Type):
    """As many truth values, words of ones or zeros."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Mask{count}({KERNEL_SOURCE})")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A truth value becomes a mask."""
        return Conversion.safe if isinstance(other, types.Boolean) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is a truth value first, and a mask then, is a mask."""
        return self if isinstance(other, types.Boolean) else None


def _is_number(kind: Any) -> bool:
    return isinstance(kind, types.Float | types.Integer)


_lanes, _mask = _Lanes(LANES), _Mask(LANES)
_wide, _wide_mask = _Lanes(WIDE), _Mask(WIDE)


def _doubles(kind: Any) -> Any:
    return ir.VectorType(_DOUBLE, kind.count)


def _words(kind: Any) -> Any:
    return ir.VectorType(_WORD, kind.count)


def _equal(kind: Any, one: Any) -> Any:
    """Return a constant vector of equal numbers."""
    return ir.Constant(kind, [one] * kind.count)


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _doubles(fe_type))


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _words(fe_type))


def _vector(builder: Any, kind: Any, parts: Sequence[Any]) -> Any:
    out = ir.Constant(kind, ir.Undefined)
    for at, part in enumerate(parts):
        out = builder.insert_element(out, part, ir.Constant(ir.IntType(32), at))
    return out


def _splat(builder: Any, kind: Any, one: Any) -> Any:
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), one, ir.Constant(ir.IntType(32), 0))
    places = _equal(ir.VectorType(ir.IntType(32), kind.count), 0)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), places)


def _bits(builder: Any, mask: Any) -> Any:
    return builder.icmp_signed("<", mask, _equal(mask.type, 0))


@lower_cast(types.Float, _Lanes)
@lower_cast(types.Integer, _Lanes)
def _lanes_of_number(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _splat(builder, _doubles(wanted), context.cast(builder, value, given, types.float64))


@lower_cast(types.Boolean, _Mask)
def _mask_of_truth(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _splat(builder, _words(wanted), builder.sext(value, _WORD))


def _define(function: Any, *cases: tuple[Any, tuple[Any, ...], _Make], wide: bool = True) -> None:
    """Let kernels call `function`.

    Args:
        function: an operator, a function of Python's or NumPy's, or one of this file.
        cases: the type of the result, those of the arguments, and what makes LLVM's value of the builder and LLVM's
            arguments. The first case fits to whose types the arguments convert, one of them being lanes or a mask
            where any of the case is.
        wide: whether what takes lanes or a mask takes wide ones too.
    """
    if wide and WIDE != LANES:
        cases += tuple(_widened(case) for case in cases if any(map(_is_vector, case[1])))
    vectors = all(any(map(_is_vector, wanted)) for _, wanted, _ in cases)

    class Typed(AbstractTemplate):
        key = function
        # Asked before numba's own: of numbers it declines at once, and of lanes all those would decline.
        metadata = {"target": "cpu"}  # noqa: RUF012

        def apply(self, args: Any, kws: Any) -> Any:
            if kws or (vectors and not any(map(_is_vector, args))):
                return None
            for result, wanted, _ in cases:
                vector = {*filter(_is_vector, wanted)}
                if len(wanted) == len(args) and all(map(_fits, wanted, args)) and (not vector or vector & set(args)):
                    return signature(result, *wanted)
            return None

        def generic(self, args: Any, kws: Any) -> Any:
            return self.apply(args, kws)

    infer_global(function, types.Function(Typed))
    for _, wanted, make in cases:
        lower_builtin(function, *wanted)(lambda context, builder, sig, args, make=make: make(builder, *args))


def is_lanes(kind: Any) -> bool:
    """Return whether a type of numba's is one of lanes."""
    return isinstance(kind, _Lanes)


def _is_vector(kind: Any) -> bool:
    return isinstance(kind, _Lanes | _Mask)


def _widened(case: tuple[Any, tuple[Any, ...], _Make]) -> tuple[Any, tuple[Any, ...], _Make]:
    """Return a case with wide lanes in the place of lanes."""
    kinds = {_lanes: _wide, _mask: _wide_mask, types.UniTuple(_lanes, LANES): types.UniTuple(_wide, LANES)}
    result, wanted, make = case
    return kinds.get(result, result), tuple(kinds.get(kind, kind) for kind in wanted), make


def _fits(wanted: Any, given: Any) -> bool:
    if _is_vector(wanted):
        return bool(given == wanted or wanted.can_convert_from(None, given) is not None)
    return isinstance(given, types.Boolean) if wanted == types.boolean else _is_number(given)


def _compare(sign: str) -> _Make:
    def make(builder: Any, a: Any, b: Any) -> Any:
        # As numba compares numbers: NaN is unequal to everything, and nothing else of it.
        compare = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
        return builder.sext(compare(sign, a, b), ir.VectorType(_WORD, a.type.count))

    return make


def _intrinsic(name: str) -> _Make:
    def make(builder: Any, a: Any) -> Any:
        kind = ir.FunctionType(a.type, [a.type])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"{name}.v{a.type.count}f64"), [a])

    return make


_TWO = _lanes, _lanes
_PLACE = types.intp, types.float64
_CHOICE = types.boolean, types.float64, types.float64
for _operators, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _operator in _operators:
        _define(_operator, (_lanes, _TWO, lambda builder, a, b, name=_name: getattr(builder, name)(a, b)))
_define(operator.neg, (_lanes, (_lanes,), lambda builder, a: builder.fsub(_equal(a.type, -0.0), a)))
_define(abs, (_lanes, (_lanes,), _intrinsic("llvm.fabs")))
_define(np.sqrt, (_lanes, (_lanes,), _intrinsic("llvm.sqrt")))
# numba's max(a, b) is b where b > a, else a: a NaN in the first place stays.
_define(max, (_lanes, _TWO, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a)))
_define(min, (_lanes, _TWO, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", b, a), b, a)))
_define(operator.lt, (_mask, _TWO, _compare("<")))
_define(operator.le, (_mask, _TWO, _compare("<=")))
_define(operator.gt, (_mask, _TWO, _compare(">")))
_define(operator.ge, (_mask, _TWO, _compare(">=")))
_define(operator.eq, (_mask, _TWO, _compare("==")))
_define(operator.ne, (_mask, _TWO, _compare("!=")))
_define(operator.and_, (_mask, (_mask, _mask), lambda builder, a, b: builder.and_(a, b)))
_define(operator.or_, (_mask, (_mask, _mask), lambda builder, a, b: builder.or_(a, b)))


T = TypeVar("T", bool, float)


def select(mask: bool, a: T, b: T) -> T:
    """Choose lane by lane.

    Args:
        mask: the choice.
        a: numbers or truth values that are taken where the mask is true.
        b: those that are taken elsewhere.
    """
    return a if mask else b


def opposite(mask: bool) -> bool:
    """Return the mask that is true where `mask` is not."""
    return not mask


def all_of(mask: bool) -> bool:
    """Return whether all lanes of the mask are true."""
    return mask


def any_of(mask: bool) -> bool:
    """Return whether any lane of the mask is true."""
    return mask


def pack(a: T, b: T, c: T, d: T) -> T:
    """Return lanes of four numbers, or a mask of four truth values; in Python, the first.

    Args:
        a: the first lane.
        b: the second.
        c: the third.
        d: the fourth.
    """
    return a


def lane(value: T, at: int) -> T:
    """Return one lane, a number, or a truth value of a mask."""
    return value


def with_lane(value: float, at: int, one: float) -> float:
    """Return lanes with another number in one of them; of a number, the other number.

    Args:
        value: lanes, or a number.
        at: the lane.
        one: the number.
    """
    return one


def alike(like: float, one: float) -> float:
    """Return lanes with one number in each where `like` is lanes; the number where it is a number."""
    return one


def width(value: float) -> int:
    """Return the number of lanes: 1 of a number."""
    return 1


def power_of_two(value: float) -> float:
    """Return 2 to the power of a whole number from -1022 to 1023, of numbers or of lanes."""
    return float(np.ldexp(1.0, int(value)))


def exponent(value: float) -> float:
    """Return e of a value m 2^e, 1 <= m < 2, of numbers or of lanes that are positive and normal."""
    return float(np.frexp(value)[1]) - 1


def mantissa(value: float) -> float:
    """Return m of a value m 2^e, 1 <= m < 2, of numbers or of lanes that are positive and normal."""
    return 2 * float(np.frexp(value)[0])


def any_in_four(mask: bool) -> bool:
    """Return the mask that is true in all lanes of a four where `mask` is in any of them; of a truth value, itself."""
    return mask


def beside(one: T, other: T) -> T:
    """Return wide lanes of two fours, or of two numbers, each of them four times; where they hold one four, the first.

    Args:
        one: lanes, or a number.
        other: likewise.
    """
    return one


def fours_in(array: Floats) -> Floats:
    """Return an array (...) of wide lanes as one (..., FOURS) of lanes that shares its memory."""
    return array


def lanes_in(array: Floats) -> Floats:
    """Return an array (..., 4) of doubles, contiguous, as one (...) of lanes that shares its memory."""
    return array


def wide_in(array: Floats) -> Floats:
    """Return an array (..., WIDE) of doubles, contiguous, as one (...) of wide lanes that shares its memory."""
    return array


def transposed(a: T, b: T, c: T, d: T) -> tuple[T, T, T, T]:
    """Return the first lanes of all four, as lanes, then the second ones, the third and the fourth; of wide lanes, of
    each four.

    Args:
        a: lanes.
        b: lanes.
        c: lanes.
        d: lanes.
    """
    return a, b, c, d


def _transpose(builder: Any, *rows: Any) -> Any:
    fours = range(0, rows[0].type.count, LANES)

    def shuffled(one: Any, other: Any, *places: int) -> Any:
        # Places of a four, those of the other row behind its own.
        every = [first + place % LANES + place // LANES * rows[0].type.count for first in fours for place in places]
        return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), len(every)), every))

    # The even lanes of two rows side by side, and the odd ones; then the halves of both pairs.
    (even, odd), (more_even, more_odd) = (
        (shuffled(one, other, 0, 4, 2, 6), shuffled(one, other, 1, 5, 3, 7)) for one, other in (rows[:2], rows[2:])
    )
    columns = [
        shuffled(*pair, *half) for half in ((0, 1, 4, 5), (2, 3, 6, 7)) for pair in ((even, more_even), (odd, more_odd))
    ]
    return cgutils.pack_array(builder, columns)


def _number_of_bits(builder: Any, mask: Any) -> Any:
    return builder.bitcast(_bits(builder, mask), ir.IntType(mask.type.count))


_define(
    select,
    (_mask, (_mask,) * 3, lambda builder, mask, a, b: builder.select(_bits(builder, mask), a, b)),
    (_lanes, (_mask, *_TWO), lambda builder, mask, a, b: builder.select(_bits(builder, mask), a, b)),
    (types.boolean, (types.boolean,) * 3, lambda builder, mask, a, b: builder.select(mask, a, b)),
    (
        types.float64,
        (types.boolean, types.float64, types.float64),
        lambda builder, mask, a, b: builder.select(mask, a, b),
    ),
)
_define(
    opposite,
    (_mask, (_mask,), lambda builder, mask: builder.not_(mask)),
    (types.boolean, (types.boolean,), lambda builder, mask: builder.not_(mask)),
)
_define(
    all_of,
    (
        types.boolean,
        (_mask,),
        lambda builder, mask: builder.icmp_signed(
            "==", _number_of_bits(builder, mask), ir.Constant(ir.IntType(mask.type.count), -1)
        ),
    ),
    (types.boolean, (types.boolean,), lambda builder, mask: mask),
)
_define(
    any_of,
    (
        types.boolean,
        (_mask,),
        lambda builder, mask: builder.icmp_signed(
            "!=", _number_of_bits(builder, mask), ir.Constant(ir.IntType(mask.type.count), 0)
        ),
    ),
    (types.boolean, (types.boolean,), lambda builder, mask: mask),
)
_define(
    pack,
    (
        _mask,
        (types.boolean,) * LANES,
        lambda builder, *parts: _vector(builder, _words(_mask), [builder.sext(one, _WORD) for one in parts]),
    ),
    (_lanes, (types.float64,) * LANES, lambda builder, *parts: _vector(builder, _doubles(_lanes), parts)),
)
_define(transposed, (types.UniTuple(_lanes, LANES), (_lanes,) * LANES, _transpose))


def _beside(builder: Any, one: Any, other: Any) -> Any:
    places = list(range(WIDE))
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), WIDE), places))


def _any_in_four(builder: Any, mask: Any) -> Any:
    places = ir.VectorType(ir.IntType(32), mask.type.count)
    for step in (1, 2):
        order = [place ^ step for place in range(mask.type.count)]
        mask = builder.or_(mask, builder.shuffle_vector(mask, mask, ir.Constant(places, order)))
    return mask


_FRACTION, _BIAS = 52, 1023
"""Bits of a double behind its exponent, and the exponent of one."""


def _in_bits(make: Callable[[Any, Any, Callable[[int], Any]], Any]) -> _Make:
    """Return what makes a value of the bits of another one, and of constants as wide as these."""

    def made(builder: Any, value: Any) -> Any:
        count = getattr(value.type, "count", 0)
        words = ir.VectorType(_WORD, count) if count else _WORD
        bits = builder.bitcast(value, words)
        return builder.bitcast(
            make(builder, bits, lambda one: ir.Constant(words, [one] * count if count else one)), value.type
        )

    return made


def _rescaled(shift: float, function: _Make) -> _Make:
    """Return what adds a number to a value before `function`, or takes it off afterwards where that is negative."""

    def made(builder: Any, value: Any) -> Any:
        count = getattr(value.type, "count", 0)
        number = ir.Constant(value.type, [abs(shift)] * count if count else abs(shift))
        if shift > 0:
            return function(builder, builder.fadd(value, number))
        return builder.fsub(function(builder, value), number)

    return made


# A double of 2^52 and more is a whole number, whose last bits are those of the number less 2^52.
_exponent = _rescaled(
    -(2.0**_FRACTION + _BIAS),
    _in_bits(
        lambda builder, bits, constant: builder.or_(
            builder.lshr(bits, constant(_FRACTION)), constant((_BIAS + _FRACTION) << _FRACTION)
        )
    ),
)
_mantissa = _in_bits(
    lambda builder, bits, constant: builder.or_(
        builder.and_(bits, constant((1 << _FRACTION) - 1)), constant(_BIAS << _FRACTION)
    )
)
_power = _rescaled(
    2.0**_FRACTION + _BIAS, _in_bits(lambda builder, bits, constant: builder.shl(bits, constant(_FRACTION)))
)
for _function, _make in ((exponent, _exponent), (mantissa, _mantissa), (power_of_two, _power)):
    _define(_function, (_lanes, (_lanes,), _make), (types.float64, (types.float64,), _make))
_define(
    beside,
    (_wide, (_lanes, _lanes), _beside),
    (_wide_mask, (_mask, _mask), _beside),
    (
        _wide,
        (types.float64, types.float64),
        lambda builder, *parts: _beside(builder, *(_splat(builder, _doubles(_lanes), part) for part in parts)),
    ),
    wide=False,
)
_define(
    any_in_four,
    (_mask, (_mask,), _any_in_four),
    (types.boolean, (types.boolean,), lambda builder, mask: mask),
)
_define(
    lane,
    (types.float64, (_lanes, types.intp), lambda builder, value, at: builder.extract_element(value, at)),
    (
        types.boolean,
        (_mask, types.intp),
        lambda builder, value, at: builder.trunc(builder.extract_element(value, at), ir.IntType(1)),
    ),
    (types.boolean, (types.boolean, types.intp), lambda builder, value, at: value),
    (types.float64, (types.float64, types.intp), lambda builder, value, at: value),
)
_define(
    with_lane,
    (
        _lanes,
        (_lanes, types.intp, types.float64),
        lambda builder, value, at, one: builder.insert_element(value, one, at),
    ),
    (types.float64, (types.float64, types.intp, types.float64), lambda builder, value, at, one: one),
)
_define(
    alike,
    (_lanes, (_lanes, types.float64), lambda builder, like, one: _splat(builder, like.type, one)),
    (types.float64, (types.float64, types.float64), lambda builder, like, one: one),
)
_define(
    width,
    (types.intp, (_lanes,), lambda builder, value: ir.Constant(_WORD, value.type.count)),
    (types.intp, (types.float64,), lambda builder, value: ir.Constant(_WORD, 1)),
)


def _let_view(function: _Make, element: Any, given: Any = types.float64) -> None:
    """Let kernels see an array as one of lanes, by `function`.

    Args:
        function: of this file.
        element: the lanes.
        given: what the array's elements are: numbers, of which the last axis goes, or lanes, which go into a new one.
    """
    numbers = given == types.float64

    @type_callable(function)
    def _type(context: Any) -> _Make:
        def typer(array: Any) -> Any:
            if isinstance(array, types.Array) and array.dtype == given and array.layout == "C" and array.ndim > numbers:
                return types.Array(element, array.ndim + (-1 if numbers else 1), "C", aligned=False)
            return None

        return typer

    @lower_builtin(function, types.Array)
    def _view(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        source = make_array(sig.args[0])(context, builder, args[0])
        view = make_array(sig.return_type)(context, builder)
        shape, strides = (cgutils.unpack_tuple(builder, part) for part in (source.shape, source.strides))
        size = context.get_constant(types.intp, 8 * element.count)
        if numbers:
            shape, strides = shape[:-1], strides[:-1]
        else:
            shape, strides = [*shape, context.get_constant(types.intp, FOURS)], [*strides, size]
        populate_array(
            view,
            data=builder.bitcast(source.data, view.data.type),
            shape=shape,
            strides=strides,
            itemsize=size,
            meminfo=source.meminfo,
            parent=source.parent,
        )
        return impl_ret_borrowed(context, builder, sig.return_type, view._getvalue())


_let_view(lanes_in, _lanes)
_let_view(wide_in, _wide)
_let_view(fours_in, _lanes, _wide)
