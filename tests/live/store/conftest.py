from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from validation.postgres_server import MissingServerError, Server, postgres

from windsysid.live.store import Keep, open_store
from windsysid.live.store.sql_store import SqlStore

Open = Callable[..., SqlStore]


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    pytest.importorskip("psycopg", reason="psycopg is not installed")
    try:
        with postgres() as running:
            yield running
    except MissingServerError as error:
        pytest.skip(str(error))


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Of a store that is not there yet."""
    if request.param == "sqlite":
        return str(tmp_path / "store.sqlite")
    server: Server = request.getfixturevalue("server")
    return server.emptied()


@pytest.fixture
def again(url: str) -> Iterator[Open]:
    """Opens the store, closing the one that it opened before, as a restart does."""
    opened: list[SqlStore] = []

    def open_again(keep: Keep | None = None, **options: Any) -> SqlStore:
        for store in opened:
            store.close()
        opened[:] = [open_store(url, keep, **options)]
        return opened[0]

    yield open_again
    for store in opened:
        store.close()


@pytest.fixture
def store(again: Open) -> SqlStore:
    return again()
