"""Generated straight-line arithmetic → machine code, without Numba's front end.

The kernels that `windsysid.mechanics.generate` writes are long: a thousand assignments without a loop or a branch.
Numba finds a type for each of them, and takes seconds. Here the types are known: a name holds a number or a vector of
`LANES` numbers (`windsysid.kernels.simd`), as the arrays do that it was read from. So their syntax tree goes to LLVM's
instructions at once, the same that Numba would choose, in the same order. Models that differ in their sensors or in
what is identified share the functions whose text is the same.
"""

import ast
import hashlib
import operator
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from windsysid.errors import ConfigurationError
from windsysid.kernels.jit import compiled
from windsysid.kernels.simd import FAST_FLAGS, IR_DOUBLE, IR_INDEX, IR_VECTOR, LANES, splatted
from windsysid.kernels.vector_functions import TURNS, sine_and_cosine, vector_call

__all__ = ["assembled", "where"]

_INSTRUCTIONS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_LOGIC = {ast.BitAnd: "and_", ast.BitOr: "or_"}
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_OF_CONSTANTS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg,
}  # fmt: skip
_TURNS = tuple(function.__name__ for function in TURNS)
_MIN_ANGLES = 3
"""Angles of numbers from which one vector is faster than calls for each."""
_MAX_MULTIPLIED_EXPONENT = 1 << 16
"""Whole exponents up to which a power is written as multiplications."""


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, else `no`: what kernels call so, lane by lane."""
    return yes if condition else no


def assembled(module: ModuleType, source: str, name: str, signature: Any) -> Any:
    """The function `name` of a generated module with this source, compiled for `signature`, from this process or the
    cache on disk where it can be.

    Raises
    ------
    ConfigurationError
        If the source holds what is no arithmetic on numbers, say a function that kernels do not know.
    """
    text = source[source.index(f"def {name}(") :].partition("\n\n\n")[0].rstrip()
    key = f"{name}_{hashlib.sha256(text.encode()).hexdigest()[:20]}", signature
    if key not in _assembled:

        def emit(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
            tree = next(node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef))
            names = [arg.arg for arg in tree.args.args]
            arrays = dict(zip(names, zip(sig.args, args, strict=True), strict=True))
            _Body(context, builder, arrays, module.__dict__).write(tree.body)
            return context.get_dummy_value()

        kernel = _of_values(emit) if len(signature.args) == 5 else _of_slopes(emit)
        kernel.__qualname__ = key[0]  # the name in machine code: no other kernel may have it
        _assembled[key] = compiled(kernel, signature, borrows=True, source=Path(__file__))
    return _assembled[key]


_assembled: dict[tuple[str, Any], Any] = {}
"""Kernels of this process by the text of their function and their signature."""


def _of_values(emit: Callable[..., Any]) -> Callable[..., None]:
    @intrinsic
    def body(typing: Any, x: Any, u: Any, p: Any, w: Any, value: Any) -> Any:
        return types.void(x, u, p, w, value), emit

    def kernel(x: Any, u: Any, p: Any, w: Any, value: Any) -> None:
        body(x, u, p, w, value)

    return kernel


def _of_slopes(emit: Callable[..., Any]) -> Callable[..., None]:
    @intrinsic
    def body(typing: Any, x: Any, u: Any, p: Any, w: Any, value: Any, dx: Any, dp: Any, dw: Any) -> Any:
        return types.void(x, u, p, w, value, dx, dp, dw), emit

    def kernel(x: Any, u: Any, p: Any, w: Any, value: Any, dx: Any, dp: Any, dw: Any) -> None:
        body(x, u, p, w, value, dx, dp, dw)

    return kernel


class _Body:
    """Writes the statements of one function."""

    def __init__(self, context: Any, builder: Any, arrays: dict[str, tuple[Any, Any]], known: dict[str, Any]) -> None:
        self.context, self.builder, self.known = context, builder, known
        self.arrays = {
            name: context.make_array(kind)(context, builder, array) for name, (kind, array) in arrays.items()
        }
        self.names: dict[str, Any] = {}
        self.waiting: dict[str, ast.expr] = {}
        self.turned: dict[str, Sequence[Any]] = {}

    def write(self, statements: Sequence[ast.stmt]) -> None:
        """One assignment after another, once the sines and cosines of all angles are known."""
        for statement in statements:
            match statement:
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self.waiting[name] = value
        self._turn([node for statement in statements for node in ast.walk(statement)])
        for statement in statements:
            match statement:
                case ast.Assign(targets=[ast.Name() as named]):
                    self._term(named)
                case ast.Assign(targets=[target], value=value):
                    term = self._term(value)
                    pointer = self._place(target)
                    self.builder.store(self._as(pointer.type.pointee, term), pointer).align = 8
                case ast.Return(value=None):
                    return
                case _:
                    raise _unknown(statement)

    def _term(self, node: ast.AST) -> Any:
        """A number of the source, or what holds a value: its type is that of a number, a vector, a truth or a vector of
        truths."""
        match node:
            case ast.Constant(value=int() | float() as value):
                return value
            case ast.Name(id=name):
                if name not in self.names and name in self.waiting:
                    self.names[name] = self._term(self.waiting[name])
                return self.names[name] if name in self.names else self._global(node, name)
            case ast.Subscript():
                loaded = self.builder.load(self._place(node))
                loaded.align = 8  # arrays start anywhere
                return loaded
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                term = self._term(operand)
                return -term if _constant(term) else self.builder.fneg(term, flags=_flags(term))
            case ast.BinOp(left=left, op=sign, right=right):
                return self._combined(node, sign, self._term(left), self._term(right))
            case ast.Compare(left=left, ops=[sign], comparators=[right]):
                compare = self.builder.fcmp_unordered if isinstance(sign, ast.NotEq) else self.builder.fcmp_ordered
                return compare(_COMPARISONS[type(sign)], *self._alike(self._term(left), self._term(right)))
            case ast.Call(func=ast.Name(id=name), args=[angle]) if name in _TURNS and ast.unparse(angle) in self.turned:
                return self.turned[ast.unparse(angle)][_TURNS.index(name)]
            case ast.Call(func=ast.Name(id=name), args=args):
                return self._called(node, self._global(node, name), [self._term(arg) for arg in args])
        raise _unknown(node)

    def _turn(self, nodes: Sequence[ast.AST]) -> None:
        """Sines and cosines of all angles: of vectors, and of `LANES` numbers as one vector."""
        numbers: dict[str, Any] = {}
        for node in nodes:
            match node:
                case ast.Call(func=ast.Name(id=name), args=[angle]) if name in _TURNS:
                    text, value = ast.unparse(angle), self._term(angle)
                    if not _constant(value) and text not in self.turned:
                        if value.type == IR_VECTOR:
                            self.turned[text] = sine_and_cosine(self.context, self.builder, value)
                        else:
                            numbers[text] = value
        texts = list(numbers) if len(numbers) >= _MIN_ANGLES else []
        for batch in (texts[first : first + LANES] for first in range(0, len(texts), LANES)):
            vector = self._as(IR_VECTOR, numbers[batch[0]])
            places = [ir.Constant(IR_INDEX, lane) for lane in range(LANES)]
            for text, place in zip(batch, places, strict=False):
                vector = self.builder.insert_element(vector, numbers[text], place)
            results = sine_and_cosine(self.context, self.builder, vector)
            for text, place in zip(batch, places, strict=False):
                self.turned[text] = [self.builder.extract_element(result, place) for result in results]

    def _global(self, node: ast.AST, name: str) -> Any:
        for known in (self.known, self.known["__builtins__"]):
            if name in known:
                return known[name]
        raise _unknown(node)

    def _place(self, node: ast.AST) -> Any:
        """The address of an array's item."""
        match node:
            case ast.Subscript(value=ast.Name(id=name), slice=ast.Tuple(elts=items)):
                index = items
            case ast.Subscript(value=ast.Name(id=name), slice=item):
                index = [item]
            case _:
                raise _unknown(node)
        array = self.arrays[name]
        shape, strides = (cgutils.unpack_tuple(self.builder, values) for values in (array.shape, array.strides))
        places = [self.context.get_constant(types.intp, ast.literal_eval(item)) for item in index]
        return cgutils.get_item_pointer2(
            self.context, self.builder, array.data, shape, strides, "C", places, wraparound=False
        )

    def _as(self, kind: Any, term: Any) -> Any:
        """The term as a number or as a vector: a number among vectors is in every lane."""
        value = ir.Constant(IR_DOUBLE, float(term)) if _constant(term) else term
        return splatted(self.builder, value) if isinstance(kind, ir.VectorType) and value.type != kind else value

    def _alike(self, *terms: Any) -> list[Any]:
        """The terms as vectors if one of them is a vector, else as numbers."""
        kind = IR_VECTOR if any(not _constant(term) and term.type == IR_VECTOR for term in terms) else IR_DOUBLE
        return [self._as(kind, term) for term in terms]

    def _combined(self, node: ast.AST, sign: ast.operator, left: Any, right: Any) -> Any:
        if type(sign) in _LOGIC:
            kind = left.type if isinstance(left.type, ir.VectorType) else right.type
            return getattr(self.builder, _LOGIC[type(sign)])(self._as(kind, left), self._as(kind, right))
        if _constant(left) and _constant(right) and type(sign) in _OF_CONSTANTS:
            return _OF_CONSTANTS[type(sign)](left, right)
        if isinstance(sign, ast.Pow):
            if isinstance(right, int) and abs(right) <= _MAX_MULTIPLIED_EXPONENT:
                return self._power(left, right)
            return self._called(node, operator.pow, [left, right])
        if type(sign) not in _INSTRUCTIONS:
            raise _unknown(node)
        values = self._alike(left, right)
        return getattr(self.builder, _INSTRUCTIONS[type(sign)])(*values, flags=_flags(values[0]))

    def _power(self, square: Any, exponent: int) -> Any:
        """xⁿ by squaring."""
        flags, left = _flags(square), abs(exponent)
        one = result = self._as(square.type, 1.0)
        while left:
            if left % 2:
                result = square if result is one else self.builder.fmul(result, square, flags=flags)
            left //= 2
            square = self.builder.fmul(square, square, flags=flags) if left else square
        return self.builder.fdiv(one, result, flags=flags) if exponent < 0 else result

    def _called(self, node: ast.AST, function: Any, terms: Sequence[Any]) -> Any:
        if function is where:
            condition, yes, no = terms
            yes, no = self._alike(yes, no)
            kind = IR_VECTOR if isinstance(condition.type, ir.VectorType) else yes.type
            return self.builder.select(condition, self._as(kind, yes), self._as(kind, no))
        if function in (max, min) and len(terms) > 2:
            return self._called(node, function, [self._called(node, function, terms[:-1]), terms[-1]])
        values = self._alike(*terms)
        if values[0].type == IR_VECTOR:
            return vector_call(self.context, self.builder, function, values)
        if function in (max, min):
            first, second = values
            beyond = self.builder.fcmp_ordered(">" if function is max else "<", second, first)
            return self.builder.select(beyond, second, first)
        typing = self.context.typing_context
        typed = typing.resolve_value_type(function)
        found = typed and typed.get_call_type(typing, [types.float64] * len(values), {})
        if not found:
            raise _unknown(node)
        return self.context.get_function(typed, found)(self.builder, values)


def _constant(term: Any) -> bool:
    return isinstance(term, int | float)


def _flags(value: Any) -> Sequence[str]:
    """Leave to reorder; Numba gives it to numbers when all is written."""
    return FAST_FLAGS if value.type == IR_VECTOR else ()


def _unknown(node: ast.AST) -> ConfigurationError:
    return ConfigurationError(
        f"cannot compile '{ast.unparse(node):.60}' in the model: expected arithmetic and functions of `math`"
    )
