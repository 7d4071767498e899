"""Let another process read an HDF5 file first: a damaged one can make its library hang or crash, and nobody can help.

That process reads every attribute and dataset once and says nothing. Where it comes to its end, this process reads the
file as usual, and tells what is wrong with it if something is; where it hangs or dies, the file is refused. Files with
windsysid's seal need none of this, nor do processes that are guarded themselves (`windsysid.fleet.guard`).
"""

import os
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

from windsysid.errors import RecordError

__all__ = ["MAX_BYTES", "Guard", "probe"]

MAX_BYTES = 1 << 28
"""Of a larger file sections are read, and not all of it for its soundness."""

SECONDS, SECONDS_A_BYTE = 10.0, 2e-7
"""Processor time that reading may take; libraries that hang do it at full speed."""

WAIT_FACTOR = 12.0
"""How much longer it may take on a machine that does other things."""

READER = Path(__file__).with_name("probed.py")


class Guard:
    """Whether this process is watched by another one, which ends it where it hangs."""

    on = False


def probe(path: Path) -> None:
    """Refuse a file that makes the HDF5 library hang or crash.

    Raises
    ------
    RecordError
        If it does.
    """
    if not Guard.on:
        found = path.stat()
        why = _probed(str(path.absolute()), found.st_size, found.st_mtime_ns)
        if why is not None:
            raise RecordError(f"is damaged: {why}; copy or export it again")


@lru_cache(maxsize=64)
def _probed(path: str, size: int, _changed: int) -> str | None:
    """What the library does in a file of this size and time of change; None where it comes to an end."""
    if size > MAX_BYTES:
        return None
    seconds = SECONDS + SECONDS_A_BYTE * size
    command = [sys.executable, "-P", str(READER), path, str(int(seconds))]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            timeout=WAIT_FACTOR * seconds, env={**os.environ, "HDF5_USE_FILE_LOCKING": "FALSE"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "the HDF5 library hangs in it"
    except OSError:
        return None  # no process can be started here
    if done.returncode in (0, 1):  # 1: what Python says is said by whoever reads
        return None
    return f"the HDF5 library {'hangs' if done.returncode == -getattr(_signals(), 'SIGXCPU', 0) else 'crashes'} in it"


def _signals() -> object:
    import signal

    return signal.Signals
