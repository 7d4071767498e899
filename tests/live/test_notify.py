"""Who is told of alarms is told of all of them: after a restart, and after having been away."""

import asyncio
import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tests.live.sources.servers import Logger, wait_for
from windsysid.live import notify
from windsysid.live.configuration.settings import MqttNotice
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.notify import MqttRecipient, UndeliveredError, Webhook, notice_of, tell_alarms
from windsysid.live.store.contents import Alarm, Commit, Status
from windsysid.live.store.opening import open_store
from windsysid.live.store.store import Store

PATIENCE = 30.0


def alarm(number: int, **other: Any) -> Alarm:
    told: dict[str, Any] = {"turbine": "T01", "kind": "structure", "severity": "alarm", "about": "k_side_side"}
    told |= {"opened": 10**18 + number, "earliest": 10**18, "latest": 10**18 + number, "ended": None}
    return Alarm(key=f"T01/k+#{number}", text=f"softer by {number} %", **(told | other))


def open_(store: Store, *alarms: Alarm) -> None:
    store.submit(Commit(alarms=alarms)).result()


class Listener:
    """A recipient that is away when it is told to be."""

    key, severity = "listener", "warning"

    def __init__(self) -> None:
        self.heard: list[Alarm] = []
        self.error: Exception | None = None
        self.tries = 0

    async def send(self, alarm: Alarm) -> None:
        self.tries += 1
        if self.error is not None:
            raise self.error
        self.heard.append(alarm)

    async def close(self) -> None:
        pass


@pytest.fixture
def store() -> Iterator[Store]:
    opened = open_store(":memory:")
    yield opened
    opened.close()


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notify, "POLL_SECONDS", 0.02)
    monkeypatch.setattr(notify, "MIN_PAUSE_SECONDS", 0.02)
    monkeypatch.setattr(notify, "MAX_PAUSE_SECONDS", 0.1)


def tell_until(store: Store, listener: Any, done: Callable[[], bool], then: Callable[[], None] = lambda: None) -> None:
    """Run until a condition holds."""

    async def run() -> None:
        stop = asyncio.Event()
        task = asyncio.create_task(tell_alarms(store, listener, stop))
        until = time.monotonic() + PATIENCE
        try:
            while not done():
                assert not task.done(), task.result()
                assert time.monotonic() < until
                await asyncio.sleep(0.01)
            await asyncio.to_thread(then)
        finally:
            stop.set()
            await task

    asyncio.run(run())


def test_what_opens_and_ends_is_told_once_also_over_restarts(store: Store):
    listener = Listener()
    open_(store, alarm(1))
    tell_until(store, listener, lambda: store.told("listener") is not None)
    open_(store, alarm(2))  # while the service is down
    open_(store, alarm(1, ended=2 * 10**18))
    store.submit(Commit(statuses=[Status("T01", {}, 0, 0, "running", None, {})])).result()
    tell_until(store, listener, lambda: len(listener.heard) == 3)
    assert [(one.key, one.ended is None) for one in listener.heard] == [
        ("T01/k+#1", True), ("T01/k+#1", False), ("T01/k+#2", True),
    ]  # fmt: skip
    tell_until(store, listener, lambda: store.told("listener") == store.last_event())
    assert len(listener.heard) == 3


def test_a_recipient_that_was_away_is_told_when_it_is_back(store: Store):
    listener = Listener()
    listener.error = UndeliveredError("away")
    tell_until(store, listener, lambda: store.told("listener") is not None)
    open_(store, alarm(1))
    tell_until(store, listener, lambda: listener.tries >= 3)
    assert not listener.heard
    listener.error = None
    tell_until(store, listener, lambda: len(listener.heard) == 1)


def test_a_message_that_is_refused_for_good_holds_up_nothing(store: Store):
    listener = Listener()
    tell_until(store, listener, lambda: store.told("listener") is not None)
    open_(store, alarm(1))
    listener.error = UndeliveredError("too large", for_good=True)
    tell_until(store, listener, lambda: store.told("listener") == store.last_event())
    listener.error = None
    open_(store, alarm(2))
    tell_until(store, listener, lambda: bool(listener.heard))
    assert [one.key for one in listener.heard] == ["T01/k+#2"]


def test_what_is_less_severe_than_asked_is_not_told(store: Store):
    listener = Listener()
    tell_until(store, listener, lambda: store.told("listener") is not None)
    open_(store, alarm(1, severity="notice"), alarm(2, severity="warning"))
    tell_until(store, listener, lambda: bool(listener.heard))
    assert [one.key for one in listener.heard] == ["T01/k+#2"]


def test_a_notice_says_its_state_in_one_line_that_stands_alone():
    assert notice_of(alarm(5))["text"] == "T01: alarm: softer by 5 %"
    ended = notice_of(alarm(5, ended=10**18))
    assert ended["text"] == "T01: alarm, ended: softer by 5 %"
    assert ended["ended"] == "2001-09-09T01:46:40Z"


def test_a_webhook_posts_json_with_its_token_and_shows_neither(store: Store):
    heard: list[tuple[str | None, Any]] = []
    answers = [500, 200]

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(answers.pop(0))
            self.end_headers()
            heard.append((self.headers["Authorization"], body))

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    hook = Webhook(f"http://127.0.0.1:{server.server_port}/secret-path", "secret-token", "warning")
    assert "secret" not in hook.key
    open_(store, alarm(1))
    tell_until(store, hook, lambda: len(heard) == 2)  # answered 500: sent again
    server.shutdown()
    assert heard[0] == heard[1]
    authorization, body = heard[0]
    assert authorization == "Bearer secret-token"
    assert body["key"] == "T01/k+#1"
    assert body["state"] == "open"


def test_a_webhook_without_a_server_is_undelivered_without_its_address():
    hook = Webhook("http://127.0.0.1:9/secret-path", None, "warning")

    async def send() -> None:
        try:
            await hook.send(alarm(1))
        finally:
            await hook.close()

    with pytest.raises(UndeliveredError, match=r"^no answer \(ConnectError\)$"):
        asyncio.run(send())


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[int]:
    program = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
    if program is None:
        pytest.skip("mosquitto is not installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (tmp_path / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n", encoding="utf-8")
    command = [program, "-c", str(tmp_path / "mosquitto.conf")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    yield port
    process.terminate()
    process.wait()


def test_a_broker_keeps_open_alarms_and_none_that_ended(store: Store, broker: int):
    recipient = MqttRecipient(MqttNotice(Broker(f"mqtt://127.0.0.1:{broker}"), "w/{turbine}/alarms/{alarm}", "warning"))
    open_(store, alarm(1), alarm(2))
    tell_until(store, recipient, lambda: store.told(recipient.key) is not None)
    again = MqttRecipient(MqttNotice(Broker(f"mqtt://127.0.0.1:{broker}"), "w/{turbine}/alarms/{alarm}", "warning"))
    open_(store, alarm(1, ended=2 * 10**18))
    tell_until(store, again, lambda: store.told(recipient.key) == store.last_event())
    listener = Logger(Broker(f"mqtt://127.0.0.1:{broker}"), "w/#", "end")
    listener.say("end", b"{}")  # what is retained comes before it
    wait_for(lambda: ("end", b"{}") in listener.heard)
    listener.close()
    kept = [(topic, json.loads(payload)) for topic, payload in listener.heard]
    alarms = [(topic, message["key"]) for topic, message in kept if topic != "end"]
    assert alarms == [("w/T01/alarms/T01%2Fk%2B%232", "T01/k+#2")]
