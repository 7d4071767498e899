"""Ownership checks of files and folders, by the rules of OpenSSH's ``StrictModes``.

A file and all folders above it must belong to the user or to root, and must not be writable by others. The check ends
at the user's home folder. A parent folder with the sticky bit, such as ``/tmp``, may be writable: entries of other
users cannot be renamed there. The user's private group counts as the user.
"""

import errno
import os
import stat
import sys
from functools import lru_cache
from pathlib import Path

__all__ = ["foreign", "read_own"]


def read_own(path: Path) -> bytes | None:
    """Read a file that no other user can have changed; None for any other file, or one that cannot be read."""
    if foreign(path.parent):
        return None
    try:
        with open(path, "rb", opener=_opened) as file:
            return None if _fault(os.fstat(file.fileno())) else file.read()
    except OSError:
        return None


def _opened(path: str, flags: int) -> int:
    """Open a regular file without following links and without blocking."""
    handle = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return handle
    os.close(handle)
    raise OSError(errno.EINVAL, "no regular file")


def foreign(folder: Path) -> str:
    """Reason why other users can change a folder, with a remedy; empty if they cannot."""
    if sys.platform == "win32" or folder in _own:
        return ""
    why = _foreign(folder)
    if not why:
        _own.add(folder)
    return why


_own: set[Path] = set()
"""Folders that have passed the check."""


def _foreign(folder: Path) -> str:
    place, home = folder.resolve(), _home()
    for part in (place, *place.parents):
        try:
            about = part.stat()
        except OSError as error:
            return f"{part}: {error.strerror or error}"
        fault = _fault(about)
        if fault and (part == place or not about.st_mode & stat.S_ISVTX or about.st_uid not in _owners()):
            return f"{part} {fault}"
        if part == home:
            return ""
    return ""


def _fault(about: os.stat_result) -> str:
    """Reason why others can change a file or folder with this owner and mode; empty if they cannot."""
    if sys.platform == "win32":
        return ""
    if about.st_uid not in _owners():
        return f"belongs to another user ({about.st_uid})"
    others = stat.S_IWOTH | (0 if about.st_gid == _private_group() else stat.S_IWGRP)
    if about.st_mode & others:
        return f"can be written by others (mode {stat.S_IMODE(about.st_mode):o}): chmod go-w"
    return ""


def _owners() -> tuple[int, int]:
    return 0, os.geteuid()


@lru_cache(maxsize=1)
def _private_group() -> int | None:
    """Group with the user's name and no other member; None if there is none."""
    try:
        import grp
        import pwd

        user = pwd.getpwuid(os.geteuid())
        group = grp.getgrgid(user.pw_gid)
        return group.gr_gid if group.gr_name == user.pw_name and not {*group.gr_mem} - {user.pw_name} else None
    except (ImportError, KeyError):
        return None


def _home() -> Path | None:
    try:
        import pwd

        return Path(pwd.getpwuid(os.geteuid()).pw_dir).resolve()
    except (ImportError, KeyError, OSError, RuntimeError):
        return None
