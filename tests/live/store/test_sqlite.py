"""What only a store in a file can suffer."""

import os
import sqlite3
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tests.live.store.test_store import sequences, submit
from tests.live.store.things import blocks
from windsysid.errors import StoreError
from windsysid.live.store import open_store
from windsysid.live.store.sqlite import Sqlite


@pytest.mark.parametrize("content", [b"a diary", b"SQLite format 3\0" + bytes(2000)], ids=["text", "damaged"])
def test_a_file_that_is_no_store_is_refused_and_left_as_it_is(tmp_path: Path, content: bytes):
    path = tmp_path / "diary"
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"no store of windsysid|cannot be opened") as told:
        open_store(str(path))
    assert "\n" not in str(told.value)
    assert len(str(told.value)) <= 160 + len(str(path))
    assert path.read_bytes() == content
    assert os.listdir(tmp_path) == ["diary"]


def test_another_programs_database_is_refused_and_left_as_it_is(tmp_path: Path):
    path = tmp_path / "other.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE blocks (mine TEXT)")
    before = path.read_bytes()
    with pytest.raises(StoreError, match="another program"):
        open_store(str(path))
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("url", "read_only", "told"),
    [
        ("mysql://somewhere/x", False, "store of kind 'mysql': expected a path"),
        ("sqlite://x.sqlite", False, "store of kind 'sqlite'"),
        ("{0}/missing/store.sqlite", False, "its folder does not exist"),
        ("{0}", False, "is a folder"),
        ("{0}/none.sqlite", True, "no such file, expected a store"),
    ],
)
def test_what_cannot_be_opened_is_told_in_one_line(tmp_path: Path, url: str, read_only: bool, told: str):
    with pytest.raises(StoreError, match=told):
        open_store(url.format(tmp_path), read_only=read_only)
    assert not os.listdir(tmp_path)


def test_a_store_that_was_never_finished_is_made_anew(tmp_path: Path):
    path = tmp_path / "store.sqlite"
    path.touch()  # killed between making the file and its tables
    store = open_store(str(path))
    submit(store, blocks(1))
    store.close()
    assert [name for name in os.listdir(tmp_path) if not name.startswith("store.sqlite")] == []


def test_paths_and_urls_name_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    for number, url in enumerate(["a b?.sqlite", "sqlite:///a b?.sqlite", f"sqlite:///{tmp_path}/a b?.sqlite"]):
        store = open_store(url)
        submit(store, blocks(number))
        assert sequences(store) == list(range(number + 1))
        store.close()


def test_a_store_in_memory_is_gone_when_it_is_closed():
    store = open_store(":memory:")
    submit(store, blocks(1))
    assert sequences(store) == [1]
    store.close()
    again = open_store(":memory:")
    assert sequences(again) == []
    again.close()


def test_a_full_disk_makes_commits_wait_and_loses_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    full = True
    connect = Sqlite.connect

    def limited(database: Sqlite) -> sqlite3.Connection:
        connection = connect(database)
        if full:
            connection.execute("PRAGMA max_page_count = 40")
        return connection

    monkeypatch.setattr(Sqlite, "connect", limited)
    store = open_store(str(tmp_path / "store.sqlite"))
    futures = [store.submit(blocks(*range(number, number + 100))) for number in range(0, 1000, 100)]
    deadline = time.monotonic() + 60
    while not store.trouble and time.monotonic() < deadline:
        time.sleep(0.02)
    assert "full" in store.trouble
    assert not futures[-1].done()
    full = False
    for future in futures:
        future.result(timeout=60)
    assert store.trouble == ""
    assert sequences(store) == list(range(1000))
    store.close()


def test_closing_gives_up_what_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    connect = Sqlite.connect

    def limited(database: Sqlite) -> sqlite3.Connection:
        connection = connect(database)
        connection.execute("PRAGMA max_page_count = 1")
        return connection

    monkeypatch.setattr(Sqlite, "connect", limited)
    store = open_store(str(tmp_path / "store.sqlite"))
    futures = [store.submit(blocks(*range(1000))), store.submit(blocks(1))]
    store.close()
    with pytest.raises(StoreError, match="full"):
        futures[0].result(timeout=60)
    assert futures[1].done()


def test_a_file_that_has_gone_is_not_made_anew(tmp_path: Path):
    path = tmp_path / "store.sqlite"
    store = open_store(str(path))
    path.unlink()
    with pytest.raises(StoreError, match="cannot be read"):
        store.turbines()
    assert not path.exists()
    store.close()


def test_many_commits_a_second_share_transactions_and_few_do_not_wait(tmp_path: Path):
    store = open_store(str(tmp_path / "store.sqlite"))
    sizes: list[int] = []
    write = store._write

    def counted(jobs: Sequence[Any]) -> None:
        sizes.append(len(jobs))
        write(jobs)

    store._write = counted  # type: ignore[method-assign]
    begun = time.monotonic()
    for number in range(20):
        submit(store, blocks(number))
    alone = len(sizes)
    while time.monotonic() < begun + 3.0:
        store.submit(blocks(len(sizes) + 100)).add_done_callback(lambda _: None)
        time.sleep(5e-4)
    store.close()
    assert alone == 20
    assert max(sizes) > 10
