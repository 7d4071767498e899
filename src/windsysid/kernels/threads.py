"""One thread for many small products of matrices.

The OpenBLAS of NumPy, and that of SciPy, which kernels call, hand every product of more than a few dozen rows to all
processors, which wait for each other longer than they multiply: a search among spectra took ten times its processor
time. The number of threads is set in the libraries themselves, as threadpoolctl does, since the environment is read
once, when they are loaded.
"""

import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

__all__ = ["one_thread", "usable_processors"]

_PREFIXES = ("scipy_openblas", "openblas")
_SUFFIXES = ("64_", "", "_64_", "64")


def usable_processors() -> list[int]:
    """Numbers of the processors that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


@contextmanager
def one_thread() -> Iterator[None]:
    """Products of matrices in one thread, and in other threads while this lasts.

    Where NumPy and SciPy were built with another library than OpenBLAS, nothing changes.
    """
    before = [read() for read, _ in _controls()]
    try:
        for _, write in _controls():
            write(1)
        yield
    finally:
        for (_, write), number in zip(_controls(), before, strict=True):
            write(number)


@lru_cache(maxsize=1)
def _controls() -> list[tuple[Callable[[], int], Callable[[int], None]]]:
    """Functions to read and set the number of threads of every OpenBLAS that NumPy and SciPy ship."""
    found = []
    for path in _libraries():
        try:
            library = ctypes.CDLL(str(path))
        except OSError:
            continue
        functions = _functions(library)
        if functions is not None:
            found.append(functions)
    return found


def _libraries() -> list[Path]:
    """Folders of the libraries in wheels: next to the packages, or inside on a Mac."""
    names = {"win32": "*openblas*.dll", "darwin": "*openblas*.dylib"}
    found: list[Path] = []
    for package in ("numpy", "scipy"):
        spec = find_spec(package)  # SciPy itself is not imported
        for place in (spec.submodule_search_locations or []) if spec else []:
            for folder in (Path(place).with_name(f"{package}.libs"), Path(place) / ".dylibs"):
                found += sorted(folder.glob(names.get(sys.platform, "*openblas*.so*")))
    return found


def _functions(library: Any) -> tuple[Callable[[], int], Callable[[int], None]] | None:
    """Its two functions, under one of their names."""
    for prefix in _PREFIXES:
        for suffix in _SUFFIXES:
            names = [f"{prefix}_{verb}_num_threads{suffix}" for verb in ("get", "set")]
            if all(hasattr(library, name) for name in names):
                read, write = (getattr(library, name) for name in names)
                read.restype, write.argtypes, write.restype = ctypes.c_int, [ctypes.c_int], None
                return read, write
    return None
