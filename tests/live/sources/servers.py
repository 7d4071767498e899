"""Servers that the tests start for themselves."""

import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest

from windsysid.live.configuration.source_settings import Broker

__all__ = ["Mosquitto", "free_port", "wait_for"]


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
