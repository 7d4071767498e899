"""Trial reading of a file by a child process: a damaged file can make a C library hang, crash or fill the memory.

C libraries (HDF5, asammdf, SciPy's reader of MATLAB files) cannot be interrupted from Python. So a child process reads
the file under limits of processor time and memory; only its exit code is used. If it ends normally, this process reads
the file as usual and reports its faults; if it hangs, crashes or exceeds its memory, the file is refused. On Linux
the child is forked from the main thread, which takes some milliseconds; otherwise it is a new interpreter, which must
import the library. Files with windsysid's seal are not read on trial, and neither are files in processes that are
guarded themselves (`windsysid.fleet.work.guard`).
"""

import contextlib
import faulthandler
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from functools import lru_cache
from pathlib import Path

from windsysid.errors import RecordError
from windsysid.records.formats.access.probed import OUT_OF_MEMORY, read

__all__ = ["MAX_BYTES", "ProcessGuard", "memory_for", "probe"]

MAX_BYTES = 1 << 28
"""Largest size of a file that is read on trial [bytes]: a larger one would take too long."""

MAX_SECONDS, MAX_SECONDS_PER_BYTE = 5.0, 2e-7
"""Largest processor time of reading [s], and addition per byte; a library that hangs uses the processor fully."""

MAX_WALL_TIME_RATIO = 12.0
"""Largest ratio of wall time to processor time: other programs may use the machine."""

MAX_MEMORY, MAX_MEMORY_PER_BYTE = 1 << 28, 2
"""Largest memory of reading [bytes], and addition per byte of the file."""

READER = Path(__file__).with_name("probed.py")

FORMAT_NAMES = {"h5py": "HDF5", "asammdf": "MDF", "scipy.io": "MATLAB"}
"""Names of the formats in messages, by library."""

WITHOUT_MEMORY_LIMIT = ("scipy.io",)
"""Libraries that read a whole compressed variable at once, which may be a thousand times as large as the file."""


class ProcessGuard:
    """True if another process watches this one, and ends it if it hangs."""

    on = False


def probe(path: Path, library: str = "h5py") -> None:
    """Refuse a file that makes a library hang, crash or exceed its memory limit.

    Raises
    ------
    RecordError
        If it does.
    """
    if not ProcessGuard.on:
        found = path.stat()
        why = _probed(library, str(path.absolute()), found.st_size, found.st_mtime_ns)
        if why:
            raise RecordError(f"is damaged: {why}; copy or export it again")


def memory_for(size: int) -> int:
    """Memory limit [bytes] for reading a file of `size` bytes."""
    return MAX_MEMORY + MAX_MEMORY_PER_BYTE * size


@lru_cache(maxsize=64)
def _probed(library: str, path: str, size: int, _changed: int) -> str:
    """Fault of the library in a file of this size and time of change; empty if it ends normally."""
    if size > MAX_BYTES:
        return ""
    seconds, memory = (
        int(MAX_SECONDS + MAX_SECONDS_PER_BYTE * size),
        0 if library in WITHOUT_MEMORY_LIMIT else memory_for(size),
    )
    forks = sys.platform == "linux" and threading.current_thread() is threading.main_thread()
    code = (_forked if forks else _spawned)(library, path, seconds, memory)
    if code == OUT_OF_MEMORY:
        return (
            f"the {FORMAT_NAMES[library]} library needs more than {memory / 1e6:.0f} MB to read its {size / 1e6:.3g} MB"
        )
    if code >= 0:  # 1: reading the file as usual reports the error
        return ""
    return f"the {FORMAT_NAMES[library]} library {'hangs' if code == _HANGS else 'crashes'} in it"


def _forked(library: str, path: str, seconds: int, memory: int) -> int:
    """Read a file in a forked process; its exit code, negative if a signal ended it."""
    with contextlib.suppress(ImportError):
        importlib.import_module(library)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of threads of OpenBLAS, which the child does not use
            child = os.fork()
    except OSError:
        return 0
    if child == 0:
        code = 1
        try:
            faulthandler.disable()
            for number in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), number)
            code = read(library, path, seconds, memory)
        finally:
            os._exit(code)
    try:
        return _waited(child, time.monotonic() + MAX_WALL_TIME_RATIO * seconds)
    except ChildProcessError:  # no exit code where SIGCHLD is ignored
        return 0
    except BaseException:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise


def _waited(child: int, until: float) -> int:
    """Wait for a child process, and kill it at the time `until` of the monotonic clock [s]; its exit code."""
    pause = 5e-4
    while True:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return _HANGS
        time.sleep(pause)
        pause = min(1.5 * pause, 0.1)


def _spawned(library: str, path: str, seconds: int, memory: int) -> int:
    """Read a file in a new interpreter; its exit code, negative if a signal ended it."""
    try:
        return subprocess.run(
            [sys.executable, "-P", str(READER), library, path, str(seconds), str(memory)], stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=MAX_WALL_TIME_RATIO * seconds,
            env={**os.environ, "HDF5_USE_FILE_LOCKING": "FALSE"},
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        return _HANGS
    except OSError:
        return 0  # no process can be started here


_HANGS = -int(getattr(signal, "SIGXCPU", 24))
