"""Protocol of databases: differences between SQLite and PostgreSQL. All other SQL is the same."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

from windsysid.errors import StoreError
from windsysid.live.store.schema import STEPS

__all__ = ["Database", "bring_up_to_date", "one_line"]


class Database(Protocol):
    """One kind of database. Connections are those of its driver, each statement a transaction unless `begin` was said.

    Attributes
    ----------
    name
        For messages: without its password.
    errors
        What its driver raises.
    content_errors
        Those of `errors` whose cause is the data to be written: a number too large, text that it cannot hold.
    begin
        The statement that begins to write.
    """

    name: str
    errors: type[Exception]
    content_errors: type[Exception]
    begin: str

    def sql(self, statement: str) -> str:
        """A statement in its dialect."""

    def connect(self) -> Any:
        """Exclusive connection for writing.

        Raises
        ------
        StoreError
            If another service has it, or what is there is no store.
        """

    def reader(self) -> AbstractContextManager[Any]:
        """A connection to read by."""

    def passes(self, error: Exception) -> bool:
        """Check whether an error is temporary: a full disk, a server that restarts."""

    def explain(self, error: Exception) -> str:
        """Message of the driver in one line, without the password."""

    def bytes(self, connection: Any) -> int:
        """Size of the store on disk [bytes]."""

    def tidy(self, connection: Any) -> None:
        """Return deleted pages to the disk."""

    def release(self) -> None:
        """Let another service have it."""


def one_line(error: BaseException) -> str:
    """First line of a driver's message."""
    return " ".join(str(error).strip().partition("\n")[0].split())[:100] or type(error).__name__


def bring_up_to_date(
    connection: Any, name: str, tables: Sequence[str], sql: Callable[[str], str], *, begin: str, read_only: bool
) -> None:
    """Make the tables of a new store, or those of an older version into today's: all in one transaction.

    Raises
    ------
    StoreError
        If there are tables but no store, it is of a newer version, or it may not be changed and is not of today's.
    """
    today = len(STEPS)
    if tables and "windsysid_store" not in tables:
        raise StoreError(f"{name} holds tables of another program: choose another place for the store")
    version = connection.execute("SELECT version FROM windsysid_store").fetchone()[0] if tables else 0
    if version > today:
        raise StoreError(
            f"{name} was written by a newer windsysid (format {version}, expected up to {today}): install that version"
        )
    if version == today:
        return
    if read_only:
        state = "is empty" if not tables else f"has an older format ({version}, expected {today})"
        raise StoreError(f"{name} {state}: start windsysid live on it once")
    connection.execute(begin)
    for step in STEPS[version:]:
        for statement in step:
            connection.execute(sql(statement))
    connection.execute(f"UPDATE windsysid_store SET version = {today}")
    connection.execute("COMMIT")
