"""Results as plain values that JSON holds, and back: nothing is rounded, and no class is named in the file.

What a value is, is said by the annotation of the field that holds it. So a file makes only what the class of the answer
has: named tuples, data classes, sequences, mappings, arrays, moments, turbines and sensors.
"""

import base64
import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import datetime
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from windsysid.turbine.tables import as_tables, parse_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["as_plain", "finite", "from_plain"]


def as_plain(value: Any) -> Any:
    """Value as JSON stores it; a number that is not finite becomes a word.

    Raises
    ------
    TypeError
        If it has parts that no file can hold.
    """
    if value is None or isinstance(value, str | int):
        return value
    for kinds, written in _WRITTEN:
        if isinstance(value, kinds):
            return written(value)
    parts = _parts(value)
    if isinstance(parts, Mapping):
        return {str(name): as_plain(part) for name, part in parts.items()}
    if isinstance(parts, Sequence):
        return [as_plain(part) for part in parts]
    raise TypeError(f"no file holds a {type(value).__name__}")


def _parts(value: Any) -> Any:
    """The parts of a data class or of a named tuple by name; anything else as it is."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return value._asdict() if isinstance(value, tuple) and hasattr(value, "_asdict") else value


def _array(value: NDArray[Any]) -> dict[str, Any]:
    bits = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
    bytes_ = base64.b64encode(bits.tobytes()).decode("ascii")
    return {"type": bits.dtype.str, "shape": list(value.shape), "base64": bytes_}


def _turbine_file(value: Turbine) -> str:
    import tomli_w

    return tomli_w.dumps(as_tables(value))


_WRITTEN: tuple[tuple[type, Callable[[Any], Any]], ...] = (
    (np.generic, lambda value: as_plain(value.item())),  # before float, which a float64 is
    (float, lambda value: value if math.isfinite(value) else str(value)),
    (complex, lambda value: [value.real, value.imag]),
    (np.ndarray, _array),
    (datetime, datetime.isoformat),
    (Turbine, _turbine_file),
    (BaseModel, lambda value: value.model_dump(mode="json")),
)
"""Encoders of these classes, in the order in which they are tried."""


def from_plain(kind: Any, value: Any) -> Any:
    """Value before `as_plain`, from the annotation of its field.

    Raises
    ------
    TypeError, ValueError, KeyError
        If it is none of that kind.
    """
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any or origin is Literal:
        return value
    if origin in (Union, types.UnionType):
        return _from_union(parts, value)
    if origin is np.ndarray:
        bits = base64.b64decode(value["base64"], validate=True)
        return np.frombuffer(bits, dtype=value["type"]).reshape(value["shape"]).copy()
    return _from_class(kind, value) if origin is None else _from_collection(origin, parts, value)


def _from_union(parts: Sequence[Any], value: Any) -> Any:
    """Fields that may be None."""
    given = [part for part in parts if part is not types.NoneType]
    if value is None and len(given) < len(parts):
        return None
    (only,) = given
    return from_plain(only, value)


def _from_collection(origin: type[Any], parts: Sequence[Any], value: Any) -> Any:
    if origin is tuple and parts[-1] is not Ellipsis:
        return tuple(from_plain(part, one) for part, one in zip(parts, value, strict=True))
    if issubclass(origin, Mapping):
        return {name: from_plain(parts[1], part) for name, part in value.items()}
    if issubclass(origin, Sequence):
        return tuple(from_plain(parts[0], part) for part in value)
    raise TypeError(f"no file holds a {origin.__name__}")


def _from_class(kind: type[Any], value: Any) -> Any:
    if kind in (float, int, bool, str):
        return kind(value)
    if kind is complex:
        return complex(*value)
    if kind is datetime:
        return datetime.fromisoformat(value)
    if kind is Turbine:
        return parse_turbine(value, "of the result")
    if issubclass(kind, BaseModel):
        return kind.model_validate(value)
    if is_dataclass(kind) or (issubclass(kind, tuple) and hasattr(kind, "_fields")):
        hints = get_type_hints(kind)
        return kind(**{name: from_plain(hints[name], part) for name, part in value.items()})
    raise TypeError(f"no file holds a {kind.__name__}")


def finite(value: Any) -> Any:
    """`value` with every number that JSON cannot hold replaced by None."""
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [finite(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
