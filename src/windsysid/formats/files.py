"""What every format needs from a file: that it is there, and that writing leaves no half file behind."""

import contextlib
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

from windsysid.errors import OutputError, RecordError

__all__ = ["check_input", "named_after", "read_start", "write_beside"]


# os.path answers where Path would raise: a folder that may not be entered, a name that cannot be one.


def check_input(path: Path) -> None:
    """Refuse what is not a file with something in it.

    Raises
    ------
    RecordError
        If there is no such file, it is a folder, it is empty, or it may not be read.
    """
    if os.path.isdir(path):
        raise RecordError(f"{path}: is a folder, expected a file; name one of the files in it")
    if not os.path.exists(path):
        raise RecordError(f"{path}: no such file; check the name and the folder")
    if not read_start(path, 1):
        raise RecordError(f"{path}: the file is empty, expected a record; copy or export it again")


@contextlib.contextmanager
def named_after(path: Path) -> Iterator[None]:
    """Refuse what is not a file with something in it, and put the file's name before every error inside.

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
        raise RecordError(f"{path}: {error}") from error
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
        raise RecordError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error


def write_beside(path: Path, write: Callable[[Path], None], *, overwrite: bool) -> None:
    """Let `write` fill a temporary file in the same folder, then rename it to `path`.

    Raises
    ------
    OutputError
        If `path` is there and `overwrite` is False, or the folder is missing or not writable.
    """
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder, expected the name of a file; add one")
    if os.path.exists(path) and not overwrite:
        raise OutputError(f"{path}: is already there; choose another name or overwrite it on purpose")
    if not os.path.isdir(path.parent):
        raise OutputError(f"{path}: the folder {path.parent} does not exist; create it or choose another")
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        write(temporary)
        os.replace(temporary, path)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); choose a folder you may write to, with space left"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
