"""Options of Numba in one place, decided by measurement (docs/decisions.md).

`error_model="numpy"` drops the test before every division; the fast-math set leaves NaN alone, because NaN is data
here.
Kernels that take a model take it as a function *type*, so that they are compiled once and cached on disk for every
model.
"""

import gc
import hashlib
import re
import sys
import sysconfig
from collections.abc import Callable
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
from llvmlite.binding import Linkage
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock

from windsysid.kernels.ahead import something_is_compiled
from windsysid.kernels.cache import cache_folder, in_turn, keep, kept, logger, portable_processor, shipped_kernel
from windsysid.kernels.simd import LANE_MATRIX, LANE_VECTOR
from windsysid.kernels.stored import packed, unpacked

__all__ = [
    "JACOBIAN", "LANE_JACOBIAN", "VALUE", "called", "compiled", "inlined", "pasted", "uncounted",
]  # fmt: skip

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "nsz", "arcp"}, "nogil": True}

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
"""Compile for `LANES` models at once, on vectors (`windsysid.kernels.simd`); u is the same for all."""


@lru_cache(maxsize=256)
def _source(path: Path) -> tuple[bytes, tuple[str, ...]]:
    """A digest of one source file, and the modules of windsysid that it imports, wherever in it."""
    text = path.read_bytes()
    found = {name.decode() for name in _IMPORT.findall(text)}
    return hashlib.sha256(text).digest(), tuple(sorted(found))


_IMPORT = re.compile(rb"^[ \t]*(?:from|import)[ \t]+windsysid\.([\w.]+)", re.MULTILINE)
_PACKAGE = Path(__file__).parents[1]


def _sources(path: Path) -> dict[str, bytes]:
    """Digests of a source file, of this one, and of all modules of windsysid that they import, directly or not.

    A kernel holds the helpers and constants that it uses, and whatever it can use is among these.
    """
    digests: dict[str, bytes] = {}
    waiting = {"": path, "kernels.jit": Path(__file__)}
    while waiting:
        name, file = waiting.popitem()
        digests[name], imported = _source(file)
        for other in imported:
            place = _PACKAGE.joinpath(*other.split("."))
            place = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
            if other not in digests and place.is_file():
                waiting[other] = place
    return digests


class _Module(JITCodeLibrary):  # type: ignore[misc]
    """Code that becomes machine code only where Python or a function type needs its address: not that of helpers.

    Every kernel has copies of its helpers, which were optimised once more with it and round differently. Numba makes
    machine code of the helpers, too, and the process that compiles would call that; later ones would call the copies.
    """

    def _finalize_final_module(self) -> None:
        self._finalized, self._emitted = True, self._shared_module is not None  # from the cache
        if self._emitted:
            super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function; 0 if there is none of this name."""
        self._ensure_finalized()
        if not self._emitted:
            functions = list(self.get_defined_functions())
            if all(function.name != name for function in functions):
                return 0
            for function in functions:
                if function.linkage == Linkage.linkonce_odr:  # a copy, for this kernel only
                    function.linkage = Linkage.internal
            self._emitted = True
            super()._finalize_final_module()
        return int(super().get_pointer_to_function(name))

    @property
    def codegen(self) -> Any:
        """The object that keeps Numba's environments: this one, which keeps none, without machine code."""
        return self._codegen if self._emitted else self

    def set_env(self, *_: Any) -> None:
        """Keep no environment."""


class _Cache:
    """Interface of a dispatcher's cache in Numba, with one file for each kernel (`windsysid.kernels.cache`).

    Numba's own cache has an index and numbered files, which two processes can mix up, and trusts whatever is in them.
    """

    def __init__(self, function: Callable[..., Any], stem: str, turn: ExitStack) -> None:
        self.cache_path = str(cache_folder() / "kernels")
        self._name = re.sub(r"\W", "_", f"{function.__module__}.{function.__qualname__}")[:100]
        self._function, self._stem = function, stem
        self._turn = turn

    def _file(self, signature: object, processor: tuple[str, str, str]) -> str:
        text = f"{self._stem} {signature} {processor}"
        return f"{self._name}_{hashlib.sha256(text.encode()).hexdigest()[:20]}.kernel"

    def _path(self, signature: object, codegen: Any) -> Path:
        return Path(self.cache_path) / self._file(signature, codegen.magic_tuple())

    def _shipped(self, signature: object, codegen: Any) -> bytes | None:
        triple = codegen.magic_tuple()[0]
        portable = portable_processor(triple)
        return shipped_kernel(self._file(signature, (triple, portable, ""))) if portable else None

    def load_overload(self, signature: object, target: Any) -> Any:
        """The compiled function, or None where it has to be compiled."""
        from numba.core.runtime.nrt import rtsys

        rtsys.initialize(target)  # all that machine code needs; what compiling needs takes half a second to import
        path = self._path(signature, target.codegen())
        payload = kept(path) or self._shipped(signature, target.codegen())
        if payload is None:
            something_is_compiled()
            self._turn.enter_context(in_turn(path))
            payload = kept(path)
        if payload is None:
            return None
        try:
            return unpacked(payload, target, self._function, signature)
        except Exception:  # whole, and yet not to be used: from another build of Numba or Python
            logger.debug("kernel %s is compiled again", self._name, exc_info=True)
            return None

    def save_overload(self, signature: object, result: Any) -> None:
        """Keep a compiled function, unless it holds addresses of this process; its copies of helpers get theirs."""
        for environment in result._find_referenced_environments():
            result.codegen.set_env(environment.env_name, environment)
        payload = packed(result)
        if payload is not None:
            keep(self._path(signature, result.codegen), payload)

    def flush(self) -> None:
        """Forget nothing: outdated entries have other names."""


def compiled(
    function: Callable[..., Any], signature: object, *, borrows: bool = False, source: Path | None = None
) -> Any:
    """`function` compiled for one explicit signature, from the cache on disk where it can be, else anew.

    A function that `borrows` its arrays counts no references to them, and can make none. What a function with a closure
    does must be all in the file `source`.
    """
    dispatcher = numba.njit(_nrt=not borrows, **_OPTIONS)(function)
    path = source or Path(sys.modules[function.__module__].__file__ or "")
    with ExitStack() as turn:
        if path.is_file() and (source or function.__closure__ is None):
            versions = (numba.__version__, llvmlite.__version__, sysconfig.get_config_var("EXT_SUFFIX"))
            sources = sorted(_sources(path).items())
            stem = f"{versions} {sources} {function.__qualname__} {borrows}"
            dispatcher._cache = _Cache(function, stem, turn)
        turn.enter_context(global_compiler_lock)
        codegen = dispatcher.targetctx.codegen()
        codegen._library_class = _Module
        turn.callback(delattr, codegen, "_library_class")
        if gc.isenabled():  # collecting takes a tenth of the time
            turn.callback(gc.enable)
            gc.disable()
        dispatcher.compile(signature)
    dispatcher.disable_compile()
    return dispatcher


def _helper(function: _F, **options: Any) -> _F:
    """Decorate a helper: a part of kernels, without the code for calls from Python that would take a sixth of their
    compile time. It is compiled once for all integers, not again for each constant among its arguments."""
    helper: Any = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS, **options)(function)
    template = helper.get_call_template
    helper.get_call_template = lambda given, named: template([types.unliteral(one) for one in given], named)
    return cast(_F, helper)


def inlined(function: _F) -> _F:
    """Compile a helper into the kernels that call it: a call with a model's many arrays costs more than the work."""
    return _helper(function, forceinline=True)


def uncounted(function: _F) -> _F:
    """An `inlined` helper that counts no references to arrays, since counting can cost as much as the work.

    It cannot make arrays; its caller holds them.
    """
    return _helper(function, forceinline=True, _nrt=False)


def pasted(function: _F) -> _F:
    """An `uncounted` helper that is inlined before types are found.

    A small helper then compiles faster, a large one more slowly.
    """
    return _helper(function, inline="always", _nrt=False)


def called(function: _F) -> _F:
    """An uncounted helper that stays a function of its own, for work that outweighs a call."""
    return _helper(function, forceinline=False, _nrt=False)
