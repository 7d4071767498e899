"""Servers that the tests start for themselves."""

import asyncio
import shutil
import socket
import subprocess
import threading
import time
from pathlib import Path

import pytest

from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.broker import Marks, properties_of
from windsysid.live.sources.connection import Connection, Message

__all__ = ["Logger", "Mosquitto", "free_port", "wait_for"]


def free_port() -> int:
    """A port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(condition, seconds: float = 60.0) -> None:
    """Wait until a condition holds; the test fails where it never does."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.02)


class Mosquitto:
    """A broker of our own, which keeps what it has in a folder."""

    def __init__(self, folder: Path, *lines: str, port: int | None = None) -> None:
        if shutil.which("mosquitto") is None:
            pytest.skip("mosquitto is not installed")
        self.port = port or free_port()
        self.folder, self.url = folder, f"mqtt://127.0.0.1:{self.port}"
        self.settings = folder / "mosquitto.conf"
        text = [f"listener {self.port} 127.0.0.1", "persistence true", f"persistence_location {folder}/", "user root"]
        self.settings.write_text(
            "\n".join([*text, "autosave_interval 1", *(lines or ("allow_anonymous true",))]) + "\n"
        )
        self.process: subprocess.Popen[bytes] | None = None
        self.start()

    @property
    def broker(self) -> Broker:
        """How it is reached."""
        return Broker(self.url)

    def start(self) -> None:
        """Start it, and wait until it listens."""
        log = (self.folder / "mosquitto.log").open("ab")
        self.process = subprocess.Popen(["mosquitto", "-c", self.settings], stdout=log, stderr=log)
        wait_for(self._listens)

    def _listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, (self.folder / "mosquitto.log").read_text()
        try:
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        except OSError:
            return False
        return True

    def kill(self) -> None:
        """As when its machine loses power."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()


class Logger:
    """A logger without a buffer, and what it hears."""

    def __init__(self, broker: Broker, *topics: str) -> None:
        self.messages: list[Message] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._connection = self._do(Connection.open(broker))
        self._do(self._subscribe(*topics))

    @property
    def heard(self) -> list[tuple[str, bytes]]:
        """Topic and payload of each message."""
        return [(message.topic, message.payload) for message in self.messages]

    def _do(self, what):
        return asyncio.run_coroutine_threadsafe(what, self._loop).result(30.0)

    async def _subscribe(self, *topics: str) -> None:
        self._connection.subscribe(topics)
        self._hearing = asyncio.ensure_future(self._hear())

    async def _hear(self) -> None:
        while True:
            self.messages += await self._connection.messages()

    def say(self, topic: str, payload: bytes, marks: Marks | None = None) -> None:
        """Publish, and wait until the broker has confirmed it."""
        self._do(self._say(topic, payload, [] if marks is None else properties_of(marks)))

    async def _say(self, topic: str, payload: bytes, properties: list[tuple[str, str]]) -> None:
        self._connection.publish(topic, payload, properties)
        self._connection.send()
        while self._connection.unconfirmed:
            await asyncio.sleep(0.001)

    def close(self) -> None:
        """Disconnect."""
        self._hearing.cancel()
        self._do(self._connection.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
