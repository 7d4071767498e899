"""Kernels that are needed later are compiled in a second process, while this one compiles those it needs first.

The first command of a new installation compiles for half a minute, one function after the other: Numba has one lock for
all threads. A second process leaves what it compiles in the cache (`windsysid.kernels.cache`), where this one finds it,
or waits for it. It is started when a first kernel is not in the cache, so that a warm command never starts one.
"""

import contextlib
import importlib
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from windsysid.kernels.threads import usable_processors

__all__ = ["compile_ahead", "something_is_compiled"]

_later: list[str] = []
_processes: list[subprocess.Popen[bytes]] = []


def compile_ahead(*kernels: Callable[[], Any]) -> None:
    """Have these compiled by a second process, should anything have to be: module-level functions that return a kernel.

    For programs only: it starts `sys.executable`.
    """
    if len(usable_processors()) > 1:
        _later[:] = [f"{kernel.__module__}:{kernel.__name__}" for kernel in kernels]


def something_is_compiled() -> None:
    """Start the second process; once, and where there is something for it."""
    if not _later:
        return
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-m", __name__, *_later]
    _later.clear()
    with contextlib.suppress(OSError):  # else this process compiles all
        _processes.append(subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet))


if __name__ == "__main__":
    for given in sys.argv[1:]:
        module, name = given.split(":")
        getattr(importlib.import_module(module), name)()
