"""A vector of `LANES` doubles as a Numba type: one register of the processor, with the arithmetic written as for a number.

Numba leaves short inner loops scalar wherever two arrays might overlap. Code on this type is vector code by construction: an array of
shape (…, LANES) is read and written one vector at a time by `load` and `store`, and +, −, ×, ÷ are single instructions (two with AVX2).
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

__all__ = ["LANES", "load", "splat", "square_root", "store"]

LANES = 8
"""Doubles in one vector: AVX-512's register, two of AVX2's."""

_FLAGS = ("reassoc", "contract", "nsz", "arcp")
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class _Vector(types.Type):
    """Numba's type of a vector."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector{LANES}")


VECTOR = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Any) -> None:
        super().__init__(manager, numba_type, _VECTOR)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    first = builder.gep(data, [builder.mul(index, ir.Constant(ir.IntType(64), LANES))])
    return builder.bitcast(first, _VECTOR.as_pointer())


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
def splat(typing: Any, value: Any) -> Any:
    """A vector that holds the same number in every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), args[0], ir.Constant(ir.IntType(32), 0))
        same = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(_VECTOR, ir.Undefined), same)

    return VECTOR(types.float64), generate


@intrinsic
def square_root(typing: Any, vector: Any) -> Any:
    """√ of every lane."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        root = builder.module.declare_intrinsic(f"llvm.sqrt.v{LANES}f64", fnty=ir.FunctionType(_VECTOR, [_VECTOR]))
        return builder.call(root, [args[0]])

    return VECTOR(VECTOR), generate


def _arithmetic(operation: Any, instruction: str) -> None:
    @infer_global(operation)
    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(VECTOR, VECTOR, VECTOR) if tuple(args) == (VECTOR, VECTOR) else None

    @lower_builtin(operation, VECTOR, VECTOR)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=_FLAGS)


for _operation, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
):  # fmt: skip
    _arithmetic(_operation, _instruction)
