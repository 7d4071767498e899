"""A vector of `LANES` doubles as a Numba type: one register of the processor, with the arithmetic written as for a
number.

Numba leaves short inner loops scalar wherever two arrays might overlap. Code on this type is vector code by
construction: an array of shape (…, LANES) is read and written one vector at a time by `load` and `store`, or indexed
through `vectors`, and +, −, ×, ÷ are single instructions (two with AVX2). A number beside a vector stands for a vector
of it. Of the functions of `math`, sine, cosine and square root are vector code, the others go lane by lane.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, overload, register_model

__all__ = [
    "FAST_FLAGS",
    "IR_BITS",
    "IR_DOUBLE",
    "IR_INDEX",
    "IR_INTEGERS",
    "IR_VECTOR",
    "LANES",
    "LANE_MATRIX",
    "LANE_VECTOR",
    "load",
    "splat",
    "square_root",
    "store",
    "vectors",
    "where",
]

LANES = 8
"""Doubles in one vector: AVX-512's register, two of AVX2's."""

FAST_FLAGS = ("reassoc", "contract", "nsz", "arcp")
IR_DOUBLE, IR_INDEX = ir.DoubleType(), ir.IntType(32)
IR_VECTOR = ir.VectorType(IR_DOUBLE, LANES)
IR_INTEGERS, IR_BITS = ir.VectorType(ir.IntType(64), LANES), ir.VectorType(ir.IntType(1), LANES)


class _Vector(types.Type):
    """Numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector{LANES}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A number is a vector with the same in every lane."""
        return Conversion.safe if isinstance(other, types.Integer | types.Float) else None


VECTOR = _Vector()

LANE_VECTOR, LANE_MATRIX = (types.Array(VECTOR, d, "C", aligned=False) for d in (1, 2))
"""Numba's types of arrays (n, LANES) and (m, n, LANES) seen as arrays of vectors: what `vectors` returns."""


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, IR_VECTOR)


class _Mask(types.Type):
    """Numba's type of what a comparison of vectors gives: yes or no in every lane."""

    def __init__(self) -> None:
        super().__init__(name=f"Mask{LANES}")


MASK = _Mask()


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, IR_BITS)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.gep(data, [builder.mul(index, ir.Constant(ir.IntType(64), LANES))])
    return builder.bitcast(first, IR_VECTOR.as_pointer())


@intrinsic
def load(typing: Any, array: Any, index: Any) -> Any:
    """Vector number `index` of a C-contiguous array of doubles whose last axis is LANES long."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = builder.load(_pointer(context, builder, sig.args[0], args[0], args[1]))
        vector.align = 8
        return vector

    return VECTOR(array, types.intp), generate


@intrinsic
def store(typing: Any, array: Any, index: Any, vector: Any) -> Any:
    """Write vector number `index` of a C-contiguous array of doubles whose last axis is LANES long."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        written = builder.store(args[2], _pointer(context, builder, sig.args[0], args[0], args[1]))
        written.align = 8
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), generate


@intrinsic
def vectors(typing: Any, array: Any) -> Any:
    """View a C-contiguous array of doubles (…, LANES) as vectors (…); the array goes on owning its memory."""
    seen = types.Array(VECTOR, array.ndim - 1, "C", aligned=False)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = context.make_array(sig.args[0])(context, builder, args[0])
        view = context.make_array(seen)(context, builder)
        view.meminfo = context.get_constant_null(types.voidptr)  # counting references is dear beside a kernel's work
        view.parent = context.get_constant_null(types.pyobject)
        view.data = builder.bitcast(whole.data, IR_VECTOR.as_pointer())
        view.itemsize = context.get_constant(types.intp, 8 * LANES)
        view.nitems = builder.udiv(whole.nitems, context.get_constant(types.intp, LANES))
        view.shape, view.strides = (
            cgutils.pack_array(builder, cgutils.unpack_tuple(builder, values)[:-1])
            for values in (whole.shape, whole.strides)
        )
        return view._getvalue()

    return seen(array), generate


def _splatted(builder: Any, number: Any) -> Any:
    undefined = ir.Constant(IR_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(IR_INDEX, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(IR_INDEX, LANES), [0] * LANES))


@lower_cast(types.Integer, VECTOR)
@lower_cast(types.Float, VECTOR)
def _from_number(context: Any, builder: Any, given: Any, to: Any, value: Any) -> Any:
    return _splatted(builder, context.cast(builder, value, given, types.float64))


@intrinsic
def splat(typing: Any, value: Any) -> Any:
    """A vector that holds the same number in every lane; a vector stays what it is."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return args[0]

    return VECTOR(VECTOR), generate


def _by_llvm(name: str, arguments: int = 1) -> Callable[..., Any]:
    """An intrinsic of LLVM, without leave to reorder: exact where the processor has the instruction."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(IR_VECTOR, [IR_VECTOR] * arguments)
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), args)

    return generate


@intrinsic
def square_root(typing: Any, vector: Any) -> Any:
    """√ of every lane."""
    return VECTOR(VECTOR), _by_llvm("sqrt")


@intrinsic
def _fused(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""
    return VECTOR(VECTOR, VECTOR, VECTOR), _by_llvm("fma", 3)


@intrinsic
def _nearest(typing: Any, vector: Any) -> Any:
    """The whole number nearest to each lane."""
    return VECTOR(VECTOR), _by_llvm("rint")


@intrinsic
def _beyond(typing: Any, vector: Any, limit: Any) -> Any:
    """Whether any lane is farther than `limit` from zero, or NaN."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        size = _by_llvm("fabs")(context, builder, sig, args[:1])
        far = builder.fcmp_unordered("ugt", size, _splatted(builder, args[1]))
        bits = builder.bitcast(far, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(VECTOR, types.float64), generate


@intrinsic
def _in_quadrant(typing: Any, quadrant: Any, even: Any, odd: Any) -> Any:
    """`even` or `odd`, with the sign, that a sine has in its quadrant (a whole number)."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        number = builder.fptosi(args[0], IR_INTEGERS)
        one, two = (ir.Constant(IR_INTEGERS, [value] * LANES) for value in (1, 2))
        swapped = builder.icmp_signed("==", builder.and_(number, one), one)
        chosen = builder.bitcast(builder.select(swapped, args[2], args[1]), IR_INTEGERS)
        sign = builder.shl(builder.and_(number, two), ir.Constant(IR_INTEGERS, [62] * LANES))
        return builder.bitcast(builder.xor(chosen, sign), IR_VECTOR)

    return VECTOR(VECTOR, VECTOR, VECTOR), generate


def _typed(function: Any, arguments: int, result: Any = VECTOR) -> None:
    """`function` of vectors, or of vectors and numbers, is a vector or a mask."""

    @infer_global(function)
    class Typing(AbstractTemplate):
        prefer_literal = True

        def generic(self, args: Any, kws: Any) -> Any:
            known = all(arg == VECTOR or isinstance(arg, types.Integer | types.Float) for arg in args)
            if kws or len(args) != arguments or VECTOR not in args or not known:
                return None
            if function is operator.pow and isinstance(args[1], types.IntegerLiteral):
                return signature(VECTOR, *args)
            return signature(result, *[VECTOR] * arguments)


def _arithmetic(operation: Any, instruction: str) -> None:
    _typed(operation, 2)

    @lower_builtin(operation, VECTOR, VECTOR)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=FAST_FLAGS)


for _operation, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
):  # fmt: skip
    _arithmetic(_operation, _instruction)


def _function(function: Any, generate: Any, arguments: int = 1) -> None:
    _typed(function, arguments)
    lower_builtin(function, *[VECTOR] * arguments)(generate)


def _by_lane(function: Any, arguments: int) -> None:
    """`function` one lane after another, as for numbers."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        scalar = signature(types.float64, *[types.float64] * arguments)
        call = context.get_function(function, scalar)
        result = ir.Constant(IR_VECTOR, ir.Undefined)
        for lane in (ir.Constant(IR_INDEX, i) for i in range(LANES)):
            value = call(builder, [builder.extract_element(arg, lane) for arg in args])
            result = builder.insert_element(result, value, lane)
        return result

    _function(function, generate, arguments)


for _name in ("acos", "asin", "atan", "cosh", "erf", "exp", "log", "sinh", "tan", "tanh"):
    _by_lane(getattr(math, _name), 1)
for _name in ("atan2", "copysign"):
    _by_lane(getattr(math, _name), 2)
_by_lane(operator.pow, 2)
_function(math.sqrt, _by_llvm("sqrt"))
_function(abs, _by_llvm("fabs"))
_function(max, _by_llvm("maxnum", 2), 2)
_function(min, _by_llvm("minnum", 2), 2)
_typed(operator.neg, 1)
_typed(operator.pos, 1)


@lower_builtin(operator.neg, VECTOR)
def _negated(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=FAST_FLAGS)


@lower_builtin(operator.pos, VECTOR)
def _unchanged(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return args[0]


@lower_builtin(operator.pow, VECTOR, types.IntegerLiteral)
def _whole_power(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """xⁿ by squaring."""
    left = abs(sig.args[1].literal_value)
    result, square = _splatted(builder, ir.Constant(IR_DOUBLE, 1.0)), args[0]
    one = result
    while left:
        if left % 2:
            result = square if result is one else builder.fmul(result, square, flags=FAST_FLAGS)
        left //= 2
        square = builder.fmul(square, square, flags=FAST_FLAGS) if left else square
    return builder.fdiv(one, result, flags=FAST_FLAGS) if sig.args[1].literal_value < 0 else result


def _comparison(operation: Any, symbol: str) -> None:
    _typed(operation, 2, MASK)

    @lower_builtin(operation, VECTOR, VECTOR)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return (builder.fcmp_unordered if symbol == "!=" else builder.fcmp_ordered)(symbol, *args)


for _operation, _symbol in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "=="),
    (operator.ne, "!="),
):  # fmt: skip
    _comparison(_operation, _symbol)


def _of_masks(operation: Any, instruction: str, arguments: int) -> None:
    @infer_global(operation)
    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(MASK, *args) if tuple(args) == (MASK,) * arguments else None

    @lower_builtin(operation, *[MASK] * arguments)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)


_of_masks(operator.and_, "and_", 2)
_of_masks(operator.or_, "or_", 2)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, else `no`: for numbers, and for vectors lane by lane."""
    return yes if condition else no


@overload(where)
def _where(condition: Any, yes: Any, no: Any) -> Any:
    def of_lanes(condition: Any, yes: Any, no: Any) -> Any:
        return _chosen(condition, yes, no)

    def of_vectors(condition: Any, yes: Any, no: Any) -> Any:
        return splat(yes) if condition else splat(no)

    def of_numbers(condition: Any, yes: Any, no: Any) -> Any:
        return float(yes) if condition else float(no)

    return of_lanes if condition == MASK else of_vectors if VECTOR in (yes, no) else of_numbers


@intrinsic
def _chosen(typing: Any, condition: Any, yes: Any, no: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    return VECTOR(MASK, VECTOR, VECTOR), generate


# Sine and cosine: x = n π/2 + r with |r| ≤ π/4, π/2 in three parts of 33 bits (Cody & Waite 1980, ch. 8), then the
# polynomials of FreeBSD's msun (k_sin.c, k_cos.c; errors below 2⁻⁵⁸).

_FARTHEST = 1e6
"""Magnitude of an argument up to which n times a part of π/2 is exact; beyond, lanes go one by one."""

_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_SINE = (
    -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04,
    2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10,
)  # fmt: skip
_COSINE = (
    4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05,
    -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11,
)  # fmt: skip


def _turned(quarters: int, function: Any) -> None:
    """`function` is the sine, so many quarter turns ahead."""

    @intrinsic
    def one_by_one(typing: Any, vector: Any) -> Any:
        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            call = context.get_function(function, signature(types.float64, types.float64))
            result = cgutils.alloca_once_value(builder, args[0])
            with cgutils.for_range(builder, ir.Constant(ir.IntType(64), LANES)) as loop:
                lane = builder.trunc(loop.index, IR_INDEX)
                value = call(builder, [builder.extract_element(args[0], lane)])
                builder.store(builder.insert_element(builder.load(result), value, lane), result)
            return builder.load(result)

        return VECTOR(VECTOR), generate

    @overload(function, jit_options={"forceinline": True, "error_model": "numpy"})
    def of_a_vector(x: Any) -> Any:
        if x != VECTOR:
            return None

        def implementation(x: Any) -> Any:
            if _beyond(x, _FARTHEST):
                return one_by_one(x)
            n = _nearest(x * (2.0 / math.pi))
            r = _fused(-n, splat(_HALF_PI[2]), _fused(-n, splat(_HALF_PI[1]), _fused(-n, splat(_HALF_PI[0]), x)))
            s = r * r
            a, b, c, d, e, f = _SINE
            odd = r + r * s * (a + s * (b + s * (c + s * (d + s * (e + s * f)))))
            a, b, c, d, e, f = _COSINE
            even = 1.0 - (0.5 * s - s * s * (a + s * (b + s * (c + s * (d + s * (e + s * f))))))
            return _in_quadrant(n + float(quarters), odd, even)

        return implementation


_turned(0, math.sin)
_turned(1, math.cos)
