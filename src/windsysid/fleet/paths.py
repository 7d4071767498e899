"""Paths of records: their type, and reasons why a file cannot be opened.

An archive stores text, paths of a file system are bytes. A path that is not UTF-8 is stored in the form of
`windsysid.output.files.path_text`. Such a file cannot be opened by the stored path, and its row asks to rename it.
"""

import os
import stat
from pathlib import Path

from windsysid.fleet.remote import is_remote, size_of

__all__ = ["UNKNOWN_SIZE", "is_file_or_broken_link", "size_or_unknown", "why_missing"]

UNKNOWN_SIZE = -1
"""Value for the size of a missing file [bytes]."""


def is_file_or_broken_link(path: Path) -> bool:
    """Whether a path is a regular file or a broken link, and no folder, named pipe, socket or device."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return os.path.islink(path)


def size_or_unknown(source: str) -> int:
    """Size of a record's file or object [bytes]; `UNKNOWN_SIZE` if it is missing."""
    try:
        return size_of(source)
    except OSError:
        return UNKNOWN_SIZE


def why_missing(source: str) -> str | None:
    """Reason in one line why the file of a record is missing; None if it exists."""
    if is_remote(source) or os.path.exists(source):
        return None
    if os.path.islink(source):
        return "the target of the link does not exist: correct or remove the link"
    if "\\x" in source:
        return "the path is not UTF-8 (\\x marks a byte that is no character): rename the file or its folder"
    return "the file does not exist any more: copy it again"
