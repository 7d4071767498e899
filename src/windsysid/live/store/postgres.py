"""A store in a PostgreSQL database, in a schema of its own: ``windsysid``."""

import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import unquote, urlsplit

from windsysid.errors import StoreError
from windsysid.live.store.database import bring_up_to_date, one_line

__all__ = ["Postgres"]

LOCK = 0x57494E44
"""``WIND``: the advisory lock that the one service of a database holds while it is connected."""

MAX_IDLE_CONNECTIONS = 4
"""Connections kept for readers."""

TIMEOUT_PARAMETERS = {
    "connect_timeout": 5, "keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 3,
    "tcp_user_timeout": 15_000, "application_name": "windsysid",
}  # fmt: skip
"""Time-outs for a server that does not answer, unless the URL sets them."""

MAX_UNLOCK_MS = 3000
"""A service that has just ended still holds the lock until the server has seen its connection close."""

PASSING = ("08", "53", "55", "57", "58", "40")
"""Classes of errors that may pass: connection, resources, lock, operator, system, rollback."""


class Postgres:
    """A database that one service writes to; PostgreSQL 12 or newer.

    Parameters
    ----------
    url
        ``postgresql://user@host:port/database``; the password better in the environment (PGPASSWORD) or ~/.pgpass.

    Raises
    ------
    StoreError
        If it is none of ours, another service has it, or it cannot be opened.
    """

    begin = "BEGIN"

    def __init__(self, url: str, *, read_only: bool = False) -> None:
        try:
            import psycopg
        except ImportError:
            raise StoreError("a store in PostgreSQL needs psycopg: pip install 'windsysid[live]'") from None
        self._driver = psycopg
        self.errors: type[Exception] = psycopg.Error
        self.content_errors: type[Exception] = psycopg.DataError
        self._read_only = read_only
        self._idle: list[Any] = []
        self._guard = threading.Lock()
        self._read(url)
        self._first: Any = None
        try:
            self._first = self._open() if read_only else self._claim()
            self._make(self._first)
        except psycopg.Error as error:
            self.release()
            raise StoreError(f"{self.name} cannot be opened: {self.explain(error)}") from None
        except BaseException:
            self.release()
            raise

    def _read(self, url: str) -> None:
        """Take the parts of a URL, its name for messages, and what these must not hold."""
        try:
            parts = self._driver.conninfo.conninfo_to_dict(url)
            self._secrets = {str(parts.get("password") or ""), unquote(urlsplit(url).password or "")} - {""}
        except (self._driver.Error, ValueError):
            raise StoreError("the store's URL cannot be read: expected postgresql://user@host:port/database") from None
        self._parts: dict[str, Any] = TIMEOUT_PARAMETERS | parts
        place = "/".join(str(parts[key]) for key in ("host", "dbname") if key in parts)
        self.name = f"database {place or 'of the environment'}"

    def explain(self, error: Exception) -> str:
        """Message of the driver in one line, without the password."""
        text = one_line(error)
        for secret in self._secrets:
            text = text.replace(secret, "***")
        return text

    def _open(self) -> Any:
        connection = self._driver.connect(**self._parts, autocommit=True)
        connection.execute("SET search_path TO windsysid")
        return connection

    def _claim(self) -> Any:
        """A connection that holds the lock: the server lets it go with the connection."""
        connection = self._open()
        connection.execute(f"SET lock_timeout TO {MAX_UNLOCK_MS}")
        try:
            connection.execute(f"SELECT pg_advisory_lock({LOCK})")
        except self._driver.errors.LockNotAvailable:
            connection.close()
            raise StoreError(
                f"{self.name}: another service writes to it: stop that one, or choose another store"
            ) from None
        connection.execute("RESET lock_timeout")
        return connection

    def _make(self, connection: Any) -> None:
        """Check that the tables are ours; make them where there are none."""
        if not self._read_only:
            there = connection.execute("SELECT 1 FROM pg_namespace WHERE nspname = 'windsysid'").fetchone()
            if there is None:
                connection.execute("CREATE SCHEMA IF NOT EXISTS windsysid")
        found = connection.execute("SELECT tablename FROM pg_tables WHERE schemaname = 'windsysid'")
        tables = [row[0] for row in found]
        bring_up_to_date(connection, self.name, tables, self.sql, begin=self.begin, read_only=self._read_only)

    def sql(self, statement: str) -> str:
        """A statement in its dialect."""
        return statement.replace("BYTES", "BYTEA").replace("%", "%%").replace("?", "%s")

    def connect(self) -> Any:
        """A connection to write by."""
        first, self._first = self._first, None
        return first or self._claim()

    @contextmanager
    def reader(self) -> Iterator[Any]:
        """A connection to read by: opening one takes the server milliseconds, so some are kept."""
        with self._guard:
            connection = self._idle.pop() if self._idle else None
        if connection is None:
            connection = self._open()
            connection.execute("SET default_transaction_read_only TO on")
        kept = False
        try:
            yield connection
            with self._guard:
                kept = len(self._idle) < MAX_IDLE_CONNECTIONS
                if kept:
                    self._idle.append(connection)
        except self._driver.OperationalError:
            self._forget()  # the server went: so did the others
            raise
        finally:
            if not kept:
                connection.close()

    def _forget(self) -> None:
        with self._guard:
            idle, self._idle = self._idle, []
        for connection in idle:
            with contextlib.suppress(self._driver.Error):
                connection.close()

    def passes(self, error: Exception) -> bool:
        """Check whether an error is temporary; without a code, the connection was lost."""
        state = getattr(error, "sqlstate", None)
        if state is None:
            return isinstance(error, self._driver.OperationalError | self._driver.InterfaceError)
        return str(state).startswith(PASSING)

    def bytes(self, connection: Any) -> int:
        """Tables and indices."""
        found = connection.execute(
            "SELECT coalesce(sum(pg_total_relation_size(c.oid)), 0) FROM pg_class c JOIN pg_namespace n"
            " ON n.oid = c.relnamespace WHERE n.nspname = 'windsysid' AND c.relkind = 'r'"
        )
        return int(found.fetchone()[0])

    def tidy(self, connection: Any) -> None:
        """The server's autovacuum does."""

    def release(self) -> None:
        """Let another service have it."""
        self._forget()
        if self._first is not None:
            self._first.close()
            self._first = None
