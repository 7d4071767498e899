"""How windsysid compiles: Numba's options in one place, decided by measurement (docs/decisions.md).

`error_model="numpy"` drops the test before every division; the fast-math set leaves NaN alone, because NaN is data
here.
Kernels that take a model take it as a function *type*, so that they are compiled once and cached on disk for every
model.
"""

import hashlib
import logging
import os
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba import types
from platformdirs import user_cache_path

from windsysid.simd import LANE_MATRIX, LANE_VECTOR

__all__ = [
    "JACOBIAN",
    "LANE_JACOBIAN",
    "VALUE",
    "cache_folder",
    "called",
    "compiled",
    "inlined",
    "logger",
    "pasted",
    "uncounted",
]

logger = logging.getLogger("windsysid")

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "nsz", "arcp"}, "nogil": True}

_HELPER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""A helper is compiled as a part of kernels and cannot be called from Python: code for that would take a sixth of a kernel's compile time."""

_F = TypeVar("_F", bound=Callable[..., Any])
_vector = types.float64[::1]
_matrix = types.float64[:, ::1]

VALUE = types.void(_vector, _vector, _vector, _vector, _vector)
"""Signature of a value kernel: (x, u, p, w) → value, written into the last argument."""

JACOBIAN = types.void(_vector, _vector, _vector, _vector, _vector, _matrix, _matrix, _matrix)
"""Signature of a kernel with derivatives: (x, u, p, w) → value, ∂/∂x, ∂/∂p (identified), ∂/∂w.

Entries that are zero for every argument are never written: hand in zeroed matrices."""

LANE_JACOBIAN = types.void(
    LANE_VECTOR, _vector, LANE_VECTOR, LANE_VECTOR, LANE_VECTOR, LANE_MATRIX, LANE_MATRIX, LANE_MATRIX
)
"""The same for `LANES` models at once, on vectors (`windsysid.simd`); u is the same for all."""


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """The user's cache folder, or one for this process alone where that cannot be written."""
    folder = Path(os.environ["WINDSYSID_CACHE"]) if "WINDSYSID_CACHE" in os.environ else user_cache_path("windsysid")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        logger.warning("cannot keep compiled models in %s (%s): they are compiled anew in every process", folder, error)
        return Path(tempfile.mkdtemp(prefix="windsysid-"))


@lru_cache(maxsize=1)
def _kernels() -> Path:
    """Where compiled kernels are kept: a folder for each state of the sources, since a kernel holds the helpers it inlines."""
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in (
        *sorted(package.glob("filters/*.py")),
        package / "transition.py",
        package / "rows.py",
        package / "simd.py",
        Path(__file__),
    ):
        digest.update(path.read_bytes())
    return cache_folder() / f"kernels_{digest.hexdigest()[:20]}"


def compiled(function: Callable[..., Any], signature: object, *, borrows: bool = False) -> Any:
    """`function` compiled for one explicit signature, from the cache on disk where it can be, else anew.

    A function that `borrows` its arrays counts no references to them, and can make none.
    """
    usual = numba.config.CACHE_DIR
    if function.__module__.startswith("windsysid."):  # a model's module is in the cache itself, under a name of its own
        numba.config.CACHE_DIR = str(_kernels())
    try:
        return numba.njit(signature, cache=True, _nrt=not borrows, **_OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = usual


def inlined(function: _F) -> _F:
    """A helper that is compiled as part of the kernels that call it: a call with a model's many arrays costs more than the work."""
    helper: _F = numba.njit(forceinline=True, **_HELPER)(function)
    return helper


def uncounted(function: _F) -> _F:
    """An `inlined` helper that counts no references to arrays, which can cost as much as the work: it cannot make any, its caller holds them."""
    helper: _F = numba.njit(forceinline=True, _nrt=False, **_HELPER)(function)
    return helper


def pasted(function: _F) -> _F:
    """An `uncounted` helper that is inlined before types are found: compiled in less time where it is small, in more where it is large."""
    helper: _F = numba.njit(inline="always", _nrt=False, **_HELPER)(function)
    return helper


def called(function: _F) -> _F:
    """An uncounted helper that stays a function of its own, for work that outweighs a call."""
    helper: _F = numba.njit(forceinline=False, _nrt=False, **_HELPER)(function)
    return helper
