"""Results that are kept as long as a record lives, since several parts of a program ask the same of it."""

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast
from weakref import WeakKeyDictionary

from windsysid.records.record import Record

__all__ = ["kept_with_record"]

P = ParamSpec("P")
T = TypeVar("T")


def kept_with_record(function: Callable[Concatenate[Record, P], T]) -> Callable[Concatenate[Record, P], T]:
    """Decorate a function of a record and hashable arguments: it is computed once for each record, and its callers
    share the result and must not change it."""
    found: WeakKeyDictionary[Record, dict[Any, T | None]] = WeakKeyDictionary()

    @wraps(function)
    def once(record: Record, *args: P.args, **options: P.kwargs) -> T:
        known, key = found.setdefault(record, {}), (args, *options.items())
        if key not in known:
            result = function(record, *args, **options)
            known[key] = None if result is record else result  # a record that refers to itself would never be freed
        return cast(T, record if known[key] is None else known[key])

    return cast(Callable[Concatenate[Record, P], T], once)
