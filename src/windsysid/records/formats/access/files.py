"""Access to a file for every format: that it exists and can be read."""

import contextlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from windsysid.configuration import special_file_kind
from windsysid.errors import ConfigurationError, RecordError, unreadable

__all__ = ["check_input", "damaged", "named_after", "quiet", "read_start", "reading"]


# os.path answers where Path would raise: a folder that may not be entered, a name that cannot be one.


def check_input(path: Path) -> None:
    """Refuse a path that is not a file with content.

    Raises
    ------
    RecordError
        If there is no such file, it is a folder, a pipe, a device or a socket, it is empty, or it may not be read.
    """
    if os.path.isdir(path):
        raise RecordError(unreadable(path, "a record", IsADirectoryError()))
    if not os.path.exists(path):
        raise RecordError(unreadable(path, "a record", FileNotFoundError()))
    kind = special_file_kind(path)
    if kind:
        raise RecordError(f"{path}: is {kind}, expected a file; save its content as a file first")
    if not read_start(path, 1):
        raise RecordError(f"{path}: the file is empty, expected a record; copy or export it again")


@contextlib.contextmanager
def named_after(path: Path) -> Iterator[None]:
    """Refuse a path that is not a file with content, and put the file's name before every error inside.

    Raises
    ------
    RecordError
        As it was raised, beginning with the name of the file.
    """
    check_input(path)
    try:
        yield
    except RecordError as error:
        if str(error).startswith(f"{path}: "):
            raise
        raise type(error)(f"{path}: {error}") from error
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror or error}); copy it again") from error
    except MemoryError as error:
        raise RecordError(f"{path}: does not fit into memory; read a section of it or in pieces") from error


def read_start(path: Path, size: int) -> bytes:
    """The first `size` bytes of a file; RecordError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(size)
    except OSError as error:
        raise RecordError(unreadable(path, "a record", error)) from error


@contextlib.contextmanager
def quiet(package: str) -> Iterator[None]:
    """Keep a package from writing its own log to the terminal: an error of a file is one line of windsysid."""
    names = [name for name in logging.root.manager.loggerDict if name == package or name.startswith(f"{package}.")]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def damaged(error: Exception) -> Exception:
    """The error to raise where a library raised `error` while it read a file: libraries raise nearly anything then."""
    if isinstance(error, RecordError | ConfigurationError | MemoryError):
        return error
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return RecordError(f"is damaged or cut off ({reason}); copy or export it again")


@contextlib.contextmanager
def reading() -> Iterator[None]:
    """Convert a library's error while it reads a file to the error of `damaged`."""
    try:
        yield
    except Exception as error:
        raise damaged(error) from error
