"""Locks that end with their process, and removal of leftovers of ended processes."""

import contextlib
import errno
import logging
import os
import sys
import time
from pathlib import Path

__all__ = ["release", "remove_abandoned", "try_lock"]

HOME, MANIFEST, LOCK, PART = ".windsysid", "manifest.json", ".windsysid-lock", ".windsysid-part"
MAX_TRIES, PAUSE_SECONDS = 10, 0.02  # a lock that is let go or swept up at this moment is requested again [s]


def try_lock(path: Path) -> int | None:
    """Open a file and lock it; None while another process holds it. The lock ends with the process."""
    for attempt in range(MAX_TRIES):
        if attempt:
            time.sleep(PAUSE_SECONDS)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        try:
            locked = _lock(handle)
        except OSError as error:
            _warn_unlocked(path.parent, error)
            return handle
        with contextlib.suppress(FileNotFoundError):
            if locked and os.path.samestat(os.fstat(handle), path.stat()):  # and it was not removed meanwhile
                return handle
        os.close(handle)
    return None


def _warn_unlocked(folder: Path, error: OSError) -> None:
    logging.getLogger("windsysid").warning("%s cannot be locked (%s): write there from one process only", folder, error)


def _lock(handle: int) -> bool:
    """Lock an open file without waiting; OSError where the file system has no locks."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            if error.errno in (errno.EACCES, errno.EDEADLK):
                return False
            raise
    else:
        import fcntl

        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def release(handle: int, lock: Path) -> None:
    """Remove a lock's file while it is held, so that no other lock is removed, and let go."""
    if sys.platform == "win32":  # no open file can be removed there
        os.close(handle)
    with contextlib.suppress(OSError):
        lock.unlink(missing_ok=True)
    if sys.platform != "win32":
        os.close(handle)


def remove_abandoned(folder: Path) -> None:
    """Remove half-written files of dead processes: the parts without a lock."""
    names: list[str] = []
    with contextlib.suppress(PermissionError):  # of a folder that may be written but not listed
        names = os.listdir(folder)
    for name in names:
        if name.startswith(".") and name.endswith((PART, LOCK)):
            with contextlib.suppress(OSError):
                handle = os.open(folder / name, os.O_RDWR)
                try:
                    if _lock(handle) and os.path.samestat(os.fstat(handle), (folder / name).stat()):
                        (folder / name).unlink()
                finally:
                    os.close(handle)
