"""Protocol of sources of blocks, and the queue of blocks that are not committed yet."""

import asyncio
import contextlib
import logging
import random
from collections import deque
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future
from typing import NamedTuple, Protocol

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.blocks.limits import one_line

__all__ = ["BlockSource", "Commits", "Push", "SourceState", "refuse", "retries", "stopped_within"]

Push = Callable[[Block], Future[None]]
"""Takes a block in: the future ends when it is committed. It may wait, and goes with any thread."""

MAX_PAUSE_SECONDS = 30.0
"""Pause between two attempts to reach a source [s]."""


class SourceState(NamedTuple):
    """State of a source.

    Attributes
    ----------
    state
        ``waiting``, ``running``, ``trying`` (what it reads from cannot be reached), ``failed`` (what does not mend
        itself: the service starts it again), ``ended``.
    text
        Why it is not running; empty where it is.
    blocks
        That were taken in.
    refused
        Blocks, messages or files that can never be taken.
    refusal
        Reason for the last refusal.
    """

    state: str = "waiting"
    text: str = ""
    blocks: int = 0
    refused: int = 0
    refusal: str = ""

    def with_refusal(self, why: str) -> "SourceState":
        """Return the state after one more refusal."""
        return self._replace(refused=self.refused + 1, refusal=one_line(why))


class BlockSource(Protocol):
    """Brings blocks of one turbine or of many."""

    state: SourceState

    def describe(self) -> str:
        """Description of the source, without secrets."""

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Bring blocks until `stop` is set or there are no more.

        What cannot be reached is tried again by the source itself; an error that comes out of here is one that trying
        again does not mend.
        """


MAX_UNCOMMITTED_BLOCKS = 32
"""Blocks that wait for their commit at most."""

_log = logging.getLogger(__name__)


def refuse(source: BlockSource, why: str) -> None:
    """Log and count a block, message or file that a source can never take."""
    _log.warning("%s: refused: %s", source.describe(), why)
    source.state = source.state.with_refusal(why)


class Commits:
    """Blocks that a source has pushed, in their order, until they are committed.

    Parameters
    ----------
    source
        Its state counts them.
    about
        What refusals begin with.
    """

    def __init__(self, source: BlockSource, about: str = "") -> None:
        self._source, self._about = source, about
        self._waiting: deque[asyncio.Future[None]] = deque()

    async def push(self, push: Push, block: Block) -> None:
        """Push a block; wait while `MAX_UNCOMMITTED_BLOCKS` blocks are on their way."""
        try:
            self._waiting.append(asyncio.wrap_future(await asyncio.to_thread(push, block)))
        except BlockRefused as error:
            refuse(self._source, f"{self._about}{error}")
        while len(self._waiting) >= MAX_UNCOMMITTED_BLOCKS or (self._waiting and self._waiting[0].done()):
            await self._settle()

    async def finish(self) -> None:
        """Wait for all of them."""
        while self._waiting:
            await self._settle()

    async def _settle(self) -> None:
        source = self._source
        try:
            await self._waiting.popleft()
            source.state = source.state._replace(blocks=source.state.blocks + 1)
        except BlockRefused as error:
            refuse(source, f"{self._about}{error}")


async def stopped_within(stop: asyncio.Event, seconds: float) -> bool:
    """Wait for `stop`, `seconds` [s] at most; whether it is set."""
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(stop.wait(), seconds)
    return stop.is_set()


async def retries(stop: asyncio.Event, first: float = 0.5) -> AsyncIterator[Callable[[], None]]:
    """Attempts until `stop` is set, at growing pauses from `first` to 30 s; each yields what to call when it succeeded,
    so that the next pause is the shortest again."""
    pause = first

    def succeeded() -> None:
        nonlocal pause
        pause = first

    while not stop.is_set():
        yield succeeded
        if await stopped_within(stop, pause * random.uniform(0.5, 1.0)):  # not all at once when a broker comes back
            return
        pause = min(2.0 * pause, MAX_PAUSE_SECONDS)
