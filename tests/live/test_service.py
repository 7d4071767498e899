"""The service as a process: it starts with one line or none, and a signal ends it in order."""

import asyncio
import json
import logging
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import httpx
import pytest

import windsysid as ws
from windsysid.errors import ConfigurationError, StoreError
from windsysid.fleet.members import Member
from windsysid.live.configuration.settings import LogSettings, PageSettings, Settings
from windsysid.live.logs import RepeatFilter, event, start_log
from windsysid.live.service import _supply, listen, serve, url_of
from windsysid.live.sources.folder import FolderSource
from windsysid.live.sources.source import SourceState
from windsysid.live.store import open_store

PATIENCE = 120.0
"""For a process to get somewhere on a busy machine [s]."""

BEGIN = "2026-01-05T12:00:00Z"


class Running:
    """A service and what it said."""

    def __init__(self, *options: str) -> None:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "windsysid", "live", *options],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment,
        )  # fmt: skip
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        self.lines.extend(line.rstrip() for line in iter(self.process.stdout.readline, ""))

    def _read_lines(self) -> str:
        return "\n".join(self.lines)

    def url(self) -> str:
        wait_for(lambda: "page: " in self._read_lines() or self.process.poll() is not None, self._read_lines)
        found = re.search(r"page: (\S+)", self._read_lines())
        assert found is not None, self._read_lines()
        return found[1]

    def end(self) -> tuple[int, str]:
        code = self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return code, self._read_lines()


def wait_for(holds: Callable[[], bool], told: Callable[[], str] = str) -> None:
    until = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < until, told()
        time.sleep(0.05)


@pytest.fixture
def started() -> Iterator[Callable[..., Running]]:
    running: list[Running] = []

    def start(*options: str) -> Running:
        running.append(Running(*options))
        return running[-1]

    yield start
    for one in running:
        if one.process.poll() is None:
            one.process.kill()
            one.process.wait()


def configured(folder: Path, more: str = "", *, speed: float = 60.0) -> Path:
    """A settings file with a record that is played for minutes."""
    record = replace(ws.simulate("tower", duration=3600.0, rate=5.0, seed=4), start=BEGIN)
    ws.write_record(record, folder / "record.nc")
    path = folder / "live.toml"
    path.write_text(
        f"""
store = "store.sqlite"
workers = 1
{more}
[page]
port = 0
[[turbine]]
name = "T01"
turbine = "tower"
[[source]]
kind = "replay"
turbine = "T01"
record = "record.nc"
speed = {speed}
""",
        encoding="utf-8",
    )
    return path


def blocks_in(store: Path) -> int:
    if not store.exists():
        return 0
    with sqlite3.connect(f"file:{store}?mode=ro", uri=True) as connection:
        try:
            return int(connection.execute("SELECT count(*) FROM blocks").fetchone()[0])
        except sqlite3.OperationalError:
            return 0


def test_a_signal_ends_it_in_order_though_pages_listen_and_it_goes_on_where_it_was(
    tmp_path: Path, started: Callable[..., Running]
):
    config = configured(tmp_path, '[log]\nformat = "json"')
    service = started(str(config))
    url = service.url()
    heard = threading.Event()
    ended: list[bool] = []

    def listen() -> None:
        with httpx.stream("GET", f"{url}api/events", timeout=PATIENCE) as stream:
            for _ in stream.iter_lines():
                heard.set()
        ended.append(True)

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    assert heard.wait(PATIENCE)
    wait_for(lambda: blocks_in(tmp_path / "store.sqlite") >= 20)
    service.process.send_signal(signal.SIGTERM)
    code, said = service.end()
    assert code == 0, said
    listener.join(PATIENCE)
    assert ended == [True]
    log = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
    assert [line["message"] for line in log if line["message"].startswith("end")] == [
        "ends", "ended: all accepted blocks are in the store",
    ], said  # fmt: skip
    assert not [line for line in log if line["level"] in ("warning", "error")], said
    store = open_store(str(tmp_path / "store.sqlite"))
    (status,) = store.statuses()
    waiting = [block for _, block in store.waiting("T01")]
    assert status.counts["blocks"] == len({block.sequence for block in waiting}) >= 20
    store.close()


@pytest.mark.slow
def test_it_goes_on_where_it_was_and_a_second_signal_ends_it_at_once(tmp_path: Path, started: Callable[..., Running]):
    config = configured(tmp_path)
    for code, signals in ((130, [signal.SIGINT]), (128 + signal.SIGTERM, [signal.SIGTERM] * 2)):
        service = started(str(config))
        assert httpx.get(f"{service.url()}api/overview").json()["turbines"][0]["name"] == "T01"
        for number in signals:
            service.process.send_signal(number)
            time.sleep(0.2)
        assert service.end()[0] in (code, 0)


def test_a_source_that_failed_says_so_and_is_started_again(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.live.service.RETRY_SECONDS", 0.01)

    class Broken(FolderSource):
        runs = 0

        async def run(self, push: object, stop: asyncio.Event) -> None:
            self.runs += 1
            seen.append(self.state)
            if self.runs == 2:
                stop.set()
            raise ValueError("not\nagain")

    async def run() -> None:
        await _supply(source, SimpleNamespace(push=None), asyncio.Event())  # type: ignore[arg-type]

    seen: list[SourceState] = []
    source = Broken("folder", "T01")
    asyncio.run(run())
    assert [(state.state, state.text) for state in seen] == [("waiting", ""), ("failed", "not again")]


def test_a_port_that_is_taken_is_one_line_or_the_next_one():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        page = PageSettings(port=taken.getsockname()[1])
        with pytest.raises(ConfigurationError, match=rf"page: 127\.0\.0\.1:{page.port} is not available \(.*\): "):
            listen(page)
        with listen(page, any_near=True) as near:
            assert page.port < near.getsockname()[1] <= page.port + 20
            assert url_of(page, near) == f"http://127.0.0.1:{near.getsockname()[1]}/"


def test_a_host_that_is_not_here_is_one_line():
    with pytest.raises(ConfigurationError, match="is not available"):
        listen(PageSettings(host="192.0.2.1"))


def test_a_file_that_is_no_store_keeps_it_from_starting_and_stays_as_it_is(tmp_path: Path):
    store = tmp_path / "store.sqlite"
    store.write_text("somebody's diary", encoding="utf-8")
    page = PageSettings(port=0)
    with pytest.raises(StoreError, match=r"^.*store\.sqlite.*$"):
        serve(Settings(store=str(store), turbines=(Member("T01", "tower"),), page=page), [], listen(page))
    assert store.read_text(encoding="utf-8") == "somebody's diary"


def test_a_page_for_others_without_a_token_keeps_it_from_starting(tmp_path: Path):
    page = PageSettings(host="0.0.0.0", port=0)
    settings = Settings(store=str(tmp_path / "store.sqlite"), turbines=(Member("T01", "tower"),), page=page)
    with pytest.raises(ConfigurationError, match="can be reached by others"):
        serve(settings, [], listen(page))
    assert not (tmp_path / "store.sqlite").exists()


@pytest.fixture
def other_logs() -> Iterator[None]:
    """Leave the loggers as they were."""
    names = ("windsysid", "uvicorn.error", "asyncio")
    before = [(logging.getLogger(name).handlers, logging.getLogger(name).propagate) for name in names]
    yield
    for name, (handlers, propagate) in zip(names, before, strict=True):
        logging.getLogger(name).handlers, logging.getLogger(name).propagate = handlers, propagate


@pytest.mark.usefixtures("other_logs")
def test_a_log_line_is_one_line_whatever_a_client_said(capfd: pytest.CaptureFixture[str]):
    for form in ("text", "json"):
        start_log(LogSettings(form))
        event(logging.WARNING, "said\x1b[2J\nforged line", turbine="T\n01", count=3, nothing=None)
    text, line = capfd.readouterr().err.splitlines()
    assert text.endswith("warning: said?[2J forged line turbine=T 01 count=3")
    assert json.loads(line) | {"at": ""} == {
        "at": "", "level": "warning", "message": "said?[2J forged line", "turbine": "T 01", "count": 3, "nothing": None,
    }  # fmt: skip


@pytest.mark.usefixtures("other_logs")
def test_lines_that_repeat_are_counted_and_not_written(capfd: pytest.CaptureFixture[str], monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("windsysid.live.logs.time.monotonic", lambda: clock[0])
    start_log(LogSettings("text"))
    for k in range(1000):
        logging.getLogger("asyncio").error(
            "socket.accept() out of system resource %d", k, exc_info=OSError(24, "files")
        )
    event(logging.ERROR, "another")
    clock[0] = 61.0
    logging.getLogger("asyncio").error("socket.accept() out of system resource %d", 1000)
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 20 + 1 + 1
    assert lines[-2].endswith("error: another")
    assert lines[-1].endswith("out of system resource 1000 (980 more like this one)")


def test_kinds_of_lines_that_are_counted_are_bounded():
    repeats = RepeatFilter()
    for k in range(5000):
        assert repeats.filter(logging.LogRecord("a", logging.ERROR, "", 0, f"line {k}", None, None))
    assert len(repeats._counted) == 1000
