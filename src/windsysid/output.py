"""How windsysid writes: nothing of the user's is lost, and a result is there whole, the old one or the new one.

`claim` takes a folder for a result, `claim_file` the name of a single file; both refuse before any work is done, and hold
a lock that ends with the process. Everything is written beside its place, flushed to the disk and renamed.

A result has several files, which no file system renames at once. So the folder holds a note, ``.windsysid/manifest.json``:
the names, sizes and SHA-256 of the files that are ours. A result is complete when all its new files lie on the disk in
``.windsysid/new-…``; the note that names them is the commit. Only then do they take their places. Who finds files that a
process left between (it was killed, the machine crashed) moves the rest: the next command that writes there, or the
next that reads (`result_file`). What is not in the note, or not as the note has it, is the user's: it is never
touched.
"""

import contextlib
import errno
import hashlib
import json
import logging
import os
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from windsysid.errors import OutputError

__all__ = ["Saveable", "claim", "claim_file", "replace_file", "result_file"]

Write = Callable[[BinaryIO], object]

NAMES = frozenset(
    [
        "report.html",
        "summary.json",
        "identification.nc",
        "inspection.json",
        "campbell.png",
        "changes.png",
        "damping.png",
        "monitor.png",
        "plan.png",
        "overview.png",
        "spectra.png",
        "spectrogram.png",
    ]
)
"""Files that results consist of: a user's file of such a name is met before the work, not after it."""

HOME, MANIFEST, LOCK, PART = ".windsysid", "manifest.json", ".windsysid-lock", ".windsysid-part"
TRIES, PAUSE = 10, 0.02  # a lock that is let go or swept up at this moment is asked for again [s]


class Saveable:
    """A result that knows its files, and is saved as any other."""

    def files(self) -> dict[str, bytes]:
        """What `save` writes, by name."""
        raise NotImplementedError

    def save(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write the result into a folder of its own, which is made where it is missing.

        The result appears whole or not at all. To overwrite is to replace the files of an earlier result; other files in the folder stay.

        Raises
        ------
        OutputError
            If the folder holds anything and `overwrite` is off, a file would be replaced that is not as windsysid wrote it, another
            process is writing there, or the folder cannot be written.
        """
        with claim(folder, overwrite=overwrite) as write:
            write(self.files())


@contextmanager
def claim(
    folder: str | Path, *, overwrite: bool = False, inputs: Iterable[str | Path] = ()
) -> Iterator[Callable[[Mapping[str, bytes]], None]]:
    """Take a folder for a result before the work for it is done; yields what writes the result's files by name.

    Parameters
    ----------
    folder
        It is made, and removed again if nothing is written.
    overwrite
        Replace an earlier result.
    inputs
        Records and results that the work reads: the folder that holds one is refused.

    Raises
    ------
    OutputError
        As `Saveable.save`.
    """
    given = Path(folder)
    _refuse_inputs(given, inputs)
    folder = Path(os.path.realpath(given))
    made: list[Path] = []
    handle: int | None = None
    try:
        with _explained(f"output {given}", "choose another folder, with space left"):
            _refuse_kept(given, folder, overwrite=overwrite)
            handle = _enter(given, folder, made)
            _recover(folder)
            _refuse_kept(given, folder, overwrite=overwrite)
            _refuse_changed(given, folder, NAMES)

        def write(files: Mapping[str, bytes]) -> None:
            with _explained(f"output {given}", "choose another folder, with space left"):
                _refuse_changed(given, folder, files)
                _commit(folder, files)
                _finish(folder)

        yield write
    finally:
        if handle is not None:
            with contextlib.suppress(OSError):
                _recover(folder)
            _release(handle, folder / HOME / "lock")
            _remove_empty([folder / HOME])
        _remove_empty(made)


@contextmanager
def claim_file(path: str | Path, *, overwrite: bool = False) -> Iterator[Callable[[Write], None]]:
    """Take the name of a file before its content is worked out; yields what writes the content, whole or not at all.

    Raises
    ------
    OutputError
        If the file is there and `overwrite` is off, it is a folder, another process is writing it, or it cannot be written.
    """
    path = Path(path)
    remedy = "choose a folder you may write to, with space left"
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder, expected the name of a file; add one")
    if os.path.lexists(path) and not overwrite:
        raise _there(path)
    lock = path.with_name(f".{path.name}{LOCK}")
    made: list[Path] = []
    handle: int | None = None

    def write(content: Write) -> None:
        with _explained(str(path), remedy):
            replace_file(path, content, overwrite=overwrite)

    try:
        with _explained(str(path), remedy):
            _make_folders(path.absolute().parent, made)
            handle = _grab(lock)
        if handle is None:
            raise OutputError(f"{path}: another process is writing it; wait for it, or choose another name")
        yield write
    finally:
        if handle is not None:
            _release(handle, lock)
        _remove_empty(made)


def replace_file(path: Path, write: Write, *, overwrite: bool = True) -> None:
    """Let `write` fill a file beside `path`, flush it to the disk and rename it: `path` is the old file or the new one.

    Raises
    ------
    OutputError
        If `path` is there and `overwrite` is off.
    OSError
        If it cannot be written: `path` is then as it was, and nothing is left beside it.
    """
    _sweep(path.parent)
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PART}")
    handle = _grab(part)  # the lock says that the process is alive: others leave the file alone
    if handle is None:
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
            if sys.platform == "win32":  # no open file can be renamed there
                file.close()
            _place(part, path, overwrite=overwrite)
        _sync(path.parent)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def result_file(folder: str | Path, name: str) -> Path:
    """Where a file of the result in `folder` is to be read; a result whose writing was cut short is put in its place first."""
    folder = Path(folder)
    noted = _noted(folder)
    if noted is None or not noted.staging(folder).is_dir():
        return folder / name
    with contextlib.suppress(OSError):  # the folder may not be writable, or a living process may be at it
        handle = _grab(folder / HOME / "lock")
        if handle is not None:
            try:
                _recover(folder)
            finally:
                _release(handle, folder / HOME / "lock")
    staged = noted.staging(folder)
    return staged / name if (staged / name).exists() or (staged.is_dir() and name not in noted.files) else folder / name


# the note


@dataclass(frozen=True)
class _Entry:
    """A file as it was written."""

    size: int
    sha256: str

    @classmethod
    def of(cls, content: bytes) -> "_Entry":
        return cls(len(content), hashlib.sha256(content).hexdigest())

    def is_at(self, path: Path) -> bool:
        """Whether `path` is this very file."""
        try:
            found = path.lstat()
            if not stat.S_ISREG(found.st_mode) or found.st_size != self.size:
                return False
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest() == self.sha256
        except OSError:
            return False


@dataclass(frozen=True)
class _Note:
    """The files of a result, the files of the one before that they replace, and where they wait for their places."""

    files: Mapping[str, _Entry]
    replaced: Mapping[str, _Entry]
    waiting: str

    def staging(self, folder: Path) -> Path:
        return folder / HOME / self.waiting


def _noted(folder: Path) -> _Note | None:
    """What the folder's note says; None without one that can be read, so that nothing counts as ours."""
    try:
        found = json.loads((folder / HOME / MANIFEST).read_text(encoding="utf-8"))
        files, replaced = (
            {str(name): _Entry(int(entry["size"]), str(entry["sha256"])) for name, entry in found[key].items()}
            for key in ("files", "replaced")
        )
        note = _Note(files, replaced, str(found["waiting"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    plain = all(os.path.basename(name) == name and name not in ("", ".", "..", HOME) for name in (*files, *replaced))
    return (
        note if plain and note.waiting.startswith("new-") and os.path.basename(note.waiting) == note.waiting else None
    )


def _commit(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the new files and the note that makes them the result."""
    before = _noted(folder)
    replaced = {} if before is None else {n: e for n, e in before.files.items() if os.path.lexists(folder / n)}
    note = _Note({n: _Entry.of(content) for n, content in files.items()}, replaced, f"new-{secrets.token_hex(4)}")
    staging = note.staging(folder)
    staging.mkdir()
    for name, content in files.items():
        with (staging / name).open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
    _sync(staging)
    told = {
        key: {name: {"size": entry.size, "sha256": entry.sha256} for name, entry in entries.items()}
        for key, entries in (("files", note.files), ("replaced", note.replaced))
    }
    text = json.dumps({**told, "waiting": note.waiting}, indent=1).encode()
    replace_file(folder / HOME / MANIFEST, lambda file: file.write(text))


def _finish(folder: Path) -> None:
    """Move what waits to its place and remove what was replaced; a file of the user's in the way stays."""
    note = _noted(folder)
    if note is None or not note.staging(folder).is_dir():
        return
    staging = note.staging(folder)
    for name, entry in note.files.items():
        waiting, place = staging / name, folder / name
        if not waiting.exists() or entry.is_at(place):
            continue
        _place(waiting, place, overwrite=name in note.replaced and note.replaced[name].is_at(place))
    for name, entry in note.replaced.items():
        if name not in note.files and entry.is_at(folder / name):
            (folder / name).unlink()
    _sync(folder)
    shutil.rmtree(staging)


def _recover(folder: Path) -> None:
    """Under the lock: finish a result that was committed, and remove what dead processes left."""
    _finish(folder)
    note = _noted(folder)
    with contextlib.suppress(FileNotFoundError):
        for path in (folder / HOME).iterdir():
            if path.name.startswith("new-") and (note is None or path.name != note.waiting):
                shutil.rmtree(path)
        _sweep(folder / HOME)


# refusals


def _refuse_inputs(given: Path, inputs: Iterable[str | Path]) -> None:
    folder = os.path.realpath(given)
    for path in inputs:
        if os.path.realpath(path) == folder and os.path.isdir(path):
            raise OutputError(f"output {given} is the result that is to be read: choose another folder")
        if os.path.isfile(path) and folder in (
            os.path.dirname(os.path.realpath(path)), os.path.realpath(os.path.dirname(path))
        ):  # fmt: skip
            raise OutputError(
                f"output {given} holds {Path(path).name}, which is to be read: choose a folder of its own"
            )


def _refuse_kept(given: Path, folder: Path, *, overwrite: bool) -> None:
    """Refuse a folder that holds anything, unless an earlier result is to be overwritten; nothing is written for that."""
    if os.path.lexists(folder):
        if not folder.is_dir():
            raise OutputError(f"output {given}: expected a folder, got a file: choose another name")
        if any(name != HOME for name in os.listdir(folder)):
            if not overwrite:
                raise OutputError(f"output {given} is already there: choose another folder, or add --overwrite")
            if _noted(folder) is None:
                raise OutputError(
                    f"output {given} holds files that are not noted as results of windsysid: choose another folder, or move them"
                )
    above = folder
    while not os.path.lexists(above):
        above = above.parent
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise OutputError(
            f"output {given} cannot be made: {above} is not a folder that can be written to; choose another"
        )


def _refuse_changed(given: Path, folder: Path, names: Iterable[str]) -> None:
    """Refuse to replace a file that is not as windsysid wrote it."""
    note = _noted(folder)
    ours = {} if note is None else note.files
    for name in sorted({*names, *ours}):
        if os.path.lexists(folder / name) and not (name in ours and ours[name].is_at(folder / name)):
            raise OutputError(
                f"output {given}: {name} was changed, or is not windsysid's: move it away, or choose another folder"
            )


def _there(path: Path) -> OutputError:
    return OutputError(f"{path}: is already there; choose another name, or overwrite it (--overwrite, overwrite=True)")


@contextmanager
def _explained(what: str, remedy: str) -> Iterator[None]:
    """Turn what the system says into one line."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{what} cannot be written: {error.strerror or error}; {remedy}") from error


# locks


def _enter(given: Path, folder: Path, made: list[Path]) -> int:
    """Make the folder, as `_make_folders` does, and lock it."""
    for _ in range(TRIES):
        try:
            _make_folders(folder / HOME, made)
            handle = _grab(folder / HOME / "lock")
        except FileNotFoundError:  # another process has just let go of it, and removed it
            continue
        if handle is not None:
            return handle
        break
    raise OutputError(f"output {given}: another windsysid is writing there: wait for it, or choose another folder")


def _grab(path: Path) -> int | None:
    """Open a file and lock it; None while another process holds it. The lock ends with the process, however that ends."""
    for attempt in range(TRIES):
        if attempt:
            time.sleep(PAUSE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        try:
            locked = _lock(handle)
        except OSError as error:
            _warn_unlocked(path.parent, error)
            return handle
        with contextlib.suppress(FileNotFoundError):
            if locked and os.path.samestat(os.fstat(handle), path.stat()):  # and nobody has removed it meanwhile
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


def _release(handle: int, lock: Path) -> None:
    """Remove a lock's file while it is held, so that nobody else's is removed, and let go."""
    if sys.platform == "win32":  # no open file can be removed there
        os.close(handle)
    with contextlib.suppress(OSError):
        lock.unlink(missing_ok=True)
    if sys.platform != "win32":
        os.close(handle)


def _sweep(folder: Path) -> None:
    """Remove what processes that are dead left half written: the parts that nobody holds."""
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


# file system


def _place(source: Path, target: Path, *, overwrite: bool) -> None:
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


def _sync(folder: Path) -> None:
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


def _make_folders(folder: Path, made: list[Path]) -> None:
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
            _sync(path.parent)


def _remove_empty(folders: Iterable[Path]) -> None:
    """Remove those folders that are empty."""
    for folder in sorted(set(folders), key=lambda path: len(path.parts), reverse=True):
        with contextlib.suppress(OSError):
            folder.rmdir()
