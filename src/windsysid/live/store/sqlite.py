"""A store in one file: SQLite, which comes with Python."""

import contextlib
import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from windsysid.errors import StoreError, unreadable
from windsysid.live.store.database import bring_up_to_date, one_line
from windsysid.output.locks import LOCK, release, try_lock

__all__ = ["Sqlite"]

MARK = 0x57494E44
"""``WIND``: the file's application id."""

BUSY = 10.0
"""Time that a statement waits for another process that reads or copies the file [s]."""

PASSING = {
    sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_NOMEM, sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_READONLY,
}  # fmt: skip


class Sqlite:
    """A file in WAL mode: readers never wait for the writer, nor the writer for them.

    Parameters
    ----------
    path
        None for one in a temporary folder, which goes when the store is closed.

    Raises
    ------
    StoreError
        If it is none of ours, another service has it, or it cannot be opened.
    """

    errors: type[Exception] = sqlite3.Error
    content_errors: type[Exception] = sqlite3.DataError
    begin = "BEGIN IMMEDIATE"

    def __init__(self, path: Path | None, *, read_only: bool = False) -> None:
        self._folder = None if path is not None else tempfile.TemporaryDirectory(prefix="windsysid-")
        self._path = Path(self._folder.name) / "store.sqlite" if self._folder else Path(path or "").absolute()
        self.name = ":memory:" if path is None else f"store {path}"
        self._read_only = read_only
        self._lock = self._path.with_name(f".{self._path.name}{LOCK}")
        self._handle: int | None = None
        self._check_path()
        if not read_only:
            self._claim()
        try:
            self._make()
        except BaseException:
            self.release()
            raise

    def _check_path(self) -> None:
        if not self._path.parent.is_dir():
            raise StoreError(f"{self.name}: its folder does not exist: create it, or choose another")
        if self._path.is_dir():
            raise StoreError(f"{self.name} is a folder, expected the name of a file: add one")
        if self._read_only and not self._path.exists():
            raise StoreError(unreadable(self._path, "a store that windsysid live wrote", FileNotFoundError()))

    def _claim(self) -> None:
        try:
            self._handle = try_lock(self._lock)
        except OSError as error:
            raise StoreError(
                f"{self.name} cannot be written: {error.strerror or error}; choose a folder you may write to"
            ) from None
        if self._handle is None:
            raise StoreError(f"{self.name}: another service writes to it: stop that one, or choose another store")

    def _make(self) -> None:
        """Check that the file is ours; make it where there is none."""
        self._make_file()
        try:
            with closing(self._open()) as connection:
                tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
                mark = connection.execute("PRAGMA application_id").fetchone()[0]
                if tables and mark != MARK:
                    raise StoreError(f"{self.name} is a database of another program: choose another name")
                if not tables and not self._read_only:
                    connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
                    connection.execute(f"PRAGMA application_id = {MARK}")
                    connection.execute("PRAGMA journal_mode = WAL")
                bring_up_to_date(connection, self.name, tables, self.sql, begin=self.begin, read_only=self._read_only)
        except sqlite3.Error as error:
            raise StoreError(f"{self.name} cannot be opened: {one_line(error)}") from None

    def _make_file(self) -> None:
        if self._path.exists() and self._path.stat().st_size:
            with self._path.open("rb") as file:
                if file.read(16) != b"SQLite format 3\0":
                    raise StoreError(f"{self.name} is no store of windsysid: choose another name")
        elif not self._read_only:
            with contextlib.suppress(FileExistsError):
                os.close(os.open(self._path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o640))

    def _open(self) -> sqlite3.Connection:
        """Open the file; a file that has been removed is not created again."""
        return sqlite3.connect(
            self._path.as_uri() + "?mode=rw", uri=True, timeout=BUSY, isolation_level=None, check_same_thread=False
        )

    def sql(self, statement: str) -> str:
        """A statement in its dialect."""
        return statement.replace("BYTES", "BLOB")

    def connect(self) -> sqlite3.Connection:
        """Connection for writing: committed data are on disk."""
        connection = self._open()
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute(f"PRAGMA synchronous = {'OFF' if self._folder else 'FULL'}")
        connection.execute(f"PRAGMA journal_size_limit = {64 << 20}")
        connection.execute("PRAGMA cache_size = -65536")
        return connection

    @contextmanager
    def reader(self) -> Iterator[sqlite3.Connection]:
        """A connection to read by."""
        with closing(self._open()) as connection:
            connection.execute("PRAGMA query_only = 1")
            yield connection

    def passes(self, error: Exception) -> bool:
        """Check whether an error is temporary."""
        code = getattr(error, "sqlite_errorcode", None)
        return code is not None and code & 0xFF in PASSING

    def explain(self, error: Exception) -> str:
        """Message of the driver in one line."""
        return one_line(error)

    def bytes(self, connection: Any) -> int:
        """The file and its log."""
        log = self._path.with_name(self._path.name + "-wal")
        return sum(path.stat().st_size for path in (self._path, log) if path.exists())

    def tidy(self, connection: Any) -> None:
        """Free pages in portions, so that no commit waits for long."""
        connection.execute("PRAGMA incremental_vacuum(4096)").fetchall()

    def release(self) -> None:
        """Let another service have it."""
        if self._handle is not None:
            release(self._handle, self._lock)
            self._handle = None
        if self._folder is not None:
            self._folder.cleanup()
