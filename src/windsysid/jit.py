"""How windsysid compiles: Numba's options in one place, decided by measurement (docs/decisions.md).

`error_model="numpy"` drops the test before every division; the fast-math set leaves NaN alone, because NaN is data
here.
Kernels that take a model take it as a function *type*, so that they are compiled once and cached on disk for every
model.
"""

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba import types

__all__ = ["JACOBIAN", "VALUE", "compiled", "inlined", "logger"]

logger = logging.getLogger("windsysid")

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "nsz", "arcp"}, "nogil": True}

_F = TypeVar("_F", bound=Callable[..., Any])
_vector = types.float64[::1]
_matrix = types.float64[:, ::1]

VALUE = types.void(_vector, _vector, _vector, _vector, _vector)
"""Signature of a value kernel: (x, u, p, w) → value, written into the last argument."""

JACOBIAN = types.void(_vector, _vector, _vector, _vector, _vector, _matrix, _matrix, _matrix)
"""Signature of a kernel with derivatives: (x, u, p, w) → value, ∂/∂x, ∂/∂p (identified), ∂/∂w.

Entries that are zero for every argument are never written: hand in zeroed matrices."""


def compiled(function: Callable[..., Any], signature: object) -> Any:
    """`function` compiled for one explicit signature, from the cache on disk where it can be, else anew."""
    try:
        return numba.njit(signature, cache=True, **_OPTIONS)(function)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        logger.warning("no folder to keep compiled code in: it is compiled anew in every process (%s)", error)
        return numba.njit(signature, **_OPTIONS)(function)


def inlined(function: _F) -> _F:
    """A helper that is compiled as part of the kernels that call it."""
    helper: _F = numba.njit(**_OPTIONS)(function)
    return helper
