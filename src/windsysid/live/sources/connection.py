"""Connection to a broker by MQTT 5 for many small messages: those of one read are parsed together.

The package mqtt5 parses and writes packets; connection, keep-alive and flow control are here. Messages have QoS 0 or 1.
A broker is not trusted: what it sends is bounded in size, and a malformed packet ends the connection.
"""

import asyncio
import contextlib
import ssl
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from windsysid.errors import ConfigurationError
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.broker import needed

if TYPE_CHECKING:
    import mqtt5

__all__ = ["Connection", "Message", "Session", "tls_of"]

KEEPALIVE_SECONDS = 20
"""A connection that is silent for half as long again is lost [s]."""

MAX_CONNECT_SECONDS = 5.0
"""For a connection to be made [s]."""

MAX_READ_BYTES = 1_000_000
"""Size of one read, and half of what waits in memory to be read [bytes]; the broker's others wait with the system."""

MAX_PACKET_BYTES = 2_000_000 + 65_536
"""Longest packet that a broker may send [bytes]: the longest payload of a block, its topic and its properties."""

MAX_TOPICS_PER_PACKET = 100
"""Of a subscription."""


class Session(NamedTuple):
    """Session that a client asks a broker for.

    Attributes
    ----------
    name
        Client identifier; the broker chooses one where it is empty.
    expiry
        Time for which the broker keeps messages for a disconnected client [s]; 0 begins a new session.
    unacknowledged
        Messages that the broker sends before the first of them is acknowledged.
    """

    name: str = ""
    expiry: int = 0
    unacknowledged: int = 65_535


class Message(NamedTuple):
    """A received message.

    Attributes
    ----------
    mid
        Packet identifier, by which it is acknowledged; 0 with QoS 0.
    properties
        User properties.
    retained
        Whether it was published before the subscription.
    """

    topic: str
    mid: int
    properties: dict[str, str]
    payload: bytes
    retained: bool


@contextlib.contextmanager
def _checking() -> Iterator[None]:
    """End the connection where a packet is malformed."""
    try:
        yield
    except ValueError as error:
        raise ConnectionError(f"malformed packet ({error})") from None
    except BaseException as error:
        if type(error).__name__ == "PanicException":  # so mqtt5 calls a text that is not UTF-8; it derives no Exception
            raise ConnectionError("malformed packet (a text that is not UTF-8)") from None
        raise


def tls_of(broker: Broker) -> ssl.SSLContext | None:
    """TLS of a broker's address, None without; ConfigurationError if the broker's authority cannot be read."""
    if not broker.url.startswith("mqtts://"):
        return None
    try:
        return ssl.create_default_context(cafile=broker.ca)
    except OSError as error:
        raise ConfigurationError(f"ca: '{broker.ca}' is no certificate of an authority ({error})") from None


class Connection:
    """A connection, for the event loop in which it was opened; an OSError says that it is lost.

    Attributes
    ----------
    unconfirmed
        Number of published messages that were sent and are not confirmed.
    refusal
        The newest message or subscription that the broker refused, and why; empty without one.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._mqtt5 = needed("mqtt5", "MQTT needs mqtt5")
        self._reader, self._writer = reader, writer
        self._rest, self._mid, self._pinged, self.refusal = b"", 0, time.monotonic(), ""
        self._keepalive, self._window = KEEPALIVE_SECONDS, 65_535
        self.unconfirmed, self._found, self._sending = 0, list["mqtt5.Packet"](), list[bytes]()
        self._waiting: deque[tuple[str, bytes, Iterable[tuple[str, str]], int, bool]] = deque()

    @classmethod
    async def open(cls, broker: Broker, session: Session = Session()) -> "Connection":
        """Connect.

        Raises
        ------
        OSError
            If there is no broker, it refuses, or its authority cannot be read.
        ConfigurationError
            If mqtt5 is not installed.
        """
        try:
            tls, address = tls_of(broker), urlsplit(broker.url)
        except ConfigurationError as error:  # its file may come back
            raise ConnectionError(str(error)) from None
        port = address.port or (1883 if tls is None else 8883)
        async with asyncio.timeout(MAX_CONNECT_SECONDS):
            streams = await asyncio.open_connection(address.hostname, port, ssl=tls, limit=MAX_READ_BYTES)
            connection = cls(*streams)
            try:
                await connection._greet(broker, session)
            except BaseException:
                connection._writer.close()
                raise
        return connection

    async def _greet(self, broker: Broker, session: Session) -> None:
        greeting = self._mqtt5.ConnectPacket(
            session.name,
            username=broker.user or None,
            password=broker.password.value.encode() if broker.user and broker.password else None,
            clean_start=not session.expiry,
            keep_alive=KEEPALIVE_SECONDS,
            session_expiry_interval=session.expiry,
            receive_max=session.unacknowledged,
            max_packet_size=MAX_PACKET_BYTES,
        )
        self._sending.append(greeting.write())
        self.send()
        answer, *self._found = await self._packets()
        reason = getattr(answer, "reason_code", None)
        if not isinstance(answer, self._mqtt5.ConnAckPacket) or reason != self._mqtt5.ConnAckReasonCode.SUCCESS:
            raise ConnectionError(f"the broker refuses ({_words(reason)}): check user, password, rights")
        self._keepalive = answer.server_keep_alive or KEEPALIVE_SECONDS
        self._window = answer.receive_max

    def subscribe(self, topics: Sequence[str]) -> None:
        """Subscribe to topics with QoS 1."""
        qos = self._mqtt5.QoS.AT_LEAST_ONCE
        filters = [self._mqtt5.TopicFilter(topic, max_qos=qos, retain_as_published=False) for topic in topics]
        for i in range(0, len(filters), MAX_TOPICS_PER_PACKET):
            packet = self._mqtt5.SubscribePacket(self._next_mid(), filters[i : i + MAX_TOPICS_PER_PACKET])
            self._sending.append(packet.write())
        self.send()

    def unsubscribe(self, topic: str) -> None:
        """End a subscription with the next `send`."""
        with contextlib.suppress(ValueError):  # the topic is the broker's, and may be none
            self._sending.append(self._mqtt5.UnsubscribePacket(self._next_mid(), [topic]).write())

    def acknowledge(self, mid: int) -> None:
        """Acknowledge a message with the next `send`."""
        self._sending.append(self._mqtt5.PubAckPacket(mid).write())

    def publish(
        self,
        topic: str,
        payload: bytes,
        properties: Iterable[tuple[str, str]] = (),
        *,
        qos: int = 1,
        retain: bool = False,
    ) -> None:
        """Publish with the next `send`, in the order of the calls; with QoS 1 when fewer messages are unconfirmed, of
        which brokers limit the number."""
        self._waiting.append((topic, payload, properties, qos, retain))

    def send(self) -> None:
        """Write all packets together, and pings: acknowledgements alone get no answer, by which a lost connection is
        known. It is to be called every second at least."""
        while self._waiting and (self._waiting[0][3] == 0 or self.unconfirmed < self._window):
            topic, payload, properties, qos, retain = self._waiting.popleft()
            packet = self._mqtt5.PublishPacket(
                topic,
                payload,
                qos=self._mqtt5.QoS.AT_LEAST_ONCE if qos else self._mqtt5.QoS.AT_MOST_ONCE,
                packet_id=self._next_mid() if qos else None,
                retain=retain,
                user_properties=list(properties),
            )
            self.unconfirmed += qos
            self._sending.append(packet.write())
        now = time.monotonic()
        if now > self._pinged + self._keepalive / 2.0:
            self._pinged = now
            self._sending.append(self._mqtt5.PingReqPacket().write())
        if self._sending:
            self._writer.write(b"".join(self._sending))
            self._sending.clear()

    async def confirmed(self) -> None:
        """Send what is published, and wait until the broker has confirmed it; messages that come are discarded."""
        self.send()
        while self.unconfirmed > 0:
            await self.messages()
        if self.refusal:
            raise ConnectionError(f"the broker refuses {self.refusal}")

    async def messages(self) -> list[Message]:
        """Wait for packets, and return the messages among them."""
        found, self._found = self._found or await self._packets(), []
        messages = []
        for packet in found:
            if isinstance(packet, self._mqtt5.PublishPacket):
                told = dict(packet.user_properties)
                messages.append(Message(packet.topic, packet.packet_id or 0, told, packet.payload, packet.retain))
            elif isinstance(packet, self._mqtt5.PubAckPacket):
                self.unconfirmed -= 1
                self._note("a message", packet.reason_code)
            elif isinstance(packet, self._mqtt5.SubAckPacket):
                for reason in packet.reason_codes:
                    self._note("a subscription", reason)
            elif isinstance(packet, self._mqtt5.DisconnectPacket):
                raise ConnectionError(f"the broker ended it ({_words(packet.reason_code)})")
        if self._waiting:
            self.send()
        return messages

    def _note(self, what: str, reason: "mqtt5.PubAckReasonCode | mqtt5.SubAckReasonCode") -> None:
        if reason.value >= 0x80:  # a failure
            self.refusal = f"{what} ({_words(reason)})"

    async def _packets(self) -> "list[mqtt5.Packet]":
        """Wait for at least one packet."""
        while True:
            async with asyncio.timeout(1.5 * self._keepalive):
                data = await self._reader.read(MAX_READ_BYTES)
            if not data:
                raise ConnectionError("closed by the broker")
            with _checking():
                found = self._parsed(self._rest + data)
            if found:
                return found

    def _parsed(self, data: bytes) -> "list[mqtt5.Packet]":
        """All complete packets; the beginning of another one waits for the next read."""
        view, at, found = memoryview(data), 0, []
        with contextlib.suppress(IndexError):  # so mqtt5 calls an incomplete packet
            while at < len(data):
                packet, size = self._mqtt5.read(view[at:])
                found.append(packet)
                at += size
        self._rest = data[at:]
        if len(self._rest) > MAX_PACKET_BYTES:
            raise ValueError(f"longer than {MAX_PACKET_BYTES} bytes")
        return found

    def _next_mid(self) -> int:
        self._mid = self._mid % 65_535 + 1
        return self._mid

    async def close(self) -> None:
        """Disconnect."""
        with contextlib.suppress(OSError):
            self._sending.append(self._mqtt5.DisconnectPacket().write())
            self.send()
            self._writer.close()
            async with asyncio.timeout(1.0):
                await self._writer.wait_closed()


def _words(reason: Enum | None) -> str:
    return "no answer of MQTT 5" if reason is None else reason.name.replace("_", " ").lower()
