"""Buffer of a publisher: uncommitted blocks, on disk, the oldest dropped when it is full."""

import sqlite3
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from windsysid.errors import OutputError

__all__ = ["Flow", "PackedBlock", "Ring"]

_APPLICATION = 0x77736272
"""Marks the file as ours: SQLite's application_id."""

_TABLES = """
CREATE TABLE IF NOT EXISTS block (
    id INTEGER PRIMARY KEY AUTOINCREMENT, turbine TEXT NOT NULL, stream TEXT NOT NULL, sequence INTEGER NOT NULL,
    payload BLOB NOT NULL, UNIQUE (turbine, stream, sequence));
CREATE TABLE IF NOT EXISTS flow (
    turbine TEXT NOT NULL, stream TEXT NOT NULL, newest INTEGER NOT NULL, PRIMARY KEY (turbine, stream));
"""


class Flow(NamedTuple):
    """One logger of one turbine: its blocks are numbered."""

    turbine: str
    stream: str


class PackedBlock(NamedTuple):
    """A block as bytes, with its number."""

    sequence: int
    payload: bytes


class Ring:
    """Blocks of many flows, each in the order of their numbers. Any thread may call it.

    Parameters
    ----------
    path
        Of its file, which survives the process and the machine; in memory where None.
    most
        Size of all blocks [bytes].

    Raises
    ------
    OutputError
        From every method, where the file cannot be read or written, or is none of ours.
    """

    def __init__(self, path: str | Path | None = None, *, most: int = 1_000_000_000) -> None:
        self.path, self.most = path, most
        self._lock = threading.RLock()
        try:
            self._db = sqlite3.connect(
                str(path or ":memory:"), isolation_level=None, check_same_thread=False, timeout=5.0
            )
            (tables,) = self._db.execute("SELECT count(*) FROM sqlite_master").fetchone()
            (mark,) = self._db.execute("PRAGMA application_id").fetchone()
            if tables and mark != _APPLICATION:
                raise OutputError(
                    f"{path}: expected a buffer of windsysid publish, got another database: take a new name"
                )
            self._db.execute("PRAGMA locking_mode = EXCLUSIVE")  # one publisher a file
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.executescript(f"PRAGMA application_id = {_APPLICATION}; {_TABLES}")
        except sqlite3.Error as error:
            raise self._failed(error) from None
        self._bytes = int(self._ask("SELECT coalesce(sum(length(payload)), 0) FROM block")[0][0])
        self._blocks = int(self._ask("SELECT count(*) FROM block")[0][0])

    def __len__(self) -> int:
        return self._blocks

    def flows(self) -> dict[Flow, int]:
        """All that ever had a block, and the newest number of each."""
        rows = self._ask("SELECT turbine, stream, newest FROM flow")
        return {Flow(turbine, stream): newest for turbine, stream, newest in rows}

    def put(self, blocks: Iterable[tuple[Flow, PackedBlock]]) -> int:
        """Keep blocks, all or none; how many old ones were dropped for them. One that is there is left as it is."""
        with self._lock:
            self._begin()
            try:
                for flow, block in blocks:
                    added = self._db.execute("INSERT OR IGNORE INTO block VALUES (NULL, ?, ?, ?, ?)", (*flow, *block))
                    self._blocks += added.rowcount
                    self._bytes += added.rowcount * len(block.payload)
                    self._db.execute(
                        "INSERT INTO flow VALUES (?, ?, ?)"
                        " ON CONFLICT DO UPDATE SET newest = max(newest, excluded.newest)",
                        (*flow, block.sequence),
                    )
                dropped = 0
                while self._bytes > self.most and self._blocks > 1:
                    ((oldest, size),) = self._db.execute("SELECT id, length(payload) FROM block ORDER BY id LIMIT 1")
                    self._db.execute("DELETE FROM block WHERE id = ?", (oldest,))
                    self._blocks, self._bytes, dropped = self._blocks - 1, self._bytes - size, dropped + 1
                self._db.execute("COMMIT")
            except sqlite3.Error as error:
                self._db.rollback()
                raise self._failed(error) from None
            return dropped

    def forget(self, flow: Flow, upto: int) -> None:
        """Let go of the blocks of a flow up to a number."""
        self._delete("turbine = ? AND stream = ? AND sequence <= ?", (*flow, upto))

    def drop(self, flow: Flow, sequence: int) -> None:
        """Let go of one block."""
        self._delete("turbine = ? AND stream = ? AND sequence = ?", (*flow, sequence))

    def _delete(self, where: str, given: tuple[object, ...]) -> None:
        with self._lock:
            which = f"FROM block WHERE {where}"
            ((count, size),) = self._ask(f"SELECT count(*), coalesce(sum(length(payload)), 0) {which}", given)
            if not count:
                return
            try:
                self._db.execute("PRAGMA synchronous = NORMAL")  # what comes back after a power cut is sent once more
                self._db.execute(f"DELETE {which}", given)
                self._db.execute("PRAGMA synchronous = FULL")
            except sqlite3.Error as error:
                raise self._failed(error) from None
            self._blocks, self._bytes = self._blocks - count, self._bytes - size

    def after(self, flow: Flow, sequence: int | None, most: int) -> list[PackedBlock]:
        """The next blocks of a flow behind a number, or its first ones."""
        rows = self._ask(
            "SELECT sequence, payload FROM block WHERE turbine = ? AND stream = ? AND sequence > ?"
            " ORDER BY sequence LIMIT ?",
            (*flow, -(2**63) if sequence is None else sequence, most),
        )
        return [PackedBlock(number, payload) for number, payload in rows]

    def holds(self, flow: Flow, sequence: int) -> bool:
        """Check whether a block is kept."""
        found = self._ask("SELECT 1 FROM block WHERE turbine = ? AND stream = ? AND sequence = ?", (*flow, sequence))
        return bool(found)

    @property
    def room(self) -> int:
        """Free space before the oldest block is dropped [bytes]."""
        return self.most - self._bytes

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            self._db.close()

    def _begin(self) -> None:
        try:
            self._db.execute("BEGIN IMMEDIATE")
        except sqlite3.Error as error:
            raise self._failed(error) from None

    def _ask(self, question: str, given: tuple[object, ...] = ()) -> list[Any]:
        with self._lock:
            try:
                return self._db.execute(question, given).fetchall()
            except sqlite3.Error as error:
                raise self._failed(error) from None

    def _failed(self, error: sqlite3.Error) -> OutputError:
        what = "another publisher uses it" if "locked" in str(error) else str(error)
        return OutputError(
            f"buffer {self.path or 'in memory'}: {what}: check the path, its permissions and the space left"
        )
