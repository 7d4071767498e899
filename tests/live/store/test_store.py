"""What every store does, in SQLite and in PostgreSQL."""

import sqlite3
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.live.store.conftest import Open
from tests.live.store.things import SECOND, WINDOW, alarm, block, blocks, level, result, status
from windsysid.errors import ConfigurationError, StoreError
from windsysid.live.store import Keep, encoding, open_store, schema, sql_store
from windsysid.live.store.contents import Commit, Event, SensorHealth
from windsysid.live.store.keep import DAY
from windsysid.live.store.sql_store import SqlStore
from windsysid.live.store.store import ContentError


def submit(store: SqlStore, *commits: Commit) -> None:
    for future in [store.submit(commit) for commit in commits]:
        future.result(timeout=60)


def sequences(store: SqlStore, turbine: str = "T01") -> list[int]:
    return [waiting.sequence for _, waiting in store.waiting(turbine)]


@pytest.mark.parametrize("dtype", ["float32", "float64", ">f4"])
def test_a_block_comes_back_bit_for_bit_after_a_restart(again: Open, dtype: str):
    sent = block(7, dtype=dtype, stream="blades")
    submit(again(), blocks(7, dtype=dtype, stream="blades"))
    [(window, got)] = again().waiting("T01")
    assert window == 0
    for name in ("turbine", "sequence", "start", "rate", "channels", "units", "stream"):
        assert getattr(got, name) == getattr(sent, name)
    assert got.values.dtype == sent.values.dtype.newbyteorder("=")
    assert got.values.tobytes() == sent.values.astype(got.values.dtype).tobytes()


def test_blocks_wait_by_window_stream_and_sequence_until_their_window_has_its_result(store: SqlStore):
    submit(store, blocks(12, 11, window=WINDOW), blocks(2, 1, 10), blocks(1, stream="b"), blocks(5, turbine="T02"))
    waiting = [(window, got.stream, got.sequence) for window, got in store.waiting("T01")]
    assert waiting == [(0, "", 1), (0, "", 2), (0, "", 10), (0, "b", 1), (WINDOW, "", 11), (WINDOW, "", 12)]
    assert [got.sequence for _, got in store.waiting("T01", WINDOW)] == [11, 12]
    submit(store, Commit(results=[result(0)]))
    assert sequences(store) == [11, 12]
    assert sequences(store, "T02") == [5]


def test_a_block_over_a_boundary_waits_for_both_windows(store: SqlStore):
    submit(store, blocks(3), blocks(3, window=WINDOW), Commit(results=[result(0)]))
    assert [(window, got.sequence) for window, got in store.waiting("T01")] == [(WINDOW, 3)]


def test_a_commit_that_comes_again_changes_nothing(store: SqlStore):
    health = SensorHealth("T01", "tower", "stuck", 5, "look at its cable")
    whole = Commit(blocks(1, 2).blocks, [status()], [health], [result(0)], [alarm()])
    submit(store, blocks(1), whole)
    store.acknowledge("T01/k_x/0", by="ada", remark="seen", at=9)
    submit(store, Commit(alarms=[alarm(ended=11)], results=[result(1)]))
    before = everything(store)
    submit(store, whole, blocks(1, 2), whole, Commit(results=[result(0, text="other")]))
    assert everything(store) == before
    assert before["results"][0].row == result(0).row
    assert not before["waiting"]


def everything(store: SqlStore) -> dict[str, Any]:
    return {
        "waiting": [(window, got.sequence, got.values.tobytes()) for window, got in store.waiting("T01")],
        "checkpoint": store.checkpoint("T01"), "statuses": store.statuses(), "healths": store.healths(),
        "results": store.results("T01"), "levels": store.levels("T01"), "alarms": store.alarms(),
    }  # fmt: skip


def test_levels_of_a_version_without_grades_are_read(store: SqlStore, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(encoding, "TEXTS", ("name", "unit", "kind"))
    submit(store, Commit(results=[result(0)]))
    monkeypatch.undo()
    submit(store, Commit(results=[result(1)]))
    found = dict(store.levels("T01")[::2])
    assert found == {0: level()._replace(grade=""), WINDOW: level()}


def test_a_commit_that_comes_twice_at_once_is_written_once(store: SqlStore):
    first, ended = Commit(results=[result(0)], alarms=[alarm()]), Commit(results=[result(1)], alarms=[alarm(ended=9)])
    submit(store, first, ended, first)
    assert [a.ended for a in store.alarms()] == [9]
    assert store.size()["results"] == 2


def test_results_levels_and_checkpoint_come_back_as_they_were(again: Open):
    submit(again(), Commit(results=[result(1), result(0)]))
    store = again()
    assert store.results("T01") == [result(number)._replace(checkpoint=b"") for number in (0, 1)]
    assert store.levels("T01") == [(n * WINDOW, lv) for n in (0, 1) for lv in (level(), level("c_x", None))]
    assert store.checkpoint("T01") == (2 * WINDOW, b"\0after 1")
    assert store.checkpoint("T02") is None
    submit(store, Commit(results=[result(5)._replace(levels=[], row={"a": float("nan"), "b": np.float64(2.5)})]))
    [last] = store.results("T01", newest=1)
    assert (last.levels, str(last.row)) == ([], "{'a': nan, 'b': 2.5}")


def test_of_many_windows_every_so_manieth_is_given_and_the_newest(store: SqlStore):
    submit(store, Commit(results=[result(number) for number in range(20)]))
    windows = [window // WINDOW for window, found in store.levels("T01", most=6) if found.name == "k_x"]
    assert windows == [3, 7, 11, 15, 19]
    assert [found.window // WINDOW for found in store.results("T01", most=6)] == windows
    assert len(store.levels("T01", most=20)) == 40
    between = store.results("T01", since=3 * WINDOW, until=6 * WINDOW)
    assert [found.window // WINDOW for found in between] == [3, 4, 5]
    assert [found.window // WINDOW for found in store.results("T01", newest=2)] == [18, 19]
    assert store.results("nobody") == []


def test_an_alarm_is_replaced_but_never_unacknowledged(store: SqlStore):
    submit(store, Commit(alarms=[alarm(), alarm("other", "T02", opened=6)]))
    assert [found.key for found in store.alarms()] == ["other", "T01/k_x/0"]
    assert store.acknowledge("T01/k_x/0", by="ada", remark="seen", at=8) == alarm(
        acknowledged=8, by="ada", remark="seen"
    )
    assert store.acknowledge("T01/k_x/0", by="bob", at=9).by == "ada"
    submit(store, Commit(alarms=[alarm(ended=10, text="over", kind="sensor")]))
    [found] = store.alarms(turbine="T01")
    assert (found.ended, found.text, found.kind, found.acknowledged, found.by) == (10, "over", "sensor", 8, "ada")
    assert [found.key for found in store.alarms(open_only=True)] == ["other"]
    assert len(store.alarms(most=1)) == 1
    with pytest.raises(KeyError):
        store.acknowledge("none", by="ada", at=1)


def test_events_tell_once_what_changed_since(again: Open):
    store = again()
    assert (store.last_event(), store.events(0)) == (0, [])
    good = SensorHealth("T01", "tower", "good", 5, "")
    submit(store, Commit(statuses=[status(), status("T02")], healths=[good]), Commit(results=[result(0)]))
    told = store.events(0)
    assert [(event.kind, event.turbine, event.key) for event in told] == [
        ("status", "T01", ""), ("status", "T02", ""), ("health", "T01", "tower"), ("result", "T01", "0")
    ]  # fmt: skip
    assert told == sorted(told)
    submit(store, Commit(statuses=[status(received=8)], healths=[good], alarms=[alarm()]))
    last = told[-1].id
    assert [(event.kind, event.at) for event in store.events(last)] == [("status", 8), ("alarm", 5)]
    assert len(store.events(last, most=1)) == 1
    store.acknowledge(alarm().key, by="ada", at=12)
    store = again()
    newest = store.events(last)[-1]
    assert newest == Event(newest.id, 12, "T01", "alarm", alarm().key)
    assert store.last_event() >= newest.id
    submit(store, Commit(statuses=[status()]))
    assert store.events(newest.id)[0].kind == "status"


def test_a_configuration_is_written_down_where_it_changed(store: SqlStore):
    for settings in ("a", "a", "b", "a"):
        store.configure("T01", settings, {"window": 600.0, "name": "Ø"})
    found = store.configurations("T01")
    assert [entry["settings"] for entry in found] == ["a", "b", "a"]
    assert found[0]["tables"] == {"window": 600.0, "name": "Ø"}
    assert found[0]["at"] > found[1]["at"] > found[2]["at"]
    submit(store, Commit(statuses=[status("T03")]))
    assert store.turbines() == ["T01", "T03"]


def test_statuses_and_healths_are_the_newest(store: SqlStore):
    submit(store, Commit(statuses=[status(), status("T00")]), Commit(statuses=[status(received=99)]))
    assert store.statuses() == [status("T00"), status(received=99)]
    for state in ("stuck", "good"):
        submit(store, Commit(healths=[SensorHealth("T01", "x", state, 1, ""), SensorHealth("T02", "x", state, 1, "")]))
    assert store.healths("T01") == [SensorHealth("T01", "x", "good", 1, "")]
    assert len(store.healths()) == 2


def test_one_wrong_commit_among_many_fails_alone(store: SqlStore):
    wrong = blocks(2**70)  # no database holds such a number
    futures = [store.submit(commit) for commit in (blocks(1), wrong, blocks(2))]
    with pytest.raises(StoreError, match="cannot be written") as told:
        futures[1].result(timeout=60)
    assert "\n" not in str(told.value)
    for future in (futures[0], futures[2]):
        future.result(timeout=60)
    assert sequences(store) == [1, 2]


def test_many_threads_may_write_and_read_at_once(store: SqlStore):
    def work(turbine: str) -> None:
        for number in range(20):
            submit(store, blocks(number, turbine=turbine))
            assert sequences(store, turbine)[-1] == number

    threads = [threading.Thread(target=work, args=(f"T{i}",)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.size()["blocks"] == 80


def test_closing_writes_what_is_queued(again: Open):
    store = again()
    futures = [store.submit(blocks(number)) for number in range(50)]
    store.close()
    assert all(future.done() for future in futures)
    with pytest.raises(StoreError, match="closed"):
        store.submit(blocks(99))
    assert sequences(again()) == list(range(50))


def test_a_second_service_is_refused_in_one_line(store: SqlStore, url: str):
    with pytest.raises(StoreError, match="another service writes to it"):
        open_store(url)
    store.close()
    open_store(url).close()


def test_a_store_is_read_while_a_service_writes_to_it(store: SqlStore, url: str):
    submit(store, Commit(results=[result(0)]))
    reader = open_store(url, read_only=True)
    assert len(reader.results("T01")) == 1
    with pytest.raises(StoreError, match="reading only"):
        reader.submit(blocks(1))
    reader.close()
    submit(store, blocks(1))


def test_a_store_of_an_older_form_is_brought_up_to_date(again: Open, monkeypatch: pytest.MonkeyPatch):
    submit(again(), blocks(1), Commit(results=[result(3)], alarms=[alarm()]))
    step = ("ALTER TABLE alarms ADD COLUMN origin TEXT NOT NULL DEFAULT ''", "CREATE TABLE notes (note TEXT)")
    monkeypatch.setattr("windsysid.live.store.database.STEPS", (*schema.STEPS, step))
    with pytest.raises(StoreError, match="older form"):
        again(read_only=True)
    store = again()
    assert (sequences(store), store.alarms(), len(store.results("T01"))) == ([1], [alarm()], 1)
    assert store._read("SELECT origin FROM alarms") == [("",)]
    again()  # once only: the same step again would fail
    monkeypatch.undo()
    with pytest.raises(StoreError, match="newer windsysid"):
        again()


def test_a_migration_that_fails_leaves_the_store_as_it_was(again: Open, monkeypatch: pytest.MonkeyPatch):
    submit(again(), blocks(1))
    monkeypatch.setattr(
        "windsysid.live.store.database.STEPS", (*schema.STEPS, ("CREATE TABLE notes (note TEXT)", "nonsense"))
    )
    with pytest.raises(StoreError, match="cannot be opened"):
        again()
    monkeypatch.undo()
    assert sequences(again()) == [1]


def test_what_is_too_old_goes_and_of_old_levels_one_a_day_stays(again: Open, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sql_store, "ROWS_PER_DELETION", 7)
    store = again(Keep(results="2 days", levels="1 day", alarms="1 week"))
    now = 10 * DAY
    windows = range(0, now, DAY // 6)
    results = [result(0)._replace(window=at, until=at + DAY // 6) for at in windows]
    submit(
        store,
        Commit(results=results, alarms=[alarm("open"), alarm("old", ended=DAY), alarm("new", ended=9 * DAY)]),
    )
    store.thin(now=now)
    assert [found.window for found in store.results("T01")] == [at for at in windows if at >= 8 * DAY]
    kept = sorted({window for window, _ in store.levels("T01")})
    assert kept == [at for at in windows if at >= 9 * DAY or at % DAY == 5 * (DAY // 6)]
    assert {found.key for found in store.alarms()} == {"open", "new"}
    assert store.checkpoint("T01") == (now, b"\0after 0")
    before = store.size()
    store.thin(now=now)
    assert store.size() | {"bytes": 0} == before | {"bytes": 0}
    forever = again(Keep("forever", "forever", "forever"))
    forever.thin(now=10**19 // 2)
    assert forever.size() | {"bytes": 0} == before | {"bytes": 0}


def test_size_counts_rows_and_bytes(store: SqlStore):
    submit(store, blocks(1, 2), Commit(results=[result(3)], alarms=[alarm()]))
    size = store.size()
    assert (size["blocks"], size["results"], size["levels"], size["checkpoints"], size["alarms"]) == (2, 1, 1, 1, 1)
    assert size["bytes"] > 4096


@pytest.mark.parametrize("text", ["", "ten years", "0 days", "3 fortnights", "-1 day", "1.5 days"])
def test_a_span_that_is_none_is_refused(text: str):
    with pytest.raises(ConfigurationError, match="keep levels: expected a span such as 30 days"):
        Keep(levels=text)


def test_text_of_clients_is_text(store: SqlStore):
    name = "'; DROP TABLE blocks; --%s ? \\ \n 風"
    submit(store, blocks(1, turbine=name), Commit(statuses=[status(name)], alarms=[alarm(name, name, text=name)]))
    assert sequences(store, name) == [1]
    assert store.turbines() == [name]
    assert store.acknowledge(name, by=name, remark=name, at=SECOND).remark == name


def test_what_a_database_cannot_hold_fails_by_itself_and_the_store_goes_on(store: SqlStore):
    first, bad, last = blocks(1, 2, 3).blocks
    bad = bad._replace(block=replace(bad.block, channels=("\ud800", "b")))
    errors = [future.exception(30.0) for future in [store.submit(Commit([one])) for one in (first, bad, last)]]
    assert errors[0] is errors[2] is None
    assert isinstance(errors[1], ContentError)
    assert sequences(store) == [1, 3]
    assert store.trouble == ""


class Broken(sqlite3.DatabaseError):
    """An error that does not pass and that lies in no content."""


def test_a_store_that_takes_nothing_says_so_until_it_takes_a_commit_again(tmp_path: Path):
    store = open_store(str(tmp_path / "store.sqlite"))
    submit(store, blocks(1))
    assert store.trouble == ""
    transact = store._transact

    def broken(works: Any) -> Any:
        raise Broken("database disk image is malformed")

    store._transact = broken  # type: ignore[method-assign]
    with pytest.raises(StoreError, match="malformed"):
        submit(store, blocks(2))
    assert store.trouble.endswith("store.sqlite cannot be written: database disk image is malformed")
    store._transact = transact  # type: ignore[method-assign]
    submit(store, blocks(3))
    assert store.trouble == ""
    store.close()


def test_a_commit_that_takes_long_is_one_that_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sql_store, "MAX_COMMIT_SECONDS", 0.02)
    store = open_store(str(tmp_path / "store.sqlite"))
    free, transact = threading.Event(), store._transact

    def slow(works: Any) -> Any:
        assert free.wait(30.0)
        return transact(works)

    store._transact = slow  # type: ignore[method-assign]
    future = store.submit(blocks(1))
    time.sleep(0.05)
    assert "cannot be written: a commit has waited for 0 s" in store.trouble
    free.set()
    future.result(30.0)
    store.close()
    assert store.trouble == ""
