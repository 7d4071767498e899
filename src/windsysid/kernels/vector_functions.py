"""The functions of `math` for every lane of a vector: instructions for sine, cosine, square root, magnitude and the
larger and smaller of two; the others go lane by lane.

Sine and cosine: x = n π/2 + r with |r| ≤ π/4, π/2 in three parts of 33 bits (Cody & Waite 1980, ch. 8), then the
polynomials of FreeBSD's msun (k_sin.c, k_cos.c; errors below 2⁻⁵⁸).
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import signature

from windsysid.kernels.simd import (
    FAST_FLAGS,
    IR_INDEX,
    IR_INTEGERS,
    IR_VECTOR,
    LANES,
    by_llvm,
)

__all__ = ["TURNS", "sine_and_cosine", "vector_call"]

_MAX_ARGUMENT = 1e6
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

_BY_LLVM = {math.sqrt: "sqrt", abs: "fabs", max: "maxnum", min: "minnum"}
TURNS = (math.sin, math.cos)
"""What `sine_and_cosine` gives, in its order."""


def vector_call(context: Any, builder: Any, function: Callable[..., Any], vectors: Sequence[Any]) -> Any:
    """Instructions for `function` of vectors."""
    if function in _BY_LLVM:
        return by_llvm(builder, _BY_LLVM[function], *vectors)
    if function in TURNS:
        return sine_and_cosine(context, builder, vectors[0])[TURNS.index(function)]
    call = context.get_function(function, signature(types.float64, *[types.float64] * len(vectors)))
    result = ir.Constant(IR_VECTOR, ir.Undefined)
    for lane in (ir.Constant(IR_INDEX, i) for i in range(LANES)):
        value = call(builder, [builder.extract_element(vector, lane) for vector in vectors])
        result = builder.insert_element(result, value, lane)
    return result


def sine_and_cosine(context: Any, builder: Any, x: Any) -> list[Any]:
    """Instructions for the sine and the cosine of the vector x."""
    calls = [context.get_function(f, signature(types.float64, types.float64)) for f in (math.sin, math.cos)]
    results = [cgutils.alloca_once_value(builder, x) for _ in calls]
    with builder.if_else(_beyond(builder, x, _MAX_ARGUMENT), likely=False) as (far, near):
        with far, cgutils.for_range(builder, ir.Constant(ir.IntType(64), LANES)) as loop:
            lane = builder.trunc(loop.index, IR_INDEX)
            for call, result in zip(calls, results, strict=True):
                value = call(builder, [builder.extract_element(x, lane)])
                builder.store(builder.insert_element(builder.load(result), value, lane), result)
        with near:
            for value, result in zip(_reduced(builder, x), results, strict=True):
                builder.store(value, result)
    return [builder.load(result) for result in results]


def _reduced(builder: Any, x: Any) -> list[Any]:
    """The sine and the cosine by n and r."""

    def times(*factors: Any) -> Any:
        product, *others = factors
        for factor in others:
            product = builder.fmul(product, factor, flags=FAST_FLAGS)
        return product

    def plus(a: Any, b: Any) -> Any:
        return builder.fadd(a, b, flags=FAST_FLAGS)

    def minus(a: Any, b: Any) -> Any:
        return builder.fsub(a, b, flags=FAST_FLAGS)

    def polynomial(coefficients: Sequence[float]) -> Any:
        value = _all(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            value = plus(_all(coefficient), times(s, value))
        return value

    n = by_llvm(builder, "rint", times(x, _all(2.0 / math.pi)))
    back = builder.fneg(n, flags=FAST_FLAGS)
    r = x
    for part in _HALF_PI:
        r = by_llvm(builder, "fma", back, _all(part), r)
    s = times(r, r)
    odd = plus(r, times(r, s, polynomial(_SINE)))
    even = minus(_all(1.0), minus(times(_all(0.5), s), times(s, s, polynomial(_COSINE))))
    return [_in_quadrant(builder, plus(n, _all(quarters)), odd, even) for quarters in (0.0, 1.0)]


def _in_quadrant(builder: Any, quadrant: Any, odd: Any, even: Any) -> Any:
    """`odd` or `even`, with the sign, that a sine has in its quadrant (a whole number)."""
    number = builder.fptosi(quadrant, IR_INTEGERS)
    one, two = (ir.Constant(IR_INTEGERS, [value] * LANES) for value in (1, 2))
    swapped = builder.icmp_signed("==", builder.and_(number, one), one)
    chosen = builder.bitcast(builder.select(swapped, even, odd), IR_INTEGERS)
    sign = builder.shl(builder.and_(number, two), ir.Constant(IR_INTEGERS, [62] * LANES))
    return builder.bitcast(builder.xor(chosen, sign), IR_VECTOR)


def _beyond(builder: Any, vector: Any, limit: float) -> Any:
    """Test whether any lane is farther than `limit` from zero, or NaN."""
    far = builder.fcmp_unordered("ugt", by_llvm(builder, "fabs", vector), _all(limit))
    return builder.icmp_unsigned("!=", builder.bitcast(far, ir.IntType(LANES)), ir.Constant(ir.IntType(LANES), 0))


def _all(number: float) -> Any:
    """Vector with the same number in every lane."""
    return ir.Constant(IR_VECTOR, [number] * LANES)
