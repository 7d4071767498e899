"""Channels of a SCADA server over OPC UA, read at even times as the slow channels of a turbine.

All nodes are read at once, at multiples of a period of the service's clock. A value that the server calls bad is
missing. A server that does not answer is connected to again: what was not read meanwhile is missing, for a server keeps
no history that could be asked.
"""

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.configuration.source_settings import Certificates
from windsysid.live.configuration.toml_table import Secret
from windsysid.live.sources.broker import needed
from windsysid.live.sources.source import Push, SourceState, refuse, retries, stopped_within

__all__ = ["OpcuaSource"]

logger = logging.getLogger(__name__)

SECOND = 1_000_000_000
"""Nanoseconds."""

BLOCK_SECONDS = 5.0
"""Length of a block [s], and one sample at least."""

MAX_ANSWER_SECONDS = 4.0
"""For an answer of the server [s]."""

MAX_LAST_WAIT_SECONDS = 2.0
"""For the store to take the last blocks when the service ends [s]."""

POLICIES = ("Aes256Sha256RsaPss", "Aes128Sha256RsaOaep", "Basic256Sha256")
"""Kinds of encryption, the strongest first."""

MAX_DELAY_PERIODS = 0.5
"""Of a period: an answer that comes later is of another moment, and missing."""

MAX_KEPT_BLOCKS = 10_000
"""Blocks that wait for the store at most: beyond, the oldest are dropped."""

STREAM = "scada"
"""Of the turbine's loggers this is the one of this name."""


class OpcuaSource:
    """Reads nodes of a server.

    Parameters
    ----------
    server
        ``opc.tcp://HOST:PORT/…``.
    turbine
        Whose channels they are.
    nodes
        Of each channel the node, such as ``ns=2;s=Rotor.Speed``, and its unit.
    every
        Period [s].
    user, password
        Credentials, if the server requires them.
    secured
        Certificates by which client and server know each other; all is signed and encrypted then.
    """

    def __init__(
        self,
        server: str,
        turbine: str,
        nodes: Mapping[str, tuple[str, str]],
        *,
        every: float = 1.0,
        user: str = "",
        password: Secret | None = None,
        secured: Certificates | None = None,
    ) -> None:
        self.server, self.turbine, self.nodes, self.every = server, turbine, dict(nodes), every
        self.user, self.password, self.secured = user, password, secured
        self.state = SourceState()
        self._blocks: asyncio.Queue[Block] = asyncio.Queue()

    def describe(self) -> str:
        """The server and how many channels are read."""
        return f"OPC UA server {self.server} of {self.turbine}, {len(self.nodes)} channels"

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Read until `stop` is set; a server that goes away is connected to again.

        Raises
        ------
        ConfigurationError
            If asyncua is not installed, a node is not written as one, or a certificate or key cannot be read.
        """
        asyncua = needed("asyncua", "OPC UA needs asyncua")
        for library in ("asyncua", "asyncua.client", "asyncua.common"):
            logging.getLogger(library).setLevel(logging.CRITICAL)  # what it says with tracebacks, we say in a line
        bringing = asyncio.create_task(self._bring(push))
        try:
            async for succeeded in retries(stop):
                why = await self._hold(asyncua, succeeded, stop)
                if not stop.is_set():
                    logger.warning("%s: %s; trying again", self.describe(), why)
                    self.state = self.state._replace(state="trying", text=why)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._blocks.join(), MAX_LAST_WAIT_SECONDS)
        finally:
            bringing.cancel()
        self.state = self.state._replace(state="ended")

    async def _hold(self, asyncua: Any, succeeded: Any, stop: asyncio.Event) -> str:
        """Be connected, and read, until it fails or `stop` is set; why it failed."""
        client = asyncua.Client(self.server, timeout=MAX_ANSWER_SECONDS)
        if self.user:
            client.set_user(self.user)
            client.set_password("" if self.password is None else self.password.value)
        try:
            nodes = [client.get_node(node) for node, _ in self.nodes.values()]
        except asyncua.ua.UaStringParsingError as error:
            raise ConfigurationError(f"node: expected one such as ns=2;s=Rotor.Speed: {str(error)[:80]}") from None
        try:
            if self.secured is not None:
                await asyncio.wait_for(_secure(client, self.secured), 2.0 * MAX_ANSWER_SECONDS)
            await asyncio.wait_for(client.connect(), 2.0 * MAX_ANSWER_SECONDS)
            succeeded()
            self.state = self.state._replace(state="running", text="")
            await self._read(client, nodes, stop)
        except ConfigurationError:
            raise
        except Exception as error:  # asyncua raises what it likes
            return str(error).split("\n")[0][:120] or type(error).__name__
        finally:
            try:
                await asyncio.wait_for(client.disconnect(), MAX_ANSWER_SECONDS)
            except Exception:
                logger.debug("disconnecting", exc_info=True)
        return ""

    async def _read(self, client: Any, nodes: Sequence[Any], stop: asyncio.Event) -> None:
        period = round(self.every * SECOND)
        length = max(1, round(BLOCK_SECONDS / self.every))
        rows: list[list[float]] = []
        first = tick = time.time_ns() // period * period + period
        try:
            while not await stopped_within(stop, max(0.0, (tick - time.time_ns()) / SECOND)):
                answers = await asyncio.wait_for(client.read_attributes(nodes), MAX_ANSWER_SECONDS)
                late = time.time_ns() - tick > MAX_DELAY_PERIODS * period
                rows.append([math.nan if late else _number(answer) for answer in answers])
                tick += period
                behind = (time.time_ns() - tick) // period
                if behind > 0 or len(rows) >= length:  # moments that went by are missing
                    self._give(first, rows)
                    tick += max(0, behind) * period
                    rows, first = [], tick
        finally:
            self._give(first, rows)

    def _give(self, start: int, rows: list[list[float]]) -> None:
        if not rows:
            return
        if self._blocks.qsize() >= MAX_KEPT_BLOCKS:
            self._blocks.get_nowait()
            self._blocks.task_done()
            logger.warning(
                "%s: the store has been unavailable for too long: the oldest block is dropped", self.describe()
            )
        units = tuple(unit for _, unit in self.nodes.values())
        values = np.array(rows, dtype=np.float64)
        self._blocks.put_nowait(
            Block(self.turbine, start, start, 1.0 / self.every, tuple(self.nodes), units, values, STREAM)
        )

    async def _bring(self, push: Push) -> None:
        """Push blocks one after the other; a block that was not committed is tried again."""
        while True:
            block = await self._blocks.get()
            async for _ in retries(asyncio.Event()):
                try:
                    await asyncio.wrap_future(await asyncio.to_thread(push, block))
                    self.state = self.state._replace(blocks=self.state.blocks + 1)
                except BlockRefused as error:
                    refuse(self, str(error))
                except Exception as error:
                    logger.warning("%s: block not committed: %s; trying again", self.describe(), error)
                    continue
                break
            self._blocks.task_done()


async def _secure(client: Any, files: Certificates) -> None:
    """Have all that goes to and fro signed and encrypted, by the strongest of `POLICIES` that the server offers.

    Raises
    ------
    ConfigurationError
        If a file is no certificate or key.
    ConnectionError
        If the server offers none of them, or has another certificate.
    """
    from asyncua import ua
    from asyncua.crypto import security_policies, uacrypto

    def content(path: Path) -> Any:
        text = path.read_bytes()
        return uacrypto.CertProperties(text, "pem" if b"-----BEGIN" in text else "der")

    certificate, key, server = (content(path) for path in (files.certificate, files.key, files.server_certificate))
    try:
        own = await uacrypto.load_certificate(certificate.path_or_content, certificate.extension)
        theirs = await uacrypto.load_certificate(server.path_or_content, server.extension)
        await uacrypto.load_private_key(key.path_or_content, None, key.extension)
    except (ValueError, TypeError) as error:
        raise ConfigurationError(
            f"certificate, key or server_certificate: expected PEM or DER files, got something else ({str(error)[:60]})"
        ) from None
    client.application_uri = _application_uri(own) or client.application_uri
    encrypted = ua.MessageSecurityMode.SignAndEncrypt
    endpoints = await client.connect_and_get_server_endpoints()
    offers = {one.SecurityPolicyUri: one.ServerCertificate for one in endpoints if one.SecurityMode == encrypted}
    policy = _strongest(security_policies, offers)
    if policy is None:
        raise ConnectionError(f"the server offers no encryption that is safe: expected one of {', '.join(POLICIES)}")
    if not offers[policy.URI].startswith(uacrypto.der_from_x509(theirs)):
        raise ConnectionError("the server's certificate is not server_certificate: another server, or a renewed one")
    await client.set_security(policy, certificate, key, server_certificate=server, mode=encrypted)


def _strongest(known: Any, offers: Container[str]) -> Any:
    """The first of `POLICIES` whose address is offered; None without one."""
    policies = (getattr(known, f"SecurityPolicy{name}") for name in POLICIES)
    return next((policy for policy in policies if policy.URI in offers), None)


def _application_uri(certificate: Any) -> str:
    """The name of the application that a certificate is for; empty where it tells none."""
    from cryptography import x509

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    found = names.get_values_for_type(x509.UniformResourceIdentifier)
    return str(found[0]) if found else ""


def _number(answer: Any) -> float:
    """The value of a node, missing where it is bad or no number."""
    if answer.StatusCode is not None and not answer.StatusCode.is_good():
        return math.nan
    value = None if answer.Value is None else answer.Value.Value
    if isinstance(value, bool | int | float) and math.isfinite(value):
        return float(value)
    return math.nan
