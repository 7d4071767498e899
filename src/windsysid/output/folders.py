"""Output of windsysid: no file of the user is lost, and a result is complete, the old one or the new one.

`claim` takes a folder for a result, `claim_file` the name of a single file; both refuse before any work is done, and
hold a lock that ends with the process. Everything is written next to its place, flushed to the disk and renamed.

A result has several files, which no file system renames at once. So the folder holds a note,
``.windsysid/manifest.json``: the names, sizes and SHA-256 of the files that are ours. A result is complete when all its
new files lie on the disk in ``.windsysid/new-…``; the note that names them is the commit. Only then do they take their
places. Who finds files that a process left between (it was killed, the machine crashed) moves the rest: the next
command that writes there, or the next that reads (`result_file`). What is not in the note, or not as the note has it,
is the user's: it is never touched.
"""

import contextlib
import hashlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from windsysid.configuration import parse_json
from windsysid.errors import OutputError
from windsysid.output.files import explain_errors, make_folders, place_file, remove_empty, replace_file, sync
from windsysid.output.locks import HOME, MANIFEST, MAX_TRIES, release, remove_abandoned, try_lock

__all__ = ["Saveable", "claim", "is_free", "result_file", "summary_of", "without", "written_by"]

NAMES = frozenset(
    [
        "answer.json",
        "report.html",
        "summary.json",
        "identification.nc",
        "inspection.json",
        "changes.png",
        "fleet.png",
        "matches.csv",
        "modes.csv",
        "monitor.png",
        "plan.png",
    ]
)
"""Files that results consist of: a user's file of such a name is met before the work, not after it."""


class Saveable:
    """A result that knows its files, and is saved as any other."""

    def files(self) -> dict[str, bytes]:
        """Files of `save`, by name."""
        raise NotImplementedError

    def save(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write the result into a folder of its own, which is made where it is missing.

        The result appears whole or not at all. To overwrite is to replace the files of an earlier result; other files
        in the folder stay.

        Raises
        ------
        OutputError
            If the folder holds anything and `overwrite` is off, a file would be replaced that is not as windsysid wrote
            it, another process is writing there, or the folder cannot be written.
        """
        with claim(folder, overwrite=overwrite) as write:
            write(self.files())


@contextmanager
def claim(
    folder: str | Path, *, overwrite: bool = False, inputs: Iterable[str | Path] = ()
) -> Iterator[Callable[[Mapping[str, bytes]], None]]:
    """Reserve a folder for a result before it is computed; yields a function that writes the result's files by name.

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
        with explain_errors(f"output {given}", "choose another folder, with space left"):
            _refuse_kept(given, folder, overwrite=overwrite)
            handle = _enter(given, folder, made)
            _recover(folder)
            _refuse_kept(given, folder, overwrite=overwrite)
            _refuse_changed(given, folder, NAMES)

        def write(files: Mapping[str, bytes]) -> None:
            with explain_errors(f"output {given}", "choose another folder, with space left"):
                _refuse_changed(given, folder, files)
                _commit(folder, files)
                _finish(folder)

        yield write
    finally:
        if handle is not None:
            with contextlib.suppress(OSError):
                _recover(folder)
            release(handle, folder / HOME / "lock")
            remove_empty([folder / HOME])
        remove_empty(made)


def result_file(folder: str | Path, name: str) -> Path:
    """Path of a result's file for reading; a result whose writing was cut short is put in its place first."""
    folder = Path(folder)
    noted = _noted(folder)
    if noted is None or not noted.staging(folder).is_dir():
        return folder / name
    with contextlib.suppress(OSError):  # the folder may not be writable, or a living process may be at it
        handle = try_lock(folder / HOME / "lock")
        if handle is not None:
            try:
                _recover(folder)
            finally:
                release(handle, folder / HOME / "lock")
    staged = noted.staging(folder)
    return staged / name if (staged / name).exists() or (staged.is_dir() and name not in noted.files) else folder / name


_COMMANDS = {
    "OperationalModes": "oma", "Comparison": "compare", "Watch": "monitor", "Separation": "damping", "Plan": "plan",
    "Campbell": "modes", "LinearisedModes": "modes", "ModeMatch": "match",
}  # fmt: skip
"""Classes of answers with the commands that write them."""


_FILES = {"identification.nc": "identify", "inspection.json": "inspect"}
_SUMMARIES = {"analysis": "oma", "published_seconds": "study", "archive": "report"}
"""Files, and keys of ``summary.json``, with the commands that write them."""


def summary_of(folder: str | Path) -> dict[str, Any]:
    """Content of a result's ``summary.json``; empty if there is none."""
    with contextlib.suppress(OSError, ValueError):
        found = parse_json(result_file(folder, "summary.json").read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else {}
    return {}


def written_by(folder: str | Path) -> str:
    """Name of the command that wrote a folder's result; empty if there is none, or it is not known."""
    with contextlib.suppress(OSError, ValueError, LookupError):
        return _COMMANDS[result_file(folder, "answer.json").read_text(encoding="utf-8")[:40].split('"')[3]]
    summary = summary_of(folder)
    known = [command for key, command in _SUMMARIES.items() if key in summary]
    known += [command for name, command in _FILES.items() if result_file(folder, name).exists()]
    return [*known, "batch" if any(Path(folder).glob("turbine=*")) else ""][0]


def without(expected: str, folder: str | Path) -> str:
    """Describe a folder that does not hold an expected result: its content, and advice."""
    folder = Path(folder)
    if not os.path.lexists(folder):
        return f"{folder}: no such folder, expected {expected}; check the name and the folder"
    maker = expected.partition("windsysid ")[2].split(" ")[0] or "identify"
    return f"{folder}: expected {expected}, got {_content_of(folder, maker)}"


def _content_of(folder: Path, maker: str) -> str:
    """Content of a folder in which a result of the command `maker` was expected, and advice."""
    if not folder.is_dir():
        what = "that holds it" if folder.name in NAMES else f"of a result; windsysid {maker} RECORD makes one"
        return f"a file: give the folder {what}"
    if (command := written_by(folder)) == "inspect":
        return "an inspection, which keeps no record: inspect the record again, or give another folder"
    if command:
        return f"one of {command}: give another folder"
    if (folder / "summary.json").exists():
        return "a summary of version 0.1.0 only: give the command again"
    return f"no result in it: check the name, or use windsysid {maker} first"


def is_free(folder: Path) -> bool:
    """Test whether a folder holds no result and no file, and no process is about to write one.

    What a process left that ended before it had a result does not count.
    """
    if not os.path.lexists(folder):
        return True
    if not folder.is_dir() or any(name != HOME for name in os.listdir(folder)) or _noted(folder) is not None:
        return False
    if not (folder / HOME).is_dir():
        return True
    handle = try_lock(folder / HOME / "lock")
    if handle is not None:
        release(handle, folder / HOME / "lock")
    return handle is not None


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
        """Test whether `path` is this very file."""
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
    """Content of the folder's note; None without a readable one, so that no file counts as windsysid's."""
    try:
        found = parse_json((folder / HOME / MANIFEST).read_text(encoding="utf-8"))
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
    sync(staging)
    told = {
        key: {name: {"size": entry.size, "sha256": entry.sha256} for name, entry in entries.items()}
        for key, entries in (("files", note.files), ("replaced", note.replaced))
    }
    text = json.dumps({**told, "waiting": note.waiting}, indent=1).encode()
    replace_file(folder / HOME / MANIFEST, lambda file: file.write(text))


def _finish(folder: Path) -> None:
    """Move prepared files to their place and remove replaced ones; a file of the user's in the way stays."""
    note = _noted(folder)
    if note is None or not note.staging(folder).is_dir():
        return
    staging = note.staging(folder)
    for name, entry in note.files.items():
        waiting, place = staging / name, folder / name
        if not waiting.exists() or entry.is_at(place):
            continue
        place_file(waiting, place, overwrite=name in note.replaced and note.replaced[name].is_at(place))
    for name, entry in note.replaced.items():
        if name not in note.files and entry.is_at(folder / name):
            (folder / name).unlink()
    sync(folder)
    shutil.rmtree(staging)


def _recover(folder: Path) -> None:
    """Under the lock: finish a committed result, and remove leftovers of dead processes."""
    _finish(folder)
    note = _noted(folder)
    with contextlib.suppress(FileNotFoundError):
        for path in (folder / HOME).iterdir():
            if path.name.startswith("new-") and (note is None or path.name != note.waiting):
                shutil.rmtree(path)
        remove_abandoned(folder / HOME)


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
    """Refuse a folder that holds anything, unless it is an earlier result and may be overwritten; write nothing."""
    if os.path.lexists(folder):
        if not folder.is_dir():
            raise OutputError(f"output {given}: expected a folder, got a file: choose another name")
        if any(name != HOME for name in os.listdir(folder)):
            if not overwrite:
                raise OutputError(
                    f"output {given} is already there: choose another folder, or overwrite it (overwrite=True)"
                )
            if _noted(folder) is None:
                raise OutputError(
                    f"output {given} holds files that are not noted as results of windsysid: choose another folder, or"
                    " move them"
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


# locks


def _enter(given: Path, folder: Path, made: list[Path]) -> int:
    """Make the folder, as `make_folders` does, and lock it."""
    for _ in range(MAX_TRIES):
        try:
            make_folders(folder / HOME, made)
            handle = try_lock(folder / HOME / "lock")
        except FileNotFoundError:  # another process has just let go of it, and removed it
            continue
        if handle is not None:
            return handle
        break
    raise OutputError(f"output {given}: another windsysid is writing there: wait for it, or choose another folder")
