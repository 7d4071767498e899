"""A folder in which a logger leaves its files: each is taken when it is complete, and once."""

import asyncio
import logging
from collections.abc import Container, Iterator
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid.errors import RecordError, WindsysidError
from windsysid.live.blocks.block import Block
from windsysid.live.sources.cutting import begin_of, blocks_of
from windsysid.live.sources.source import Commits, Push, SourceState, refuse, stopped_within
from windsysid.records.formats import iterate_record
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.record import Record

__all__ = ["FolderSource"]

logger = logging.getLogger(__name__)

POLL_SECONDS = 2.0
"""Interval of reading the folder [s]: a file that is equal at two readings is complete."""

BLOCK_SECONDS = 10.0
"""Length of a block [s]."""

_PIECE_SECONDS = 600.0
"""Of a file that is in memory at once [s]."""


class _Face(NamedTuple):
    """Size [bytes] of a file and time of its last change [ns]."""

    size: int
    changed: int


class FolderSource:
    """Takes in the files of a folder, in the order of their names, those that are there and those that come.

    A file that cannot be read is tried again when it has changed. One that grows after it was taken is taken from where
    it ended. When the service starts, files that are there are brought once more: blocks are known by their start.

    Parameters
    ----------
    path
        Of the folder.
    turbine
        Whose files they are.
    pattern
        Of their names.
    mapping
        What their columns are.
    """

    def __init__(
        self, path: str | Path, turbine: str, *, pattern: str = "*", mapping: str | Path | Mapping | None = None
    ) -> None:
        self.path, self.turbine, self.pattern, self.mapping = Path(path), turbine, pattern, mapping
        self.state = SourceState()
        self._seen: dict[Path, _Face] = {}
        self._taken: dict[Path, _Face] = {}
        self._until: dict[Path, float] = {}  # of what was taken of a file: its last time, by its own clock [s]

    def describe(self) -> str:
        """The folder and whose it is."""
        return f"folder {self.path} of {self.turbine}"

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Take files in until `stop` is set."""
        while not stop.is_set():
            for path, face in await asyncio.to_thread(self._complete):
                until = self._until.get(path)
                try:
                    await self._take(path, push, stop)
                except _UnreadableError as error:
                    refuse(self, str(error))
                except BaseException:  # the store failed or the service ends: the file is read again later
                    self._until.pop(path, None)
                    if until is not None:
                        self._until[path] = until
                    raise
                if stop.is_set():
                    break
                self._taken[path] = face
            await stopped_within(stop, POLL_SECONDS)
        self.state = self.state._replace(state="ended")

    def _complete(self) -> list[tuple[Path, _Face]]:
        """Files that are new or changed since they were taken, and did not change since the last look."""
        try:
            found = {path: face for path in self._listed() if (face := _face(path)) is not None}
        except OSError as error:
            self._cannot_look(error)
            return []
        if self.state.state in ("waiting", "trying"):
            self.state = self.state._replace(state="running", text="")
        before, self._seen = self._seen, found
        self._forget_others(found)
        complete = (one for one in found.items() if one in before.items())
        return [(path, face) for path, face in complete if self._taken.get(path) != face]

    def _forget_others(self, found: Container[Path]) -> None:
        """Forget files that are not there any more."""
        for known in (self._taken, self._until):
            for path in [path for path in known if path not in found]:
                known.pop(path)

    def _cannot_look(self, error: OSError) -> None:
        why = str(error.strerror or error)
        if self.state.state != "trying":
            logger.warning("%s: %s; trying again", self.describe(), why)
        self.state = self.state._replace(state="trying", text=why)

    def _listed(self) -> list[Path]:
        """Paths of the folder whose names fit, in their order."""
        names = (path for path in self.path.iterdir() if not path.name.startswith("."))
        return sorted(path for path in names if fnmatch(path.name, self.pattern))

    async def _take(self, path: Path, push: Push, stop: asyncio.Event) -> None:
        commits = Commits(self, f"{path.name}: ")
        blocks = self._blocks(path)
        while not stop.is_set() and (block := await asyncio.to_thread(_next, blocks, path.name)) is not None:
            await commits.push(push, block)
        await commits.finish()

    def _blocks(self, path: Path) -> Iterator[Block]:
        until = self._until.get(path)
        begin = None
        for piece in iterate_record(path, _PIECE_SECONDS, mapping=self.mapping):
            begin = begin_of(piece) if begin is None else begin
            if begin is None:
                raise RecordError(
                    f"{path.name}: no start time with its zone: give zone or start in the mapping (docs/records.md)"
                )
            fresh = piece if until is None else _behind(piece, until)
            if fresh is not None:
                yield from blocks_of(fresh, self.turbine, begin, seconds=BLOCK_SECONDS)
                self._until[path] = float(fresh.time[-1])


def _face(path: Path) -> _Face | None:
    """Size and time of a file; None if it is empty, no file, or has been removed."""
    try:
        about = path.stat()
    except OSError:
        return None
    return _Face(about.st_size, about.st_mtime_ns) if path.is_file() and about.st_size else None


class _UnreadableError(RecordError):
    """A file that cannot be read, for any error that its reader raises."""


def _next(blocks: Iterator[Block], name: str) -> Block | None:
    try:
        return next(blocks, None)
    except (WindsysidError, OSError) as error:
        raise _UnreadableError(str(error)) from error
    except Exception as error:
        raise _UnreadableError(f"{name}: cannot be read ({type(error).__name__}: {error})") from error


def _behind(record: Record, until: float) -> Record | None:
    """The samples behind a time [s]; None where there are fewer than two."""
    first = int(np.searchsorted(record.time, until, side="right"))
    if record.samples - first < 2:
        return None
    return replace(record, time=record.time[first:], values=record.values[first:])
