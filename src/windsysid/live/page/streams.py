"""Server-sent events about changes in the store, for every open page.

One thread's worth of reading serves all pages: a watcher follows the journal while anybody listens. A message says what
to read again, and its id is the journal's: a page that was away sends it back and misses nothing.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator

from windsysid.errors import WindsysidError
from windsysid.live.page.models import JournalChanges
from windsysid.live.store.contents import Event
from windsysid.live.store.store import Store

__all__ = ["Streams", "TooManyStreams"]

POLL_SECONDS = 0.5
"""Interval of reading the journal while pages are open [s]."""

MAX_SINGLE_EVENTS = 2000
"""Largest number of events sent one by one; after more, a page requests all data again."""


class TooManyStreams(Exception):  # noqa: N818 - it is no fault, it is a bound
    """As many pages listen as may."""


class Streams:
    """All open streams of one app.

    `close` ends them and lets no new one in: whoever stops the server calls it first, since a server waits for its open
    answers.
    """

    def __init__(self, store: Store, most: int) -> None:
        self._store, self._most = store, most
        self._open = 0
        self._kept: deque[Event] = deque(maxlen=MAX_SINGLE_EVENTS)
        self._complete_after = self._last = 0
        self._changed = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._watcher: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()
        self._closed = False

    @property
    def count(self) -> int:
        """Streams that are open."""
        return self._open

    def close(self) -> None:
        """End all streams; from any thread."""
        self._closed = True
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._wake)

    def enter(self) -> None:
        """Count a stream in; TooManyStreams where there is no room."""
        if self._closed or self._open >= self._most:
            raise TooManyStreams
        self._open += 1

    def leave(self) -> None:
        """Count a stream out."""
        self._open -= 1
        if self._open == 0 and self._watcher is not None:
            self._watcher.cancel()
            self._watcher = None

    async def follow(self, after: int | None) -> AsyncIterator[tuple[int, JournalChanges]]:
        """Changes after an event, with the id of the last event sent; for a stream that was counted in."""
        await self._watch()
        told = self._last if after is None else min(after, self._last)
        while not self._closed:
            changed = self._changed
            if self._last > told:
                fresh, missed = [event for event in self._kept if event.id > told], told < self._complete_after
                told = self._last
                yield told, _changes(fresh, missed)
            else:
                await changed.wait()

    async def _watch(self) -> None:
        """Start to read the journal, unless it is being read."""
        async with self._starting:
            if self._watcher is None or self._watcher.done():
                self._loop = asyncio.get_running_loop()
                self._kept.clear()
                self._complete_after = self._last = await asyncio.to_thread(self._store.last_event)
                self._watcher = self._loop.create_task(self._follow_journal())

    async def _follow_journal(self) -> None:
        while not self._closed:
            await asyncio.sleep(POLL_SECONDS)
            try:
                fresh = await asyncio.to_thread(self._store.events, self._last, most=MAX_SINGLE_EVENTS)
            except WindsysidError:  # the database is not reachable: try again
                continue
            if fresh:
                self._kept.extend(fresh)
                self._last = fresh[-1].id
                if len(self._kept) == MAX_SINGLE_EVENTS:
                    self._complete_after = self._kept[0].id - 1
                self._wake()

    def _wake(self) -> None:
        """Wake all streams that wait, and let them wait anew."""
        waiting, self._changed = self._changed, asyncio.Event()
        waiting.set()


def _changes(events: list[Event], missed: bool) -> JournalChanges:
    return JournalChanges(
        turbines=sorted({event.turbine for event in events}),
        results=sorted({event.turbine for event in events if event.kind == "result"}),
        alarms=sorted({event.key for event in events if event.kind == "alarm"}),
        all=missed,
    )
