"""A connection to brokers that are slow, restart, or send malformed packets."""

import asyncio
import contextlib
import random
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from mqtt5 import (
    ConnectPacket,
    PubAckPacket,
    PubAckReasonCode,
    PublishPacket,
    QoS,
    SubAckPacket,
    SubAckReasonCode,
    read,
)

from windsysid.live.configuration.source_settings import Broker
from windsysid.live.configuration.toml_table import Secret
from windsysid.live.sources.connection import MAX_PACKET_BYTES, Connection, Message, Session

CONNACK = b"\x20\x03\x00\x00\x00"
MARKS = [("sequence", "17"), ("ä", "")]


def published(topic: str, payload: bytes, mid: int | None = None, **told) -> bytes:
    """A message as a broker sends it."""
    qos = QoS.AT_MOST_ONCE if mid is None else QoS.AT_LEAST_ONCE
    return PublishPacket(topic, payload, qos=qos, packet_id=mid, **told).write()


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
        connection = await Connection.open(broker, Session("service", 60, 9))
        try:
            return await then(connection, await came)
        finally:
            await connection.close()


async def first(connection: Connection, _: asyncio.StreamReader) -> list[Message]:
    return await connection.messages()


def test_messages_are_found_wherever_a_read_ends():
    payloads = [b"", b"x" * 100, b"y" * 20_000]
    sent = [published("a/b", payload, mid, user_properties=MARKS) for mid, payload in enumerate(payloads, 1)]
    data = b"".join([*sent, PubAckPacket(258).write()])

    async def receive(connection: Connection, _: asyncio.StreamReader) -> list[Message]:
        connection.unconfirmed, messages = 1, []
        while connection.unconfirmed:
            messages += await connection.messages()
        return messages

    for cut in (1, 2, 3, 10, 40, 150, 300, len(data) - 4, len(data) - 1):
        found = asyncio.run(answered(CONNACK + data[:cut], data[cut:], then=receive))
        assert found == [Message("a/b", mid, dict(MARKS), payload, False) for mid, payload in enumerate(payloads, 1)]


def test_messages_come_with_topic_identifier_properties_and_payload():
    other = {"payload_format_indicator": 1, "message_expiry_interval": 1, "subscription_ids": [128], "topic_alias": 1}
    sent = published("a", b"one") + published("b", b"two", 65_535, retain=True, user_properties=MARKS, **other)
    found = asyncio.run(answered(CONNACK + sent, then=first))  # as a broker does that kept messages
    assert found == [Message("a", 0, {}, b"one", False), Message("b", 65_535, dict(MARKS), b"two", True)]


def test_a_text_that_other_libraries_refuse_is_read():
    """Mosquitto hands on a mark with U+FEFF; a client that refuses it would get it again after each connection."""
    sent = published("a", b"one", 1, user_properties=[("\ufeffafter", "1")])
    found = asyncio.run(answered(CONNACK + sent, then=first))
    assert found == [Message("a", 1, {"\ufeffafter": "1"}, b"one", False)]


def test_no_more_is_published_than_the_broker_takes():
    async def publish(connection: Connection, reader: asyncio.StreamReader) -> bytes:
        for k in range(4):
            connection.publish("t", b"%d" % k)
        connection.publish("t", b"", qos=0)  # not before those that wait
        connection.send()
        assert (await reader.readuntil(b"\x001")).endswith(
            b"\x00\x01t\x00\x01\x000" + b"\x32\x07\x00\x01t\x00\x02\x001"
        )
        assert connection.unconfirmed == 2
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(reader.read(1), 0.05)
        return b""

    asyncio.run(answered(b"\x20\x06\x00\x00\x03\x21\x00\x02", then=publish))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # mqtt5 about texts that are not UTF-8
@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"\x20\x03\x00\x86\x00", "bad user name or password"),
        (b"\x20\x02\x00\x01", "malformed"),
        (b"\x20\x00", "malformed"),
        (published("a", b""), "no answer of MQTT 5"),
        (b"HTTP/1.1 400 Bad Request\r\n" + bytes(100), "malformed"),
        (CONNACK + b"\xe0\x01\x8e", "taken over"),
        (CONNACK + b"\x30\xff\xff\xff\xff\x01", "variable byte integer"),
        (CONNACK + b"\x30\xff\xff\xff\x7f" + bytes(MAX_PACKET_BYTES), f"longer than {MAX_PACKET_BYTES} bytes"),
        (CONNACK + b"\x32\x04\x00\x09ab", "remaining length"),
        (CONNACK + b"\x32\x07\x00\x01a\x00\x01\x09\x26", "malformed"),
        (CONNACK + b"\x30\x05\x00\x01a\x01\x01", "malformed"),
        (CONNACK + b"\x30\x04\x00\x01\xff\x00", "not UTF-8"),
    ],
)
def test_a_refusal_and_a_malformed_packet_end_the_connection(answer: bytes, why: str):
    with pytest.raises(OSError, match=why):
        asyncio.run(answered(answer, then=first))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_arbitrary_bytes_never_raise_anything_but_an_error_of_the_connection():
    rng = random.Random(3)

    async def receive(connection: Connection, _: asyncio.StreamReader) -> None:
        async with asyncio.timeout(0.05):
            while True:
                await connection.messages()

    for _ in range(60):
        sent = bytearray(b"".join(published("a", bytes(30), mid, user_properties=MARKS) for mid in range(1, 4)))
        for _ in range(rng.randrange(1, 6)):
            sent[rng.randrange(len(sent))] = rng.randrange(256)
        with contextlib.suppress(OSError):
            asyncio.run(answered(CONNACK + bytes(sent), then=receive))


def test_an_authority_that_is_gone_is_an_error_of_the_connection(tmp_path: Path):
    """The file is read at each connection: another error would end the thread of a publisher for good."""
    with pytest.raises(OSError, match=r"ca: '.*gone\.pem' is no certificate"):
        asyncio.run(Connection.open(Broker("mqtts://127.0.0.1:9", ca=tmp_path / "gone.pem")))


def test_a_connection_is_kept_alive_and_a_silent_one_is_lost(monkeypatch: pytest.MonkeyPatch):
    async def wait(connection: Connection, reader: asyncio.StreamReader) -> None:
        await reader.read(1000)
        await asyncio.sleep(0.6)
        connection.send()
        assert await reader.read(1000) == b"\xc0\x00"
        await connection.messages()

    with pytest.raises(TimeoutError):
        asyncio.run(answered(b"\x20\x06\x00\x00\x03\x13\x00\x01", then=wait))  # the broker's own keep-alive time


def test_a_connection_on_which_only_acknowledgements_go_out_is_kept_alive():
    """Nothing answers them: without pings a service that commits what came lost its connection after 30 s."""

    async def answer(connection: Connection, reader: asyncio.StreamReader) -> None:
        await reader.read(1000)
        sent = b""
        for _ in range(8):
            connection.acknowledge(1)
            connection.send()
            await asyncio.sleep(0.1)
            sent += await reader.read(1000)
        assert sent.count(b"\xc0\x00") == 1

    asyncio.run(answered(b"\x20\x06\x00\x00\x03\x13\x00\x01", then=answer))


def test_a_message_that_the_broker_refuses_is_not_confirmed():
    async def publish(connection: Connection, _: asyncio.StreamReader) -> None:
        connection.publish("t", b"1")
        connection.send()
        await connection.confirmed()

    refusal = PubAckPacket(1, reason_code=PubAckReasonCode.NOT_AUTHORIZED).write()
    with pytest.raises(ConnectionError, match=r"refuses a message \(not authorized\)"):
        asyncio.run(answered(CONNACK, refusal, then=publish))
    asyncio.run(
        answered(CONNACK, PubAckPacket(1, reason_code=PubAckReasonCode.NO_MATCHING_SUBSCRIBERS).write(), then=publish)
    )


def test_a_subscription_that_the_broker_refuses_is_said_and_ends_nothing():
    async def subscribe(connection: Connection, _: asyncio.StreamReader) -> tuple[list[Message], str]:
        connection.subscribe(["T01", "T02"])
        return await connection.messages(), connection.refusal

    answer = SubAckPacket(1, [SubAckReasonCode.NOT_AUTHORIZED, SubAckReasonCode.GRANTED_QOS_AT_LEAST_ONCE]).write()
    found = asyncio.run(answered(CONNACK, answer + published("T02", b"one"), then=subscribe))
    assert found == ([Message("T02", 0, {}, b"one", False)], "a subscription (not authorized)")


def test_a_packet_of_a_session_says_who_connects_and_what_it_takes():
    async def look(_: Connection, reader: asyncio.StreamReader) -> bytes:
        return await reader.read(1000)

    sent = asyncio.run(answered(CONNACK, then=look))
    assert isinstance(sent, bytes)
    expected = ConnectPacket(
        "service",
        username="site",
        password=b"geheim",
        keep_alive=20,
        session_expiry_interval=60,
        receive_max=9,
        max_packet_size=MAX_PACKET_BYTES,
    )
    assert read(memoryview(sent)) == (expected, len(sent))
