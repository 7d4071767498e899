"""What only a store on a server can suffer."""

import sys
import threading
import time

import pytest
from validation.postgres_server import Server

from tests.live.store.test_store import sequences, submit
from tests.live.store.things import alarm, blocks, result
from windsysid.errors import StoreError
from windsysid.live.store import open_store
from windsysid.live.store.contents import Commit
from windsysid.live.store.postgres import LOCK


def test_commits_wait_for_a_server_that_was_killed_and_come_once(server: Server):
    store = open_store(server.emptied())
    submit(store, blocks(0))
    assert sequences(store) == [0]
    server.kill()
    futures = [store.submit(blocks(number)) for number in range(1, 30)]
    futures.append(store.submit(Commit(results=[result(1)], alarms=[alarm()])))
    deadline = time.monotonic() + 60
    while not store.trouble and time.monotonic() < deadline:
        time.sleep(0.02)
    assert "cannot be written" in store.trouble
    with pytest.raises(StoreError, match="cannot be read"):
        store.alarms()
    server.start()
    for future in futures:
        future.result(timeout=60)
    assert sequences(store) == list(range(30))
    assert (store.trouble, len(store.alarms()), store.last_event() > 0) == ("", 1, True)
    store.close()


def test_closing_while_the_server_is_away_ends(server: Server):
    store = open_store(server.emptied())
    submit(store, blocks(0))
    server.kill()
    future = store.submit(blocks(1))
    store.close()
    with pytest.raises(StoreError, match="cannot be written"):
        future.result(timeout=60)
    server.start()
    again = open_store(server.url)
    assert sequences(again) == [0]
    again.close()


def test_the_next_service_waits_for_a_lock_that_is_being_let_go(server: Server):
    import psycopg

    url = server.emptied()
    holder = psycopg.connect(url, autocommit=True)
    holder.execute(f"SELECT pg_advisory_lock({LOCK})")
    closing = threading.Timer(0.5, holder.close)
    closing.start()
    open_store(url).close()
    closing.join()


def test_no_message_has_the_password(server: Server):
    for url in (
        "postgresql://ada:s3cret@127.0.0.1:1/none",
        f"{server.url}&user=nobody&password=s3cret",
        "postgresql://ada:s3cret@[::1/x",
        "postgresql://ada:s3cret@host:port:1/x",
    ):
        with pytest.raises(StoreError) as told:
            open_store(url)
        assert "s3cret" not in str(told.value)
        assert "\n" not in str(told.value)
        assert told.value.__cause__ is None


def test_tables_of_somebody_else_are_left_alone(server: Server):
    import psycopg

    with psycopg.connect(server.emptied(), autocommit=True) as connection:
        connection.execute("CREATE SCHEMA windsysid")
        connection.execute("CREATE TABLE windsysid.notes (note TEXT)")
    with pytest.raises(StoreError, match="tables of another program"):
        open_store(server.url)


def test_a_database_without_a_store_is_not_changed_by_reading(server: Server):
    with pytest.raises(StoreError, match="start windsysid live on it once"):
        open_store(server.emptied(), read_only=True)


def test_without_the_driver_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreError, match=r"pip install 'windsysid\[live\]'"):
        open_store("postgresql://localhost/x")
