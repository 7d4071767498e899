"""Bounds of the page's connections: how many there are, and how long a request and the reading of its answer may take.

A connection *waits* while it has not sent a whole request. Where there is no room for a new one, the oldest that waits
is closed: connections that send half a request and nothing more keep nobody out, not even those of their own address.
"""

import asyncio
import logging
import sys
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["Connections", "bounded", "most_connections"]

REQUEST_SECONDS = 15.0
"""In which a request, head and body, must have come."""

ANSWER_SECONDS = 30.0
"""In which a client must read on, once as much of an answer waits as is buffered."""

MOST_CONNECTIONS, MOST_OF_ADDRESS = 1000, 100

OWN_FILES = 256
"""Files that the service itself needs: its store, broker, workers and logs."""

WANTED_FILES = 65_536

logger = logging.getLogger("windsysid.live")


def most_connections() -> int:
    """How many connections the process has files for, after its soft limit was raised as far as it may be."""
    if sys.platform == "win32":
        return MOST_CONNECTIONS
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_FILES if hard == resource.RLIM_INFINITY else min(hard, WANTED_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
        except (OSError, ValueError):
            logger.debug("the limit of open files stays at %d", soft)
    if soft == resource.RLIM_INFINITY:
        return MOST_CONNECTIONS
    return max(16, min(MOST_CONNECTIONS, soft - OWN_FILES))


class Connections:
    """Connections that are open, the oldest first.

    Parameters
    ----------
    most, of_address
        How many there may be, and how many of one address.
    """

    def __init__(self, most: int = MOST_CONNECTIONS, of_address: int = MOST_OF_ADDRESS) -> None:
        self._most, self._of_address = most, of_address
        self._open: dict[Any, str] = {}
        self._by_address: dict[str, dict[Any, None]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def enter(self, connection: Any, address: str) -> bool:
        """Let a connection in, in the place of one that waits where there is no other; False where there is no room."""
        of_address = self._by_address.get(address, {})
        if len(of_address) >= self._of_address and not self._close_waiting(of_address):
            return False
        if len(self._open) >= self._most and not self._close_waiting(self._open):
            return False
        self._open[connection] = address
        self._by_address.setdefault(address, {})[connection] = None
        return True

    def leave(self, connection: Any) -> None:
        """Forget a connection."""
        address = self._open.pop(connection, None)
        if address is not None:
            del self._by_address[address][connection]
            if not self._by_address[address]:
                del self._by_address[address]

    def _close_waiting(self, among: dict[Any, Any]) -> bool:
        """Close the oldest connection that waits for a request; whether there was one."""
        waiting = next((connection for connection in among if connection.waits), None)
        if waiting is None:
            return False
        self.leave(waiting)
        waiting.transport.abort()
        logger.warning("page: as many connections as may be: the oldest that sent no whole request was closed")
        return True


def bounded(connections: Connections) -> type[asyncio.Protocol]:
    """Uvicorn's protocol with bounds of number and time."""

    class Bounded(H11Protocol):
        _request: asyncio.TimerHandle | None = None
        _answer: asyncio.TimerHandle | None = None

        @property
        def waits(self) -> bool:
            """Whether no whole request has come since the last one was answered."""
            return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            if connections.enter(self, self.client[0] if self.client else ""):
                self._watch()
            else:
                transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            connections.leave(self)
            self._request = _cancel(self._request)
            self._answer = _cancel(self._answer)
            super().connection_lost(exc)

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._watch()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            self._watch()

        def pause_writing(self) -> None:
            super().pause_writing()
            self._answer = self._answer or self.loop.call_later(ANSWER_SECONDS, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            self._answer = _cancel(self._answer)

        def _watch(self) -> None:
            """Limit the time of a request that has begun, the first one from the connection on."""
            state = self.conn.their_state
            begun = state is h11.SEND_BODY or (
                state is h11.IDLE and (self.cycle is None or bool(self.conn.trailing_data[0]))
            )
            if not begun or self.transport.is_closing():
                self._request = _cancel(self._request)
            elif self._request is None:
                self._request = self.loop.call_later(REQUEST_SECONDS, self.transport.abort)

    return Bounded


def _cancel(timer: asyncio.TimerHandle | None) -> asyncio.TimerHandle | None:
    """Cancel a timer; the timer that there is afterwards, none."""
    if timer is not None:
        timer.cancel()
    return None
