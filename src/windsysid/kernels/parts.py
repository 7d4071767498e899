"""Parts of a vector at any element of an array, and sums over its lanes."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from windsysid.kernels.simd import FAST_FLAGS, IR_BITS, IR_DOUBLE, IR_INDEX, IR_INTEGERS, IR_VECTOR, LANES, VECTOR

__all__ = ["lanes_sum", "load_part", "stays_a_function", "store_part", "without_first"]

# Parts of a vector at any element of an array, and sums over its lanes.


def _element(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), IR_VECTOR.as_pointer())


def _first_lanes(builder: Any, count: Any) -> Any:
    """A mask of the first `count` lanes."""
    undefined = ir.Constant(IR_INTEGERS, ir.Undefined)
    first = builder.insert_element(undefined, count, ir.Constant(IR_INDEX, 0))
    counts = builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(IR_INDEX, LANES), [0] * LANES))
    return builder.icmp_signed("<", ir.Constant(IR_INTEGERS, list(range(LANES))), counts)


@intrinsic
def load_part(typing: Any, array: Any, index: Any, count: Any) -> Any:
    """A vector of `count` elements of a C-contiguous array, from element `index` on; zero in the other lanes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _element(context, builder, sig.args[0], args[0], args[1])
        kind = ir.FunctionType(IR_VECTOR, [pointer.type, IR_INDEX, IR_BITS, IR_VECTOR])
        masked = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.load.v{LANES}f64.p0")
        nothing = ir.Constant(IR_VECTOR, [0.0] * LANES)
        return builder.call(masked, [pointer, ir.Constant(IR_INDEX, 8), _first_lanes(builder, args[2]), nothing])

    return VECTOR(array, types.intp, types.intp), generate


@intrinsic
def store_part(typing: Any, array: Any, index: Any, vector: Any, count: Any) -> Any:
    """Write the first `count` lanes to a C-contiguous array, from element `index` on."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _element(context, builder, sig.args[0], args[0], args[1])
        kind = ir.FunctionType(ir.VoidType(), [IR_VECTOR, pointer.type, IR_INDEX, IR_BITS])
        masked = cgutils.get_or_insert_function(builder.module, kind, f"llvm.masked.store.v{LANES}f64.p0")
        builder.call(masked, [args[2], pointer, ir.Constant(IR_INDEX, 8), _first_lanes(builder, args[3])])
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR, types.intp), generate


@intrinsic
def without_first(typing: Any, vector: Any, count: Any) -> Any:
    """The vector with zeros in its first `count` lanes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(_first_lanes(builder, args[1]), ir.Constant(IR_VECTOR, [0.0] * LANES), args[0])

    return VECTOR(VECTOR, types.intp), generate


@intrinsic
def lanes_sum(typing: Any, vector: Any) -> Any:
    """The sum of all lanes."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = f"llvm.vector.reduce.fadd.v{LANES}f64"
        reduction = builder.module.declare_intrinsic(name, fnty=ir.FunctionType(IR_DOUBLE, [IR_DOUBLE, IR_VECTOR]))
        return builder.call(reduction, [ir.Constant(IR_DOUBLE, -0.0), args[0]], fastmath=FAST_FLAGS)

    return types.float64(VECTOR), generate


@intrinsic
def stays_a_function(typing: Any) -> Any:
    """Keeps the function that begins with it from being inlined: kernels stay small, and are compiled in less time."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), generate
