"""Who may look and who may act: two tokens, or none on the service's own machine.

A program sends a token as ``Authorization: Bearer …``. A browser sends it once, to the login form, and gets a cookie
that scripts cannot read and other sites cannot send. The cookie holds a role and when it ends, signed by a key made of
the tokens: other tokens end all sessions, a restart ends none.
"""

import hashlib
import hmac
import ipaddress
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from starlette.requests import cookie_parser

from windsysid.errors import ConfigurationError

__all__ = ["COOKIE", "SESSION_SECONDS", "Access", "Role", "is_loopback"]

Role = Literal["reader", "operator"]

COOKIE = "windsysid_session"

SESSION_SECONDS = 30 * 86400
"""A screen on a wall logs in once a month."""

MIN_TOKEN_CHARACTERS = 16
"""Least number of characters of a token, so that it cannot be guessed."""

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
"""Names under which a page without tokens is served: a foreign name that leads here is an attack by DNS."""


@dataclass(frozen=True)
class Access:
    """The tokens.

    Attributes
    ----------
    read
        Of who may look; None: only operators may, if there is a token of theirs.
    operate
        Token that allows reading and acknowledging; None: no acknowledgement, if there is a reader's token.

    Raises
    ------
    ConfigurationError
        If a token is shorter than 16 characters or both are the same. The message shows none.
    """

    read: str | None = field(default=None, repr=False)
    operate: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, token in (("read-only", self.read), ("operator", self.operate)):
            if token is not None and (
                len(token) < MIN_TOKEN_CHARACTERS or not token.isascii() or not token.isprintable()
            ):
                raise ConfigurationError(
                    f"{name} token: expected {MIN_TOKEN_CHARACTERS} or more printable ASCII characters, got"
                    f" {len(token)}: make one by `openssl rand -hex 32`"
                )
        if self.read is not None and self.read == self.operate:
            raise ConfigurationError("page: the read-only and the operator token are the same: give each its own")

    @property
    def asked(self) -> bool:
        """Check whether a token is required."""
        return self.read is not None or self.operate is not None

    def check(self, host: str) -> None:
        """ConfigurationError where the page would be open to others: beyond loopback without a token."""
        if not self.asked and not is_loopback(host):
            raise ConfigurationError(
                f"page: host {host} can be reached by others: give a read-only or an operator token, or use 127.0.0.1"
            )

    def role(self, token: str) -> Role | None:
        """The role that a token gives; every token is compared, in constant time."""
        given = token.encode("utf-8", "surrogateescape")
        operator = self.operate is not None and hmac.compare_digest(given, self.operate.encode())
        reader = self.read is not None and hmac.compare_digest(given, self.read.encode())
        return "operator" if operator else "reader" if reader else None

    def role_of_headers(self, headers: Iterable[tuple[bytes, bytes]]) -> Role | None:
        """Role of a request, from its token or, without one, from its session cookie."""
        said = {name.lower(): value.decode("latin-1") for name, value in headers}
        scheme, _, token = said.get(b"authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self.role(token.strip())
        return self.role_of_session(cookie_parser(said.get(b"cookie", "")).get(COOKIE, ""))

    def session(self, role: Role, *, now: float | None = None) -> str:
        """Content of a browser's cookie."""
        ends = int((time.time() if now is None else now) + SESSION_SECONDS)
        return f"{role}.{ends}.{self._signature(f'{role}.{ends}')}"

    def role_of_session(self, cookie: str, *, now: float | None = None) -> Role | None:
        """The role that a cookie gives: None where it is not ours, or over."""
        said, _, signature = cookie.rpartition(".")
        if not hmac.compare_digest(signature.encode("utf-8", "surrogateescape"), self._signature(said).encode()):
            return None
        role, _, ends = said.partition(".")
        if float(ends) < (time.time() if now is None else now):
            return None
        return "operator" if role == "operator" else "reader"

    def _signature(self, said: str) -> str:
        key = hashlib.sha256(f"windsysid live\n{self.read or ''}\n{self.operate or ''}".encode()).digest()
        return hmac.new(key, said.encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()


def is_loopback(host: str) -> bool:
    """Check whether an address is reachable from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
