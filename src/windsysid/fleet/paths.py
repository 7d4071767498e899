"""Paths of records: how they are found, their type, and reasons why a file cannot be opened.

An archive stores text, paths of a file system are bytes. A path that is not UTF-8 is stored in the form of
`windsysid.output.files.path_text`. Such a file cannot be opened by the stored path, and its row asks to rename it.
"""

import glob
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from windsysid.errors import ConfigurationError
from windsysid.fleet.remote import is_remote, list_remote, size_of
from windsysid.output.files import path_text
from windsysid.records.formats import FORMATS

__all__ = ["UNKNOWN_SIZE", "is_file_or_broken_link", "record_paths", "size_or_unknown", "why_missing"]

UNKNOWN_SIZE = -1
"""Value for the size of a missing file [bytes]."""


def record_paths(sources: str | Path | Iterable[str | Path], archive: Path) -> list[str]:
    """List the absolute paths of records, each once, in order; of folders, those with the ending of a format.

    A broken link is listed, so that its row reports it; a device or a named pipe is no record.
    """
    listed = [sources] if isinstance(sources, str | Path) else list(sources)
    found: dict[str, None] = {}
    for source in listed:
        below = _records_of(source, archive)
        if not below:
            raise ConfigurationError(f"source {source}: expected a file, a folder or a pattern with records, got none")
        found |= dict.fromkeys(map(path_text, below))
    return sorted(found)


def _records_of(source: str | Path, archive: Path) -> list[str]:
    """List the possible records of an address, a folder, a file or a pattern."""
    path = Path(source)
    if isinstance(source, str) and is_remote(source):
        return list_remote(source)
    if path.is_dir():
        return _walk(path.resolve(), archive)
    if is_file_or_broken_link(path):
        return [str(_absolute(path))]
    named = [_absolute(Path(name)) for name in glob.glob(str(source), recursive=True)]
    return [each for one in named for each in _below(one, archive)]


def _absolute(path: Path) -> Path:
    """Absolute path of the file, with links resolved unless they are broken."""
    return path.resolve() if os.path.exists(path) else path.absolute()


def _below(path: Path, archive: Path) -> list[str]:
    """List the possible records of a path that matches a pattern."""
    if path.is_dir():
        return _walk(path, archive)
    return [str(path)] if is_file_or_broken_link(path) else []


def _walk(folder: Path, archive: Path) -> list[str]:
    """Files below a folder that may be records, none of them hidden or of the archive."""
    found = []
    for place, folders, names in os.walk(folder):
        here = Path(place)
        folders[:] = [name for name in folders if not name.startswith(".") and here / name != archive]
        found += [str(here / name) for name in names if _is_record(here / name)]
    return found


def _is_record(path: Path) -> bool:
    """Test whether a path may be a record: not hidden, with the ending of a format."""
    named = any(one.is_named(path) for one in FORMATS)
    return named and not path.name.startswith(".") and is_file_or_broken_link(path)


def is_file_or_broken_link(path: Path) -> bool:
    """Test whether a path is a regular file or a broken link, and no folder, named pipe, socket or device."""
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
