import asyncio
import json
import math
import re
import sqlite3
from contextlib import closing

import pytest
from fastapi.testclient import TestClient

from tests.live.sources.servers import wait_for
from windsysid.errors import StoreError, WindsysidError
from windsysid.live.page.app import STATIC, app, streams_of
from windsysid.live.page.streams import Streams, TooManyStreams
from windsysid.live.sources.folder import FolderSource
from windsysid.live.sources.source import SourceState
from windsysid.live.store import open_store, sqlite
from windsysid.live.store.contents import Commit, Result, SeriesLevel

from . import sample

OWN = "http://localhost"

ENGINE_METRICS = {"behind_seconds", "windows_waiting", "blocks_per_second", "cost_per_sample_seconds"}


@pytest.fixture
def client(page):
    return TestClient(page, base_url=OWN)


def test_the_overview_has_the_worst_first(client):
    turbines = client.get("/api/overview").json()["turbines"]
    assert [(one["name"], one["verdict"]) for one in turbines] == [
        ("T02", "moved"),
        ("T03", "sensor"),
        ("T01", "steady"),
    ]
    assert "stiffness of the tower, fore-aft (k_fore_aft) fell" in turbines[0]["answer"]
    assert turbines[1]["faults"][0]["state"] == "stuck"


def test_a_turbine_says_what_is_known_of_it(client):
    found = client.get("/api/turbines/T02").json()
    assert found["newest"]["trusted"]
    mode = found["newest"]["modes"][0]
    assert mode["nearest"] == "1P"
    one = next(one for one in found["newest"]["excitations"] if one["name"] == "1P")
    assert one["frequency"] == pytest.approx(found["newest"]["rotor_speed"] / (2.0 * math.pi))
    assert mode["distance"] == pytest.approx(1.0 - one["frequency"] / mode["frequency"])


def test_the_grade_behind_each_number_is_told(client):
    found = client.get("/api/turbines/T01").json()
    grades = found["summary"]["grades"]
    assert (found["summary"]["trusted"], found["summary"]["verdict"]) == (False, "steady")
    assert found["summary"]["answer"].endswith("Grade C in the newest estimate, not used for the level: c_fore_aft.")
    assert [name for name in grades if grades[name] == "C"] == ["c_fore_aft", "tower fore-aft damping ratio"]
    assert grades["k_side_side"] == grades["tower side-side frequency"] == "A"
    mode = next(one for one in found["newest"]["modes"] if one["name"] == "tower fore-aft")
    assert (mode["frequency_grade"], mode["damping_ratio_grade"]) == ("B", "C")
    assert [one["grade"] for one in found["newest"]["budget"]] == ["A", "A", "B", "C"]
    series = client.get("/api/turbines/T01/levels").json()["series"]
    assert {one["name"]: one["grade"][-1] for one in series} == {
        "k_side_side": "A", "c_side_side": "A", "k_fore_aft": "B", "c_fore_aft": "C",
    }  # fmt: skip
    track = client.get("/api/turbines/T01/results").json()["modes"][1]
    assert {"A", "C"} <= set(track["damping_ratio_grade"])
    assert client.get("/api/turbines/T03").json()["summary"]["trusted"] is False
    assert 'windsysid_turbine_unusable{turbine="T01"} 2' in client.get("/metrics").text


@pytest.mark.parametrize(("trusted", "grade"), [(True, "A"), (False, "C")])
def test_results_of_a_version_without_grades_are_shown(trusted, grade):
    store = open_store(":memory:")
    row = {
        "status": "ok", "trusted": trusted, "reasons": ["a burst"], "parameters": [{"name": "k_x"}],
        "modes": [{"name": "m", "frequency": 1.0}],
    }  # fmt: skip
    store.submit(Commit(results=[Result("T", 0, 1, 1, row, [], b"")])).result(60)
    summary = TestClient(app(store), base_url=OWN).get("/api/turbines/T").json()["summary"]
    assert summary["grades"] == dict.fromkeys(("k_x", "m frequency", "m damping ratio"), grade)
    assert summary["verdict"] == ("learning" if trusted else "unsure")
    store.close()


def test_the_budget_splits_variances_as_the_row_has_them(client):
    for share in client.get("/api/turbines/T02").json()["newest"]["budget"]:
        assert share["loads"] > 0.0
        for cause in ("loads", "instruments"):  # who knows everything else knows no less than who knows one thing
            assert 0.0 <= share["rest"] <= 1.0 - share[cause] + 1e-9


def test_levels_and_results_are_columns_over_the_same_windows(client):
    levels = client.get("/api/turbines/T01/levels").json()
    results = client.get("/api/turbines/T01/results").json()
    assert len(levels["windows"]) < len(results["windows"]) == 72  # refused windows have no levels
    for series in levels["series"]:
        assert all(len(series[name]) == len(levels["windows"]) for name in ("estimate", "level", "limit"))
    assert {mode["name"] for mode in results["modes"]} == {"tower side-side", "tower fore-aft"}
    assert "refused" in results["status"]


def test_a_range_is_answered_alone_and_thinned(client):
    windows = client.get("/api/turbines/T02/results").json()["windows"]
    query = {"since": windows[10], "until": windows[20]}
    assert client.get("/api/turbines/T02/results", params=query).json()["windows"] == windows[10:20]
    assert len(client.get("/api/turbines/T02/levels", params={"most": 10}).json()["windows"]) <= 10


def test_one_window_is_found_by_its_begin(client):
    window = client.get("/api/turbines/T02/results").json()["windows"][7]
    assert client.get(f"/api/turbines/T02/results/{window}").json()["window"] == window
    assert client.get(f"/api/turbines/T02/results/{window + 5}").status_code == 404


@pytest.mark.parametrize("name", ["T09", "..%2f..%2fetc%2fpasswd", "T01'--", "%00", "x" * 300])
def test_what_there_is_not_is_not_found_and_not_repeated(client, name):
    for path in ("", "/levels", "/results"):
        answer = client.get(f"/api/turbines/{name}{path}")
        assert answer.status_code in (404, 422)
        assert "passwd" not in answer.text
        assert "--" not in answer.text


def test_nothing_that_is_not_a_number_reaches_the_answer():
    store = open_store(":memory:")
    level = SeriesLevel("k_x", "N/m", "k", math.nan, -math.inf, math.inf, None, None, None, math.nan, math.inf)
    row = {"status": "ok", "trusted": True, "rotor_speed": math.nan, "modes": [{"name": "m", "frequency": math.nan}]}
    store.submit(Commit(results=[Result("T", 0, 1, 1, row, [level], b"")])).result(60)
    client = TestClient(app(store), base_url=OWN)
    for path in ("/api/overview", "/api/turbines/T", "/api/turbines/T/levels", "/api/turbines/T/results"):
        text = client.get(path).text
        assert not any(word in text for word in ("NaN", "Infinity"))
        json.loads(text)
    assert client.get("/api/overview").json()["turbines"][0]["verdict"] == "learning"
    store.close()


def test_an_empty_store_has_a_page():
    store = open_store(":memory:")
    client = TestClient(app(store), base_url=OWN)
    assert client.get("/api/overview").json()["turbines"] == []
    assert client.get("/metrics").status_code == 200
    store.close()


def test_an_acknowledgement_is_kept_and_the_first_one_counts(client):
    path = f"/api/alarms/{sample.KEY}/acknowledge"
    for bad in (
        {},
        {"by": ""},
        {"by": " x"},
        {"by": "a\nb"},
        {"by": "x" * 81},
        {"by": "x", "more": 1},
        {"by": "\ud800"},
    ):
        assert (
            client.post(path, content=json.dumps(bad), headers={"content-type": "application/json"}).status_code == 422
        )
    assert client.post("/api/alarms/nothing/acknowledge", json={"by": "me"}).status_code == 404
    first = client.post(path, json={"by": "A. Nord", "remark": "<b>bolts</b>"}).json()
    again = client.post(path, json={"by": "B. Süd"}).json()
    assert first["by"] == again["by"] == "A. Nord"
    found = client.get("/api/alarms", params={"turbine": "T02"}).json()
    assert [one["remark"] for one in found] == ["<b>bolts</b>"]


def test_metrics_escape_names_and_count_verdicts(client):
    text = client.get("/metrics").text
    assert 'windsysid_turbines{verdict="moved"} 1' in text
    assert 'windsysid_turbine_trusted{turbine="T02"} 1' in text
    assert 'windsysid_level{turbine="T02",series="k_fore_aft",unit="N/m"} 18' in text
    assert 'windsysid_mode_frequency_hertz_high{turbine="T02",mode="tower fore-aft"} 0.3' in text
    assert 'windsysid_mode_damping_ratio{turbine="T01",mode="tower fore-aft"}' not in text  # grade C
    assert text.endswith("\n")


def test_a_source_that_failed_is_on_the_overview_in_health_and_in_metrics(store):
    bad = FolderSource("/nowhere", "T01")
    bad.state = SourceState("failed", "the disk is broken", 7, 1)
    good = FolderSource("/here", "T02")
    good.state = SourceState("running", "", 9)
    client = TestClient(app(store, sources=[bad, good]), base_url=OWN)
    overview = client.get("/api/overview").json()
    assert overview["sources"][0] == {
        "name": "folder /nowhere of T01", "state": "failed", "text": "the disk is broken", "blocks": 7, "refused": 1,
        "refusal": "",
    }  # fmt: skip
    health = client.get("/health").json()
    assert (health["status"], health["sources"]) == ("degraded", {"failed": 1, "running": 1})
    metrics = client.get("/metrics").text
    assert 'windsysid_source_state{source="folder /nowhere of T01",state="failed"} 1' in metrics
    assert 'windsysid_source_blocks_total{source="folder /here of T02"} 9' in metrics
    bad.state = SourceState("running")
    assert client.get("/health").json()["status"] == "ok"


def test_a_store_that_is_away_is_said_in_one_line(store):
    class Away:
        def __getattr__(self, name):
            def refuse(*_, **__):
                raise WindsysidError("postgres://user:secret@host is away")

            return refuse

    client = TestClient(app(Away()), base_url=OWN)
    answer = client.get("/api/overview")
    assert answer.status_code == 503
    assert "secret" not in answer.text


def test_openapi_lists_every_path_with_a_model(client):
    schema = client.get("/api/openapi.json").json()
    assert "/api/alarms/{key}/acknowledge" in schema["paths"]
    overview = schema["paths"]["/api/overview"]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
    assert overview["$ref"].endswith("/PageOverview")


async def _told(streams, after, count):
    told = []
    async for last, changes in streams.follow(after):
        told.append((last, changes))
        if len(told) == count:
            return told
    return told


def test_a_stream_tells_what_changes_and_where_it_stands():
    store = open_store(":memory:")
    sample.fill(store, days=0.02)

    async def follow():
        streams = Streams(store, 4)
        streams.enter()
        task = asyncio.create_task(_told(streams, None, 1))
        while streams._watcher is None:
            await asyncio.sleep(0.01)
        last = store.last_event()
        store.submit(Commit(alarms=sample.alarms(0, 100)[:1]))
        [(told, changes)] = await asyncio.wait_for(task, 30.0)
        streams.leave()
        return last, told, changes

    last, told, changes = asyncio.run(follow())
    assert told > last
    assert changes.alarms == [sample.KEY]
    assert changes.turbines == ["T02"]
    assert not changes.all
    store.close()


def test_a_page_that_was_away_for_long_reads_everything_again():
    store = open_store(":memory:")
    sample.fill(store, days=0.02)

    async def follow():
        streams = Streams(store, 4)
        streams.enter()
        [(told, changes)] = await asyncio.wait_for(_told(streams, 0, 1), 30.0)
        streams.leave()
        return told, changes

    told, changes = asyncio.run(follow())
    assert told == store.last_event()
    assert changes.all
    store.close()


def test_streams_end_when_they_are_closed_and_are_bounded():
    store = open_store(":memory:")

    async def follow():
        streams = Streams(store, 1)
        streams.enter()
        with pytest.raises(TooManyStreams):
            streams.enter()
        task = asyncio.create_task(_told(streams, None, 1))
        while streams._watcher is None:
            await asyncio.sleep(0.01)
        streams.close()
        assert await asyncio.wait_for(task, 30.0) == []
        streams.leave()
        with pytest.raises(TooManyStreams):
            streams.enter()

    asyncio.run(follow())
    store.close()


def test_the_event_stream_is_sent_as_events(store, monkeypatch):
    page = app(store)
    client = TestClient(page, base_url=OWN)
    ended = []

    async def follow(after):
        ended.append(after)
        yield 7, {"turbines": [], "results": [], "alarms": [], "all": True}

    monkeypatch.setattr(streams_of(page), "follow", follow)
    with client.stream("GET", "/api/events?after=3", headers={"last-event-id": "5"}) as answer:
        lines = list(answer.iter_lines())
    assert ended == [5]
    assert "id: 7" in lines
    assert "event: changes" in lines
    assert streams_of(page).count == 0


def test_grafanas_dashboard_asks_for_metrics_that_there_are(store):
    client = TestClient(app(store, sources=[FolderSource("/here", "T01")]), base_url=OWN)
    told = client.get("/metrics").text
    dashboard = json.loads((STATIC / "grafana.json").read_text(encoding="utf-8"))
    asked = {
        name
        for panel in dashboard["panels"]
        for target in panel["targets"]
        for name in re.findall(r"windsysid_\w+", target["expr"])
    }
    of_an_engine = {f"windsysid_{name}" for name in ENGINE_METRICS}
    assert asked - of_an_engine <= set(re.findall(r"^# TYPE (\w+)", told, re.MULTILINE))


def test_what_an_engine_says_is_shown_and_measured(store):
    class OfTurbine:
        windows, behind = 3, 40.0

    class State:
        samples, rate, compiling, seconds, turbines = (
            4_000_000,
            2.5,
            True,
            {"blocks": 4.0, "estimates": 20.0},
            {name: OfTurbine() for name in ("T01", "T09")},
        )

    class Engine:
        def state(self):
            return State()

        def acknowledge(self, key, by, remark):
            return store.acknowledge(key, by=by, remark=remark, at=1)

    client = TestClient(app(store, Engine()), base_url=OWN)
    found = client.get("/api/overview").json()
    assert found["service"] == {"blocks_per_second": 2.5, "cost_per_sample": 6.0, "compiling": True}
    first = next(one for one in found["turbines"] if one["name"] == "T01")
    assert (first["windows_waiting"], first["behind"]) == (3, 40.0)
    for path in ("", "/levels", "/results"):  # of one that has sent nothing yet
        assert client.get(f"/api/turbines/T09{path}").status_code == 200
    told = client.get("/metrics").text
    assert 'windsysid_behind_seconds{turbine="T01"} 40' in told
    assert {
        name.removeprefix("windsysid_") for name in re.findall(r"^# TYPE (\w+)", told, re.MULTILINE)
    } >= ENGINE_METRICS


def test_a_store_that_another_process_holds_is_told_everywhere_until_it_takes_blocks_again(tmp_path, monkeypatch):
    monkeypatch.setattr(sqlite, "BUSY", 0.05)
    path = tmp_path / "store.sqlite"
    store = open_store(str(path))
    sample.fill(store, days=0.02)
    client = TestClient(app(store), base_url=OWN)
    assert client.get("/health").json()["status"] == "ok"
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        waiting = store.submit(Commit())
        wait_for(lambda: store.trouble)
        health = client.get("/health")
        assert (health.status_code, health.json()["status"]) == (503, "failed")
        assert "path" not in health.text
        assert client.get("/api/overview").json()["store"].endswith("cannot be written: database is locked")
        assert "windsysid_store_takes_blocks 0" in client.get("/metrics").text
    waiting.result(30.0)
    assert (client.get("/health").status_code, client.get("/health").json()["status"]) == (200, "ok")
    assert client.get("/api/overview").json()["store"] == ""
    assert "windsysid_store_takes_blocks 1" in client.get("/metrics").text
    store.close()


def test_a_store_that_cannot_be_read_is_a_failed_service(store, monkeypatch):
    def gone() -> int:
        raise StoreError("the file has gone")

    monkeypatch.setattr(store, "last_event", gone)
    answer = TestClient(app(store), base_url=OWN).get("/health")
    assert (answer.status_code, answer.json()["status"]) == (503, "failed")


def test_what_a_source_refused_is_told_with_its_reason(store):
    source = FolderSource("folder", "T01")
    source.state = source.state.with_refusal("a.csv: no\nmoment")
    (shown,) = TestClient(app(store, sources=[source]), base_url=OWN).get("/api/overview").json()["sources"]
    assert (shown["refused"], shown["refusal"]) == (1, "a.csv: no moment")
