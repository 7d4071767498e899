"""Names of a namespace that are imported when they are first used; functions name arguments of a wrong type."""

import sys
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from types import FunctionType, UnionType
from typing import Any, Union, get_args, get_origin

__all__ = ["lazily", "misfit", "naming_arguments"]


def lazily(
    namespace: str, values: dict[str, object], where: Mapping[str, str]
) -> tuple[dict[str, tuple[str, str]], Callable[[str], object]]:
    """Table of a namespace's public names, and the ``__getattr__`` that imports them.

    Parameters
    ----------
    namespace
        Its name, for the message about an unknown attribute.
    values
        Its ``globals()``, which keep what has been imported.
    where
        The public names of each module below ``windsysid``, separated by spaces; under ``""``, modules. A function
        that answers what a command answers has the command's name in the namespace and a verb's name in its module:
        ``modes=find_modes``.
    """
    public = {
        name: (module, original or name)
        for module, names in where.items()
        for name, _, original in (entry.partition("=") for entry in names.split())
    }

    def imported(name: str) -> object:
        if name not in public:
            raise AttributeError(f"module '{namespace}' has no attribute '{name}'")
        module, original = public[name]
        found = import_module(f"windsysid.{module or original}")
        value = getattr(found, original) if module else found
        values[name] = naming_arguments(name, value)
        return values[name]

    return public, imported


def naming_arguments(name: str, function: Any) -> Any:
    """A public function which names an argument of a wrong type where it fails because of it; others as they are.

    It takes the place of the function in its module, so that it can be pickled.
    """
    if not isinstance(function, FunctionType):
        return function
    home = sys.modules[function.__module__]
    if getattr(home, function.__name__, None) != function:
        return function

    @wraps(function)
    def named(*arguments: Any, **options: Any) -> Any:
        try:
            return function(*arguments, **options)
        except (AttributeError, TypeError, ValueError, LookupError) as error:
            wrong = None if type(error).__module__ == "windsysid.errors" else misfit(function, arguments, options)
            if wrong is None:
                raise
            raise TypeError(f"{name}: {wrong}") from error

    setattr(home, function.__name__, named)
    return named


def misfit(function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]) -> str | None:
    """The first argument that has none of the types of its annotation, in words; only what certainly does not fit.

    Examples
    --------
    >>> def double(values: "list[float]", count: int = 2) -> None: ...
    >>> misfit(double, (3,), {})
    'values: expected list[float], got int 3'
    >>> misfit(double, ([1.0],), {"count": 4})
    """
    import inspect
    import re

    signature, names = inspect.signature(function), getattr(inspect.unwrap(function), "__globals__", {})
    try:
        given = signature.bind(*arguments, **options).arguments
    except TypeError as error:
        return f"{error}; its arguments are {', '.join(signature.parameters)}"
    for key, value in given.items():
        parameter = signature.parameters[key]
        written = Any if parameter.annotation is parameter.empty else parameter.annotation
        hint = _evaluated(written, names)
        if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) and not _fits(value, hint):
            hint = getattr(hint, "__bound__", hint) or hint
            written = "array_like" if "numpy" in repr(hint) else inspect.formatannotation(hint).replace("typing.", "")
            shown = f"{type(value).__name__} {value!r}"
            got = "None" if value is None else shown if len(shown) < 50 else type(value).__name__
            written = re.sub(r"type\[~.*\]", "a class", re.sub("[a-z_.]+[.](?=[A-Za-z])", "", written))
            return f"{key}: expected {written}, got {got}"
    return None


class _Names(dict[str, Any]):
    """Names of a module; those that it imports for type checkers only may be anything."""

    def __missing__(self, name: str) -> Any:
        import builtins

        return getattr(builtins, name, Any)


def _evaluated(annotation: Any, names: dict[str, Any]) -> Any:
    """The types of an annotation; Any where they are not known."""
    try:
        return eval(annotation, {}, _Names(names)) if isinstance(annotation, str) else annotation
    except Exception:
        return Any


def _fits(value: Any, hint: Any) -> bool:
    """Test whether a value may have a type of an annotation."""
    from numbers import Integral, Real

    hint = getattr(hint, "__bound__", hint)
    if "numpy" in repr(hint):
        kinds: Any = (list, tuple, Real, type(None) if "None" in repr(hint) else list)
        return hasattr(value, "__array__") or isinstance(value, kinds)
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind in (Union, UnionType):
        return any(_fits(value, one) for one in inner)
    kind = {float: Real, int: Integral, None: type(None)}.get(kind, kind)
    return not isinstance(kind, type) or kind is Any or _is_one(value, kind, inner)


def _is_one(value: Any, kind: type, inner: tuple[Any, ...]) -> bool:
    """Test whether a value is of a class, and its elements of the classes `inner`."""
    from collections.abc import Iterable

    if getattr(kind, "_is_protocol", False):
        return all(hasattr(value, name) for name in (*vars(kind), *kind.__annotations__) if not name.startswith("_"))
    if isinstance(value, str) and issubclass(kind, Iterable):
        return kind is str
    return isinstance(value, kind) and (not isinstance(value, list | tuple) or _fit_each(value, inner))


def _fit_each(values: Any, inner: tuple[Any, ...]) -> bool:
    """Test whether elements have the types of an annotation, and a tuple its length."""
    each = inner if len(inner) > 1 and inner[-1] is not ... else inner[:1] * len(values)
    return not inner or (len(values) == len(each) and all(map(_fits, values, each)))
