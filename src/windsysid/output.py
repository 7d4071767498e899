"""Where results go: a folder that appears whole or not at all, and is never overwritten silently."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from windsysid.errors import OutputError

__all__ = ["check_output", "new_folder"]


def check_output(folder: Path, *, overwrite: bool) -> None:
    """Refuse an output folder before any work is done.

    Raises
    ------
    OutputError
        If it is there already (and `overwrite` is off or it is not one of ours), or cannot be made.
    """
    if folder.exists():
        if not folder.is_dir():
            raise OutputError(f"output {folder}: expected a folder, got a file: choose another name")
        if any(folder.iterdir()):
            if not overwrite:
                raise OutputError(f"output {folder} is already there: choose another folder, or add --overwrite")
            if not any((folder / name).exists() for name in ("summary.json", "inspection.json")):
                raise OutputError(
                    f"output {folder} holds files that are not results of windsysid: choose another folder"
                )
    parent = folder.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError(
            f"output {folder} cannot be made: {parent} is not a folder that can be written to; choose another"
        )


@contextmanager
def new_folder(folder: Path, *, overwrite: bool) -> Iterator[Path]:
    """A temporary folder that becomes `folder` when everything in it has been written."""
    check_output(folder, overwrite=overwrite)
    temporary: Path | None = None
    try:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.absolute().parent))
        yield temporary
        temporary.chmod(0o755)
        if folder.exists():
            shutil.rmtree(folder)
        temporary.rename(folder)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(
            f"output {folder} cannot be written: {error.strerror or error}; choose another folder"
        ) from None
    finally:
        if temporary is not None and temporary.exists():
            shutil.rmtree(temporary)
