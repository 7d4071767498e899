"""Packets of MQTT 5, and a connection to brokers that are slow, restart, or send what is no packet."""

import asyncio
import contextlib
import random
from collections.abc import Awaitable, Callable

import pytest

from windsysid.live.configuration.source_settings import Broker
from windsysid.live.configuration.toml_table import Secret
from windsysid.live.sources.mqtt5 import (
    MAX_PACKET_BYTES,
    Connection,
    Message,
    ack_packet,
    packets,
    publish_packet,
    user_properties,
)

CONNACK = b"\x20\x03\x00\x00\x00"
MARKS = user_properties([("sequence", "17"), ("ä", "")])


async def answered(*answers: bytes, then: Callable[[Connection, asyncio.StreamReader], Awaitable[object]]) -> object:
    """Connect to a broker that answers so, one after the other."""
    came: asyncio.Future[asyncio.StreamReader] = asyncio.get_running_loop().create_future()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for answer in answers:
            writer.write(answer)
            await asyncio.sleep(0.02)
        came.set_result(reader)

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        broker = Broker(f"mqtt://127.0.0.1:{port}", "site", Secret("geheim"))
        connection = await Connection.open(broker, "service", expiry=60, unacknowledged=9)
        try:
            return await then(connection, await came)
        finally:
            await connection.close()


async def first(connection: Connection, _: asyncio.StreamReader) -> list[Message]:
    return await connection.messages()


def test_packets_are_found_wherever_a_read_ends():
    payloads = [b"", b"x" * 100, b"y" * 20_000]
    data = b"".join(publish_packet(b"a/b", payload, MARKS, mid) for mid, payload in enumerate(payloads))
    data += ack_packet(258)
    for cut in (*range(300), len(data) - 4, len(data)):
        found, size = packets(data[:cut])
        again, rest = packets(data[size:])
        assert [head >> 4 for head, _ in found + again] == [3, 3, 3, 4]
        assert size + rest == len(data)
    assert packets(ack_packet(258)) == ([(0x40, b"\x01\x02")], 4)


def test_messages_come_with_topic_identifier_properties_and_payload():
    other = b"\x01\x01" + b"\x02\x00\x00\x00\x01" + b"\x0b\x80\x01" + b"\x08\x00\x01r" + b"\x23\x00\x01"
    sent = publish_packet(b"a", b"one") + publish_packet(b"b", b"two", other + MARKS, 65_535, retain=True)
    found = asyncio.run(answered(CONNACK + sent, then=first))  # as a broker does that kept messages
    told = {"sequence": "17", "ä": ""}
    assert found == [Message(b"a", 0, {}, b"one", False), Message(b"b", 65_535, told, b"two", True)]


def test_no_more_is_published_than_the_broker_takes_and_in_order():
    async def publish(connection: Connection, reader: asyncio.StreamReader) -> bytes:
        for k in range(8):
            connection.publish(b"t", b"%d" % k, qos=k % 2)
        connection.send()
        sent = await reader.readuntil(b"\x004")
        assert sent.endswith(b"\x32\x07\x00\x01t\x00\x02\x003" + b"\x30\x05\x00\x01t\x004")  # 5 waits, and so does 6
        assert connection.unconfirmed == 2
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(reader.read(1), 0.05)
        return b""

    asyncio.run(answered(b"\x20\x06\x00\x00\x03\x21\x00\x02", then=publish))


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"\x20\x03\x00\x86\x00", "bad user name or password"),
        (b"\x20\x02\x00\x01", "code 0x01"),
        (b"\x20\x00", "malformed"),
        (b"HTTP/1.1 400 Bad Request\r\n" + bytes(100), "refuses"),
        (CONNACK + b"\xe0\x01\x8e", "taken over"),
        (CONNACK + b"\x30\xff\xff\xff\xff\x01", "more than four bytes"),
        (CONNACK + b"\x30\xff\xff\xff\x7f", f"{2**28 - 1} bytes"),
        (CONNACK + b"\x32\x04\x00\x09ab", "truncated text"),
        (CONNACK + b"\x32\x07\x00\x01a\x00\x01\x09\x26", "malformed"),
        (CONNACK + b"\x30\x05\x00\x01a\x01\x01", "malformed|truncated"),
    ],
)
def test_a_refusal_and_a_malformed_packet_end_the_connection(answer: bytes, why: str):
    with pytest.raises(OSError, match=why):
        asyncio.run(answered(answer, then=first))


def test_arbitrary_bytes_never_raise_anything_but_an_error_of_the_connection():
    rng = random.Random(3)

    async def receive(connection: Connection, _: asyncio.StreamReader) -> None:
        async with asyncio.timeout(0.05):
            while True:
                await connection.messages()

    for _ in range(60):
        sent = bytearray(b"".join(publish_packet(b"a", bytes(30), MARKS, mid) for mid in range(3)))
        for _ in range(rng.randrange(1, 6)):
            sent[rng.randrange(len(sent))] = rng.randrange(256)
        with contextlib.suppress(OSError):
            asyncio.run(answered(CONNACK + bytes(sent), then=receive))


def test_a_connection_is_kept_alive_and_a_silent_one_is_lost(monkeypatch: pytest.MonkeyPatch):
    async def wait(connection: Connection, reader: asyncio.StreamReader) -> None:
        await reader.read(1000)
        await asyncio.sleep(0.6)
        connection.send()
        assert await reader.read(1000) == b"\xc0\x00"
        await connection.messages()

    with pytest.raises(TimeoutError):
        asyncio.run(answered(b"\x20\x06\x00\x00\x03\x13\x00\x01", then=wait))  # the broker's own keep-alive time


def test_a_packet_of_a_session_says_who_connects_and_what_it_takes():
    async def look(_: Connection, reader: asyncio.StreamReader) -> bytes:
        return await reader.read(1000)

    sent = asyncio.run(answered(CONNACK, then=look))
    assert isinstance(sent, bytes)
    head = b"\x00\x04MQTT\x05\xc0\x00\x14\x0d\x11\x00\x00\x00\x3c\x21\x00\x09\x27" + MAX_PACKET_BYTES.to_bytes(4, "big")
    assert sent == bytes([0x10, len(sent) - 2]) + head + b"\x00\x07service\x00\x04site\x00\x06geheim"
