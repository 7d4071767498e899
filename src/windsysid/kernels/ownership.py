"""Which files and folders other users cannot have changed, by the rules of OpenSSH's ``StrictModes``.

A file and every folder above it must belong to the user or to root, and nobody else may write them. The check ends at
the user's home folder. A folder above that has the sticky bit, as ``/tmp`` has, may be written by all: entries of
others cannot be renamed there. The user's private group counts as the user.
"""

import errno
import os
import stat
import sys
from functools import lru_cache
from pathlib import Path

__all__ = ["foreign", "read_own"]


def read_own(path: Path) -> bytes | None:
    """The content of a file that no other user can have changed; None where it is another's, or not readable."""
    if foreign(path.parent):
        return None
    try:
        with open(path, "rb", opener=_opened) as file:
            return None if _fault(os.fstat(file.fileno())) else file.read()
    except OSError:
        return None


def _opened(path: str, flags: int) -> int:
    """Open a regular file: no link, and nothing that might wait for another process."""
    handle = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return handle
    os.close(handle)
    raise OSError(errno.EINVAL, "no regular file")


def foreign(folder: Path) -> str:
    """Why a folder may be changed by other users, with what to do; empty where it may not."""
    if sys.platform == "win32" or folder in _own:
        return ""
    why = _foreign(folder)
    if not why:
        _own.add(folder)
    return why


_own: set[Path] = set()
"""Folders that were looked at before."""


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
    """Why others may change what has this owner and mode."""
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
    """The group that has the user's name and no other member; None where there is none."""
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
