"""Let another process read a file first: a damaged one can make a library hang, crash or fill the memory.

Libraries in C (HDF5, asammdf, scipy's reader of MATLAB files) cannot be interrupted from Python. So a child process
reads the file under limits of processor time and memory and reports nothing but how it ended. Where it came to its end,
this process reads the file as usual, and reports what is wrong with it; where it hung, died or asked for too much
memory, the file is refused. On Linux the child is forked from the main thread, which takes some milliseconds; elsewhere
it is a fresh interpreter, which has to import the library. Files with windsysid's seal need none of this, nor do
processes that are guarded themselves (`windsysid.fleet.guard`).
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
from windsysid.records.formats.probed import NEEDS_MEMORY, read

__all__ = ["MAX_BYTES", "Guard", "memory_for", "probe"]

MAX_BYTES = 1 << 28
"""Of a larger file sections are read, and not all of it for its soundness."""

SECONDS, SECONDS_PER_BYTE = 5.0, 2e-7
"""Processor time that reading may take; libraries that hang do it at full speed."""

WAIT_FACTOR = 12.0
"""Ratio of the longest wall time to the processor time: the machine may do other things."""

MEMORY, MEMORY_PER_BYTE = 1 << 28, 2
"""Memory [bytes] that reading may take."""

READER = Path(__file__).with_name("probed.py")

NAMES = {"h5py": "HDF5", "asammdf": "MDF", "scipy.io": "MATLAB"}

COMPRESSED = ("scipy.io",)
"""Libraries that read a whole variable at once, which may be a thousand times as large as the file: no memory limit."""


class Guard:
    """Whether this process is watched by another one, which ends it where it hangs."""

    on = False


def probe(path: Path, library: str = "h5py") -> None:
    """Refuse a file that makes a library hang or crash.

    Raises
    ------
    RecordError
        If it does.
    """
    if not Guard.on:
        found = path.stat()
        why = _probed(library, str(path.absolute()), found.st_size, found.st_mtime_ns)
        if why:
            raise RecordError(f"is damaged: {why}; copy or export it again")


def memory_for(size: int) -> int:
    """Memory [bytes] that a file of `size` bytes may take beyond what it holds."""
    return MEMORY + MEMORY_PER_BYTE * size


@lru_cache(maxsize=64)
def _probed(library: str, path: str, size: int, _changed: int) -> str:
    """What the library does in a file of this size and time of change; empty where it comes to an end."""
    if size > MAX_BYTES:
        return ""
    seconds, memory = int(SECONDS + SECONDS_PER_BYTE * size), 0 if library in COMPRESSED else memory_for(size)
    forks = sys.platform == "linux" and threading.current_thread() is threading.main_thread()
    code = (_forked if forks else _spawned)(library, path, seconds, memory)
    if code == NEEDS_MEMORY:
        return f"the {NAMES[library]} library needs more than {memory / 1e6:.0f} MB to read its {size / 1e6:.3g} MB"
    if code >= 0:  # 1: what Python says is said by whoever reads
        return ""
    return f"the {NAMES[library]} library {'hangs' if code == _HANGS else 'crashes'} in it"


def _forked(library: str, path: str, seconds: int, memory: int) -> int:
    """The exit code of a forked process that reads a file, negative where a signal ended it."""
    with contextlib.suppress(ImportError):
        importlib.import_module(library)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python warns of the threads of OpenBLAS, which are none of the child's
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
        return _waited(child, time.monotonic() + WAIT_FACTOR * seconds)
    except ChildProcessError:  # whoever ignores SIGCHLD is not told
        return 0
    except BaseException:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise


def _waited(child: int, until: float) -> int:
    """The exit code of a child process, which is ended at a moment of the monotonic clock [s]."""
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
    """As `_forked`, by a fresh interpreter."""
    try:
        return subprocess.run(
            [sys.executable, "-P", str(READER), library, path, str(seconds), str(memory)], stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=WAIT_FACTOR * seconds,
            env={**os.environ, "HDF5_USE_FILE_LOCKING": "FALSE"},
        ).returncode  # fmt: skip
    except subprocess.TimeoutExpired:
        return _HANGS
    except OSError:
        return 0  # no process can be started here


_HANGS = -int(getattr(signal, "SIGXCPU", 24))
