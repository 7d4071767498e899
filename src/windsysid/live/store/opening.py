"""Open a store by its URL."""

from pathlib import Path

from windsysid.errors import StoreError
from windsysid.live.store.database import Database
from windsysid.live.store.keep import Keep
from windsysid.live.store.postgres import Postgres
from windsysid.live.store.sql_store import SqlStore
from windsysid.live.store.sqlite import Sqlite

__all__ = ["open_store"]


def open_store(url: str, keep: Keep | None = None, *, read_only: bool = False) -> SqlStore:
    """Open a store; made where there is none.

    Parameters
    ----------
    url
        The path of an SQLite file, bare or as ``sqlite:///relative/path`` or ``sqlite:////absolute/path``;
        ``postgresql://user@host:port/database``; or ``:memory:``, which is gone when it is closed.
    keep
        How long it keeps what.
    read_only
        For an export or a look while the service runs: nothing is made, locked or changed.

    Raises
    ------
    StoreError
        If it is no store of ours, is of a newer version, another service writes to it, or it cannot be opened.
    """
    return SqlStore(_database(url, read_only), keep or Keep(), read_only=read_only)


def _database(url: str, read_only: bool) -> Database:
    scheme, separator, path = url.partition("://")
    if url == ":memory:":
        return Sqlite(None, read_only=read_only)
    if not separator:
        return Sqlite(Path(url), read_only=read_only)
    if scheme in ("postgresql", "postgres"):
        return Postgres(url, read_only=read_only)
    if scheme == "sqlite" and path.startswith("/") and path != "/":
        return Sqlite(Path(path[1:]), read_only=read_only)
    raise StoreError(
        f"store of kind '{scheme[:20]}': expected a path, sqlite:///path or postgresql://user@host:port/database"
    )
