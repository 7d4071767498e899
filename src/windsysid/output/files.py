"""A single file that appears whole or not at all."""

import contextlib
import errno
import os
import secrets
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from windsysid.errors import OutputError
from windsysid.output.locks import LOCK, PART, release, remove_abandoned, try_lock

__all__ = [
    "claim_file", "explain_errors", "make_folders", "path_text", "place_file", "remove_empty", "replace_file", "sync",
]  # fmt: skip

Write = Callable[[BinaryIO], object]


@contextmanager
def claim_file(
    path: str | Path, *, overwrite: bool = False, inputs: Iterable[str | Path] = ()
) -> Iterator[Callable[[Write], None]]:
    """Reserve the name of a file before its content is computed; yields a function that writes all of it, or nothing.

    Raises
    ------
    OutputError
        If the file is there and `overwrite` is off, it is a folder or one of the `inputs`, another process is writing
        it, or it cannot be written.
    """
    path = Path(path)
    if os.path.realpath(path) in map(os.path.realpath, inputs):
        raise OutputError(f"{path}: is to be read: choose another name for the file to write")
    remedy = "choose a folder you may write to, with space left"
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder, expected the name of a file; add one")
    if os.path.lexists(path) and not overwrite:
        raise _there(path)
    lock = path.with_name(f".{path.name}{LOCK}")
    made: list[Path] = []
    handle: int | None = None

    def write(content: Write) -> None:
        with explain_errors(str(path), remedy):
            replace_file(path, content, overwrite=overwrite)

    try:
        with explain_errors(str(path), remedy):
            make_folders(path.absolute().parent, made)
            handle = try_lock(lock)
        if handle is None:
            raise OutputError(f"{path}: another process is writing it; wait for it, or choose another name")
        yield write
    finally:
        if handle is not None:
            release(handle, lock)
        remove_empty(made)


def replace_file(path: Path, write: Write, *, overwrite: bool = True) -> None:
    """Let `write` fill a file next to `path`, flush it to the disk and rename it: `path` is old or new.

    Raises
    ------
    OutputError
        If `path` is there and `overwrite` is off.
    OSError
        If it cannot be written: `path` is then as it was, and nothing is left next to it.
    """
    remove_abandoned(path.parent)
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    handle = try_lock(part)  # the lock says that the process is alive: others leave the file alone
    if handle is None:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
            if sys.platform == "win32":  # no open file can be renamed there
                file.close()
            place_file(part, path, overwrite=overwrite)
        sync(path.parent)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _there(path: Path) -> OutputError:
    return OutputError(f"{path}: is already there; choose another name, or overwrite it (overwrite=True)")


@contextmanager
def explain_errors(what: str, remedy: str) -> Iterator[None]:
    """Convert a message of the system to one line."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{what} cannot be written: {error.strerror or error}; {remedy}") from error


# file system


def path_text(path: str | Path) -> str:
    """Path as text that UTF-8 can encode, with an escape such as ``\\xe9`` for each byte that is no character."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def place_file(source: Path, target: Path, *, overwrite: bool) -> None:
    """Rename; unless overwriting, a file that has come to be there meanwhile stays."""
    if overwrite:
        os.replace(source, target)
        return
    try:
        os.link(source, target)
    except FileExistsError:
        raise _there(target) from None
    except OSError:  # a file system without hard links
        if os.path.lexists(target):
            raise _there(target) from None
        os.rename(source, target)
    else:
        source.unlink()


def sync(folder: Path) -> None:
    """Flush the names in a folder to the disk."""
    if sys.platform != "win32":
        try:
            handle = os.open(folder, os.O_RDONLY)
        except PermissionError:  # it may be written but not listed
            return
        try:
            os.fsync(handle)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a file system that flushes files only
                raise
        finally:
            os.close(handle)


def make_folders(folder: Path, made: list[Path]) -> None:
    """Make a folder and those above it, and add to `made` which ones, so that whoever is interrupted knows."""
    missing = []
    while not folder.is_dir():
        missing.append(folder)
        folder = folder.parent
    for path in reversed(missing):
        try:
            path.mkdir()
        except FileExistsError:
            if not path.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, f"{path} is a file") from None
        else:
            made.append(path)
            sync(path.parent)


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove those folders that are empty."""
    for folder in sorted(set(folders), key=lambda path: len(path.parts), reverse=True):
        with contextlib.suppress(OSError):
            folder.rmdir()
