"""Limits on the page's connections: their number, and the time for a request and for reading its answer.

A connection *waits* while it has not sent a whole request. If there are too many connections, the oldest that waits is
closed for a new one. So connections that send half a request block no other client, not even one of their own address.
"""

import asyncio
import logging
import sys
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

__all__ = ["Connections", "bounded", "connection_limit"]

MAX_REQUEST_SECONDS = 15.0
"""Time for sending a request, head and body [s]."""

MAX_READ_SECONDS = 30.0
"""Time for a client to continue reading an answer, once the buffer is full [s]."""

MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS = 1000, 100
"""Largest number of open connections, of all clients and of one address."""

MIN_CONNECTIONS = 16
"""Number of connections that is always allowed, however few files the process may open."""

RESERVED_FILES = 256
"""Number of open files for the service itself: its store, broker, workers and logs."""

MAX_OPEN_FILES = 65_536
"""Number of open files to which the soft limit of the process is raised, if its hard limit allows it."""

logger = logging.getLogger("windsysid.live")


def connection_limit() -> int:
    """Raise the soft limit of open files, and return the number of connections that it leaves room for."""
    if sys.platform == "win32":
        return MAX_CONNECTIONS
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
        except (OSError, ValueError):
            logger.debug("the limit of open files stays at %d", soft)
    if soft == resource.RLIM_INFINITY:
        return MAX_CONNECTIONS
    return max(MIN_CONNECTIONS, min(MAX_CONNECTIONS, soft - RESERVED_FILES))


class Connections:
    """Open connections, the oldest first.

    Parameters
    ----------
    most, of_address
        Largest number of all, and of one address.
    """

    def __init__(self, most: int = MAX_CONNECTIONS, of_address: int = MAX_CONNECTIONS_PER_ADDRESS) -> None:
        self._most, self._of_address = most, of_address
        self._open: dict[Any, str] = {}
        self._by_address: dict[str, dict[Any, None]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def enter(self, connection: Any, address: str) -> bool:
        """Register a connection; if there are too many, close the oldest that waits. False if none of them waits."""
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
        """Close the oldest connection that waits; False if there is none."""
        waiting = next((connection for connection in among if connection.waits), None)
        if waiting is None:
            return False
        self.leave(waiting)
        waiting.transport.abort()
        logger.warning("page: too many connections: the oldest one without a whole request was closed")
        return True


def bounded(connections: Connections) -> type[asyncio.Protocol]:
    """Build uvicorn's protocol with limits on the number of connections and on their times."""
    return type("Bounded", (_Bounded,), {"open_connections": connections})


class _Bounded(H11Protocol):
    """Uvicorn's HTTP protocol with limits; `bounded` sets its connections."""

    open_connections: Connections
    _request: asyncio.TimerHandle | None = None
    _answer: asyncio.TimerHandle | None = None

    @property
    def waits(self) -> bool:
        """Check whether no whole request has arrived since the last answer."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if self.open_connections.enter(self, self.client[0] if self.client else ""):
            self._watch()
        else:
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self.open_connections.leave(self)
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
        self._answer = self._answer or self.loop.call_later(MAX_READ_SECONDS, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._answer = _cancel(self._answer)

    def _watch(self) -> None:
        """Limit the time of a request that has begun; the first one begins with the connection."""
        state = self.conn.their_state
        begun = state is h11.SEND_BODY or (
            state is h11.IDLE and (self.cycle is None or bool(self.conn.trailing_data[0]))
        )
        if not begun or self.transport.is_closing():
            self._request = _cancel(self._request)
        elif self._request is None:
            self._request = self.loop.call_later(MAX_REQUEST_SECONDS, self.transport.abort)


def _cancel(timer: asyncio.TimerHandle | None) -> asyncio.TimerHandle | None:
    """Cancel a timer, if there is one, and return None in its place."""
    if timer is not None:
        timer.cancel()
    return None
