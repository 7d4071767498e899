"""A vector of `LANES` doubles as a Numba type: one register of the processor, with the arithmetic written as for a
number.

Numba leaves short inner loops scalar wherever two arrays might overlap. Code on this type is vector code by
construction: an array of shape (…, LANES) is read and written one vector at a time by `load` and `store`, or indexed
through `vectors`, and +, −, ×, ÷ are single instructions (two with AVX2). A number with a vector stands for a vector
of it.
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

__all__ = [
    "FAST_FLAGS", "IR_BITS", "IR_DOUBLE", "IR_INDEX", "IR_INTEGERS", "IR_VECTOR", "LANES", "LANE_MATRIX", "LANE_VECTOR",
    "VECTOR", "by_llvm", "load", "splat", "splatted", "square_root", "store", "vectors",
]  # fmt: skip

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
        """True for numbers: a number converts to a vector with this value in every lane."""
        return Conversion.safe if isinstance(other, types.Integer | types.Float) else None


VECTOR = _Vector()

LANE_VECTOR, LANE_MATRIX = (types.Array(VECTOR, d, "C", aligned=False) for d in (1, 2))
"""Numba's types of arrays (n, LANES) and (m, n, LANES) seen as arrays of vectors, as from `vectors`."""


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, IR_VECTOR)


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
        view.meminfo = context.get_constant_null(types.voidptr)  # counting references is costly compared with a kernel
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


def splatted(builder: Any, value: Any) -> Any:
    """Instructions that put a number, or a yes or no, into every lane."""
    undefined = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(IR_INDEX, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(IR_INDEX, LANES), [0] * LANES))


@lower_cast(types.Integer, VECTOR)
@lower_cast(types.Float, VECTOR)
def _from_number(context: Any, builder: Any, given: Any, to: Any, value: Any) -> Any:
    return splatted(builder, context.cast(builder, value, given, types.float64))


@intrinsic
def splat(typing: Any, value: Any) -> Any:
    """Vector with the same number in every lane; a vector is returned unchanged."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return args[0]

    return VECTOR(VECTOR), generate


def by_llvm(builder: Any, name: str, *vectors: Any) -> Any:
    """An intrinsic of LLVM, without leave to reorder: exact where the processor has the instruction."""
    kind = ir.FunctionType(IR_VECTOR, [IR_VECTOR] * len(vectors))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"), vectors)


@intrinsic
def square_root(typing: Any, vector: Any) -> Any:
    """√ of every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return by_llvm(builder, "sqrt", args[0])

    return VECTOR(VECTOR), generate


def _typed(function: Any, arguments: int) -> None:
    """`function` of vectors, or of vectors and numbers, is a vector."""

    @infer_global(function)
    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            known = all(arg == VECTOR or isinstance(arg, types.Integer | types.Float) for arg in args)
            if kws or len(args) != arguments or VECTOR not in args or not known:
                return None
            return signature(VECTOR, *[VECTOR] * arguments)


def _arithmetic(operation: Any, instruction: str) -> None:
    _typed(operation, 2)

    @lower_builtin(operation, VECTOR, VECTOR)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=FAST_FLAGS)


for _operation, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
):  # fmt: skip
    _arithmetic(_operation, _instruction)


_typed(operator.neg, 1)


@lower_builtin(operator.neg, VECTOR)
def _negated(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=FAST_FLAGS)
