"""Limits on requests to the page: sizes, rates, origins, and security headers.

Nothing of a request is logged. A request beyond a bound gets a status and one line, before anything reads it.
"""

import json
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from starlette.requests import ClientDisconnect

from windsysid.live.page.access import COOKIE, LOOPBACK, Access

__all__ = ["Buckets", "RequestGuard", "RequestLimits", "client_of"]

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]

HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),  # with none, browsers send forms with no origin
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), geolocation=(), microphone=()"),
)

SAFE = ("GET", "HEAD", "OPTIONS")


@dataclass(frozen=True)
class RequestLimits:
    """Limits on requests.

    Attributes
    ----------
    body, headers, address
        Bytes of a request's body, of all its headers, of its path and query.
    rate, burst
        Requests a second of one address that are answered in the long run, and at once.
    guesses
        Wrong tokens of one address in a minute.
    streams
        Event streams at once.
    clients
        Addresses that are remembered.
    """

    body: int = 16_384
    headers: int = 16_384
    address: int = 4_096
    rate: float = 50.0
    burst: float = 400.0
    guesses: float = 10.0
    streams: int = 64
    clients: int = 4096


class Buckets:
    """Token buckets of addresses, the longest unused forgotten first."""

    def __init__(self, rate: float, burst: float, clients: int) -> None:
        self._rate, self._burst, self._clients = rate, burst, clients
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def left(self, client: str) -> float:
        """Requests that a client has left."""
        count, at = self._left.get(client, (self._burst, 0.0))
        return min(self._burst, count + (time.monotonic() - at) * self._rate)

    def take(self, client: str) -> bool:
        """Take one; whether there was one."""
        left = self.left(client)
        self._left[client] = (left - 1.0 if left >= 1.0 else left, time.monotonic())
        self._left.move_to_end(client)
        if len(self._left) > self._clients:
            self._left.popitem(last=False)
        return left >= 1.0


class _TooLargeError(Exception):
    """A body that grew beyond its bound while it came."""


class RequestGuard:
    """ASGI middleware."""

    def __init__(self, app: App, access: Access, limits: RequestLimits) -> None:
        self._app, self._access, self._limits = app, access, limits
        self._requests = Buckets(limits.rate, limits.burst, limits.clients)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request that is refused, pass on any other."""
        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        if scope["type"] != "http":
            return None  # there are no web sockets
        got, limit = 0, self._limits.body

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *HEADERS]
                if scope["path"].startswith(("/api", "/metrics", "/health", "/login")):
                    message["headers"].append((b"cache-control", b"no-store"))
            await send(message)

        refused = self._refusal(scope)
        if refused is not None:
            return await _answer(send_guarded, *refused)

        async def receive_bounded() -> Message:
            nonlocal got
            message = await receive()
            got += len(message.get("body", b""))
            if got > limit:
                raise _TooLargeError
            return message

        async def send_unless_refused(message: Message) -> None:
            if got <= limit:  # else it is an answer to half of a body
                await send_guarded(message)

        with suppress(_TooLargeError, ClientDisconnect):  # ClientDisconnect: the client closed the connection
            await self._app(scope, receive_bounded, send_unless_refused)
        if got > limit:
            await _answer(send_guarded, 413, f"body: expected {limit} bytes or less")
        return None

    def _refusal(self, scope: Message) -> tuple[int, str] | None:
        if not self._is_within_rate(scope):
            return 429, f"too many requests: expected {self._limits.rate:g} a second or fewer"
        return self._size_refusal(scope) or self._content_refusal(scope)

    def _size_refusal(self, scope: Message) -> tuple[int, str] | None:
        limits = self._limits
        if len(scope.get("raw_path") or b"") + len(scope.get("query_string", b"")) > limits.address:
            return 414, f"address: expected {limits.address} bytes or less"
        if sum(len(name) + len(value) for name, value in scope["headers"]) > limits.headers:
            return 431, f"headers: expected {limits.headers} bytes or less"
        return None

    def _content_refusal(self, scope: Message) -> tuple[int, str] | None:
        said = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        length = said.get(b"content-length", "0")
        if not length.isdecimal() or int(length) > self._limits.body:
            return 413, f"body: expected {self._limits.body} bytes or less"
        host = said.get(b"host", "")
        if not self._access.asked and _name(host) not in LOOPBACK:
            return 403, "host: expected localhost or 127.0.0.1: for another name, give the page tokens"
        if scope["method"] not in SAFE and not _same_site(said, host):
            return 403, "origin: expected this page's own"
        return None

    def _is_within_rate(self, scope: Message) -> bool:
        """Check the rate of an address, separately for each role and for requests without a token.

        Behind a proxy all requests come from one address: those without a token must not use up the rate of those with
        one. The login form has a limit of wrong tokens instead (`Door`).
        """
        if scope["path"] == "/login":
            return True
        role = self._access.role_of_headers(scope["headers"]) if self._access.asked else None
        return self._requests.take(f"{client_of(scope)} {role}" if role else client_of(scope))


def client_of(scope: Message) -> str:
    """The address that a request comes from."""
    client = scope.get("client")
    return client[0] if client else ""


def _name(host: str) -> str:
    """A host without its port."""
    return host[: host.rfind(":")] if host.rpartition(":")[2].isdecimal() and not host.endswith("]") else host


def _same_site(said: dict[bytes, str], host: str) -> bool:
    """Check whether a request that changes data comes from this page or from a program."""
    if said.get(b"sec-fetch-site", "same-origin") not in ("same-origin", "none"):
        return False
    origin = said.get(b"origin")
    if origin is None:
        return b"sec-fetch-site" in said or COOKIE not in said.get(b"cookie", "")
    return origin.partition("://")[2] == host


async def _answer(send: Send, status: int, text: str) -> None:
    body = json.dumps({"detail": text}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if status == 429:
        headers.append((b"retry-after", b"1"))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
