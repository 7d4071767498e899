"""Paths of records: which may be records, how an archive holds them, and why one cannot be opened.

An archive holds text, a file system bytes. A path that is not UTF-8 is held as `windsysid.output.files.path_text`
writes it. A file of such a path cannot be opened by what the archive holds, so that its row asks to rename it.
"""

import os
import stat
from pathlib import Path

from windsysid.fleet.remote import is_remote, size_of

__all__ = ["UNKNOWN_SIZE", "is_file_or_broken_link", "size_or_unknown", "why_missing"]

UNKNOWN_SIZE = -1
"""Size of a file that is not there [B]."""


def is_file_or_broken_link(path: Path) -> bool:
    """Whether a path is a file or a link that leads nowhere: no folder, named pipe, socket or device."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return os.path.islink(path)


def size_or_unknown(source: str) -> int:
    """Bytes of a record's file or object, `UNKNOWN_SIZE` where it is not there."""
    try:
        return size_of(source)
    except OSError:
        return UNKNOWN_SIZE


def why_missing(source: str) -> str | None:
    """Why the file of a record is not there, in one line; None where it is."""
    if is_remote(source) or os.path.exists(source):
        return None
    if os.path.islink(source):
        return "the link leads to no file: mend it, or remove it"
    if "\\x" in source:
        return "the path is not UTF-8 (\\x stands for each byte that is no character): rename the file or its folder"
    return "the file is not there any more: copy it again"
