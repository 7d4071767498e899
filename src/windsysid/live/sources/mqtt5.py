"""Connection to a broker by MQTT 5 for many small messages: those of one read are parsed together.

Packets are those of https://docs.oasis-open.org/mqtt/mqtt/v5.0/mqtt-v5.0.html, messages have QoS 0 or 1. A broker is
not trusted: what it sends is bounded in size, and a malformed packet ends the connection.
"""

import asyncio
import contextlib
import ssl
import struct
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

from windsysid.errors import ConfigurationError
from windsysid.live.configuration.source_settings import Broker

__all__ = ["Connection", "Message", "ack_packet", "check_authority", "packets", "publish_packet", "user_properties"]

KEEPALIVE_SECONDS = 20
"""A connection that is silent for half as long again is lost [s]."""

MAX_CONNECT_SECONDS = 5.0
"""For a connection to be made [s]."""

MAX_READ_BYTES = 1_000_000
"""Size of one read, and half of what waits in memory to be read [bytes]; the broker's others wait with the system."""

MAX_PACKET_BYTES = 2_000_000 + 65_536
"""Longest packet that a broker may send [bytes]: the longest payload of a block, its topic and its properties."""

MAX_TOPICS_PER_PACKET = 100
CONNACK, PUBLISH, PUBACK, DISCONNECT = 2, 3, 4, 14
SERVER_KEEPALIVE, RECEIVE_MAXIMUM, SUBSCRIPTION, USER_PROPERTY = 0x13, 0x21, 0x0B, 0x26
_SIZES = dict.fromkeys((0x01, 0x17, 0x19, 0x24, 0x25, 0x28, 0x29, 0x2A), 1)
_SIZES |= dict.fromkeys((0x13, 0x21, 0x22, 0x23), 2) | dict.fromkeys((0x02, 0x11, 0x18, 0x27), 4)
"""Sizes of properties that are numbers [bytes]; others are texts."""

_REASONS = {0x86: "bad user name or password", 0x87: "not authorised", 0x8E: "session taken over by another client"}

_u16 = struct.Struct(">H").unpack_from
_puback = struct.Struct(">BBH").pack


class Message(NamedTuple):
    """A received message: `mid`, its packet identifier, is 0 with QoS 0; `properties` are user properties. One that is
    `retained` was published before the subscription."""

    topic: bytes
    mid: int
    properties: dict[str, str]
    payload: bytes
    retained: bool


def packets(data: bytes) -> tuple[list[tuple[int, bytes]], int]:
    """First byte and content of every complete packet at the beginning of `data`, and their size [bytes].

    Raises
    ------
    ValueError
        If a packet is malformed, or longer than `MAX_PACKET_BYTES`.
    """
    found, begin, size = [], 0, len(data)
    while begin + 2 <= size:
        try:
            length, at = _number_at(data, begin + 1)
        except IndexError:
            break
        if length > MAX_PACKET_BYTES:
            raise ValueError(f"a packet of {length} bytes")
        if at + length > size:
            break
        found.append((data[begin], data[at : at + length]))
        begin = at + length
    return found, begin


def publish_packet(topic: bytes, payload: bytes, told: bytes = b"", mid: int = 0, *, retain: bool = False) -> bytes:
    """A message with properties `told` and QoS 1, or with QoS 0 where `mid` is 0."""
    head = _text(topic) + (mid.to_bytes(2, "big") if mid else b"") + _number(len(told)) + told
    return _packet(0x30 | (2 if mid else 0) | retain, head + payload)


def user_properties(pairs: Iterable[tuple[str, str]]) -> bytes:
    """User properties of a message, for `Connection.publish`."""
    return b"".join([b"\x26" + _text(key.encode()) + _text(value.encode()) for key, value in pairs])


def ack_packet(mid: int) -> bytes:
    """The acknowledgement of a message with QoS 1."""
    return _puback(PUBACK << 4, 2, mid)


def _connect_packet(broker: Broker, name: str, expiry: int, unacknowledged: int) -> bytes:
    flags, content = 0 if expiry else 2, _text(name.encode())
    if broker.user:
        flags, content = flags | 0x80, content + _text(broker.user.encode())
        if broker.password is not None:
            flags, content = flags | 0x40, content + _text(broker.password.value.encode())
    told = struct.pack(">BIBHBI", 0x11, expiry, RECEIVE_MAXIMUM, unacknowledged, 0x27, MAX_PACKET_BYTES)
    head = struct.pack(">H4sBBHB", 4, b"MQTT", 5, flags, KEEPALIVE_SECONDS, len(told))
    return _packet(0x10, head + told + content)


def _packet(head: int, content: bytes) -> bytes:
    return bytes((head,)) + _number(len(content)) + content


def _number(value: int) -> bytes:
    """A variable byte integer."""
    return bytes((value,)) if value < 128 else bytes((value & 127 | 128,)) + _number(value >> 7)


def _number_at(data: bytes, at: int) -> tuple[int, int]:
    """A variable byte integer, and the offset behind it."""
    value = 0
    for shift in (0, 7, 14, 21):
        digit = data[at]
        at += 1
        value |= (digit & 127) << shift
        if digit < 128:
            return value, at
    raise ValueError("a length of more than four bytes")


def _text(content: bytes) -> bytes:
    return len(content).to_bytes(2, "big") + content


def _text_at(data: bytes, at: int) -> tuple[bytes, int]:
    end = at + 2 + _u16(data, at)[0]
    if end > len(data):
        raise ValueError("a truncated text")
    return data[at + 2 : end], end


def _message(head: int, content: bytes) -> Message:
    topic, at = _text_at(content, 0)
    mid = _u16(content, at)[0] if head & 6 else 0
    told, _, at = _properties_at(content, at + 2 if head & 6 else at)
    return Message(topic, mid, told, content[at:], bool(head & 1))


def _properties_at(data: bytes, at: int) -> tuple[dict[str, str], dict[int, int], int]:
    """User properties, those that are numbers by their identifiers, and the offset behind all."""
    size, at = _number_at(data, at)
    end, told, numbers = at + size, {}, {}
    while at < end:
        kind = data[at]
        at += 1
        if kind == USER_PROPERTY:
            key, at = _text_at(data, at)
            value, at = _text_at(data, at)
            told[key.decode(errors="replace")] = value.decode(errors="replace")
        elif kind in _SIZES:
            numbers[kind] = int.from_bytes(data[at : at + _SIZES[kind]], "big")
            at += _SIZES[kind]
        elif kind == SUBSCRIPTION:
            _, at = _number_at(data, at)
        else:
            _, at = _text_at(data, at)
    if at != end or end > len(data):
        raise ValueError("truncated properties")
    return told, numbers, end


def _reason(code: int) -> str:
    return _REASONS.get(code, f"code {code:#04x}")


@contextlib.contextmanager
def _checking() -> Iterator[None]:
    """End the connection where a packet is malformed."""
    try:
        yield
    except (ValueError, IndexError, struct.error) as error:
        raise ConnectionError(f"malformed packet ({error})") from None


def _tls(broker: Broker) -> ssl.SSLContext | None:
    return ssl.create_default_context(cafile=broker.ca) if broker.url.startswith("mqtts://") else None


def check_authority(broker: Broker) -> None:
    """Check that the broker's authority can be read; ConfigurationError otherwise."""
    try:
        _tls(broker)
    except OSError as error:
        raise ConfigurationError(f"ca: '{broker.ca}' is no certificate of an authority ({error})") from None


class Connection:
    """A connection, for the event loop in which it was opened; an OSError says that it is lost. `unconfirmed` is the
    number of messages that were published, sent and not confirmed."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._rest, self._mid, self._spoke = b"", 0, time.monotonic()
        self._keepalive, self._window = KEEPALIVE_SECONDS, 65_535
        self.unconfirmed, self._found = 0, list[tuple[int, bytes]]()
        self._waiting: deque[tuple[bytes, bytes, bytes, int, bool]] = deque()

    @classmethod
    async def open(
        cls, broker: Broker, name: str = "", *, expiry: int = 0, unacknowledged: int = 65_535
    ) -> "Connection":
        """Connect.

        Parameters
        ----------
        name
            Client identifier; the broker chooses one where it is empty.
        expiry
            Time for which the broker keeps messages for a disconnected client [s]; 0 begins a new session.
        unacknowledged
            Messages that the broker sends before the first of them is acknowledged.

        Raises
        ------
        OSError
            If there is no broker, or it refuses.
        """
        tls, address = _tls(broker), urlsplit(broker.url)
        port = address.port or (1883 if tls is None else 8883)
        async with asyncio.timeout(MAX_CONNECT_SECONDS):
            streams = await asyncio.open_connection(address.hostname, port, ssl=tls, limit=MAX_READ_BYTES)
            connection = cls(*streams)
            try:
                await connection._greet(_connect_packet(broker, name, expiry, unacknowledged))
            except BaseException:
                connection._writer.close()
                raise
        return connection

    async def _greet(self, packet: bytes) -> None:
        self.send(packet)
        with _checking():
            (head, content), *self._found = await self._packets()
            if head >> 4 != CONNACK or content[1]:
                raise ConnectionError(f"the broker refuses ({_reason(content[1])}): check user, password, rights")
            _, numbers, _ = _properties_at(content, 2)
        self._keepalive = numbers.get(SERVER_KEEPALIVE) or KEEPALIVE_SECONDS
        self._window = numbers.get(RECEIVE_MAXIMUM, self._window)

    def subscribe(self, topics: Sequence[bytes]) -> None:
        """Subscribe to topics with QoS 1."""
        for i in range(0, len(topics), MAX_TOPICS_PER_PACKET):
            listed = b"".join([_text(topic) + b"\x01" for topic in topics[i : i + MAX_TOPICS_PER_PACKET]])
            self.send(_packet(0x82, self._next_mid().to_bytes(2, "big") + b"\x00" + listed))

    def unsubscribe(self, topic: bytes) -> None:
        """End a subscription."""
        self.send(_packet(0xA2, self._next_mid().to_bytes(2, "big") + b"\x00" + _text(topic)))

    def publish(
        self, topic: bytes, payload: bytes, properties: bytes = b"", *, qos: int = 1, retain: bool = False
    ) -> None:
        """Publish in this order: with the next `send`, or when fewer are unconfirmed, as many as the broker takes."""
        self._waiting.append((topic, payload, properties, qos, retain))

    def send(self, *packets: bytes) -> None:
        """Write packets and published messages together, or a ping where nothing was sent for long: call it often."""
        now, sent = time.monotonic(), list(packets)
        while self._waiting and (self.unconfirmed < self._window or not self._waiting[0][3]):
            topic, payload, properties, qos, retain = self._waiting.popleft()
            self.unconfirmed += qos
            sent.append(publish_packet(topic, payload, properties, self._next_mid() if qos else 0, retain=retain))
        if sent or now > self._spoke + self._keepalive / 2.0:
            self._spoke = now
            self._writer.write(b"".join(sent) or b"\xc0\x00")

    async def confirmed(self) -> None:
        """Send what is published, and wait until the broker has confirmed it; messages that come are discarded."""
        self.send()
        while self.unconfirmed > 0:
            await self.messages()

    async def messages(self) -> list[Message]:
        """Wait for packets, and return the messages among them."""
        with _checking():
            found, self._found = self._found or await self._packets(), []
            for head, content in found:
                if head >> 4 == DISCONNECT:
                    raise ConnectionError(f"the broker ended it ({_reason(content[0] if content else 0)})")
                self.unconfirmed -= head >> 4 == PUBACK
            if self._waiting:
                self.send()
            return [_message(head, content) for head, content in found if head >> 4 == PUBLISH]

    async def _packets(self) -> list[tuple[int, bytes]]:
        """Wait for at least one packet."""
        while True:
            async with asyncio.timeout(1.5 * self._keepalive):
                data = await self._reader.read(MAX_READ_BYTES)
            if not data:
                raise ConnectionError("closed by the broker")
            data = self._rest + data
            found, size = packets(data)
            self._rest = data[size:]
            if found:
                return found

    def _next_mid(self) -> int:
        self._mid = self._mid % 65_535 + 1
        return self._mid

    async def close(self) -> None:
        """Disconnect."""
        with contextlib.suppress(OSError):
            self._writer.write(b"\xe0\x00")
            self._writer.close()
            async with asyncio.timeout(1.0):
                await self._writer.wait_closed()
