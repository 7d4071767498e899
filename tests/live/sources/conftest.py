"""A broker, and what takes blocks in."""

import asyncio
import threading
from collections.abc import Iterator
from concurrent.futures import Future

import pytest

from tests.live.sources.servers import Mosquitto
from windsysid.live.blocks.block import Block
from windsysid.live.sources.source import BlockSource


@pytest.fixture
def mosquitto(tmp_path) -> Iterator[Mosquitto]:
    """A broker that listens."""
    started = Mosquitto(tmp_path)
    yield started
    started.kill()


class Taker:
    """Takes blocks in as an engine does; commits them at once, or when it is told to."""

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self.held: list[Future[None]] = []
        self.holding = False

    def push(self, block: Block) -> Future[None]:
        """Take a block."""
        future: Future[None] = Future()
        self.blocks.append(block)
        if self.holding:
            self.held.append(future)
        else:
            future.set_result(None)
        return future

    def numbers(self) -> list[int]:
        """Of the blocks that came, each once."""
        return sorted({block.sequence for block in self.blocks})


class Service:
    """A source that runs in a thread, and what it brings."""

    def __init__(self, source: BlockSource, taker: Taker | None = None) -> None:
        self.source, self.taker = source, taker or Taker()
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self._loop.run_until_complete(self.source.run(self.taker.push, self._stop))

    def stop(self) -> None:
        """End in order."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(30.0)
        assert not self._thread.is_alive()
        self._loop.close()
