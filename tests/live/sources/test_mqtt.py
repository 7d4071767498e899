"""What a broker has is taken in, and acknowledged when it is committed; what it loses is sent again."""

import asyncio
import json
import shutil
import socket
import subprocess
import sys
import threading
import time
from asyncio import StreamReader, StreamWriter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mqtt5 import SubAckPacket, SubAckReasonCode

from tests.live.sources.conftest import Service, Taker
from tests.live.sources.servers import Logger, Mosquitto, free_port, wait_for
from windsysid.errors import ConfigurationError
from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused, encode_json
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.configuration.toml_table import Secret
from windsysid.live.engine import Engine, Followed
from windsysid.live.sources.broker import Marks, Topics
from windsysid.live.sources.mqtt import MqttSource
from windsysid.live.sources.publisher import MAX_UNCOMMITTED_BLOCKS, Publisher
from windsysid.live.sources.ring import Flow, PackedBlock, Ring
from windsysid.live.store.opening import open_store

SECOND = 1_000_000_000


def block_of(number: int, turbine: str = "T01", stream: str = "") -> Block:
    values = np.random.default_rng(number).standard_normal((20, 2)).astype(np.float32)
    channels, units = ("tower_x_acceleration", "tower_y_acceleration"), ("m/s^2", "m/s^2")
    return Block(turbine, number, number * SECOND, 20.0, channels, units, values, stream)


@pytest.mark.parametrize("topic", ["windsysid/{turbine}/blocks", "site/{turbine}"])
def test_what_a_publisher_sends_comes_bit_for_bit_and_is_forgotten(mosquitto: Mosquitto, topic: str):
    service = Service(MqttSource(mosquitto.broker, ["T01", "T02"], topic=topic))
    with Publisher(mosquitto.broker, topic=topic, patience=0.5) as publisher:
        sent = [block_of(k, turbine, stream) for k in range(1, 101) for turbine, stream in (("T01", ""), ("T02", "b"))]
        assert publisher.send(*sent) == 200
        assert publisher.wait(60.0)
        assert publisher.send(*sent) == 0  # they were sent
    service.stop()
    found = {(block.turbine, block.stream, block.sequence): block for block in service.taker.blocks}
    assert len(found) == 200
    for block in sent:
        other = found[block.turbine, block.stream, block.sequence]
        assert (other.start, other.rate, other.channels, other.units) == (
            block.start, block.rate, block.channels, block.units,
        )  # fmt: skip
        assert other.values.dtype == np.float32
        assert other.values.tobytes() == block.values.tobytes()


@pytest.mark.slow
def test_a_publisher_sends_no_more_than_a_broker_keeps_for_a_service_that_is_slow(mosquitto: Mosquitto):
    turbines = [f"T{i:03d}" for i in range(100)]
    taker = Taker()
    taker.holding = True
    service = Service(MqttSource(mosquitto.broker, turbines), taker)
    wait_for(lambda: service.source.state.state == "running")
    with Publisher(mosquitto.broker, patience=60.0) as publisher:
        publisher.send(*(block_of(k, turbine) for turbine in turbines for k in range(1, 41)))
        wait_for(lambda: len(taker.blocks) >= 500)
        time.sleep(1.0)
        taker.holding = False
        for future in list(taker.held):
            future.set_result(None)
        assert publisher.wait(40.0)  # mosquitto drops what comes beyond 1000 that wait, and nobody hears of it
        assert publisher.resent == 0
    service.stop()
    assert len(taker.blocks) == 4000


def test_what_is_not_committed_is_not_acknowledged_and_comes_again(mosquitto: Mosquitto):
    taker = Taker()
    taker.holding = True
    service = Service(MqttSource(mosquitto.broker, ["T01"]), taker)
    wait_for(lambda: service.source.state.state == "running")
    logger = Logger(mosquitto.broker, "windsysid/+/committed")
    for k in range(1, 6):
        logger.say("windsysid/T01/blocks", encode_json(block_of(k)))
    wait_for(lambda: len(taker.blocks) == 5)
    for future in taker.held[:2]:
        future.set_result(None)
    wait_for(lambda: ("windsysid/T01/committed", b"2") in logger.heard)
    service.stop()
    again = Service(MqttSource(mosquitto.broker, ["T01"]))
    wait_for(lambda: again.taker.numbers() == [3, 4, 5])
    wait_for(lambda: ("windsysid/T01/committed", b"5") in logger.heard)
    again.stop()
    third = Service(MqttSource(mosquitto.broker, ["T01"]))
    wait_for(lambda: third.source.state.state == "running")
    logger.say("windsysid/T01/blocks", encode_json(block_of(6)))
    wait_for(lambda: bool(third.taker.blocks))
    third.stop()
    assert third.taker.numbers() == [6]
    logger.close()


def test_a_block_that_can_never_be_taken_is_acknowledged_counted_and_told(mosquitto: Mosquitto):
    class Picky(Taker):
        def push(self, block):
            if block.sequence == 2:
                raise BlockRefused("two is none")
            return super().push(block)

    service = Service(MqttSource(mosquitto.broker, ["T01"]), Picky())
    logger = Logger(mosquitto.broker, "windsysid/+/refused", "windsysid/+/committed")
    wait_for(lambda: service.source.state.state == "running")
    logger.say("windsysid/T01/blocks", b"\x00nonsense")
    logger.say("windsysid/T01/blocks", encode_json(block_of(1)), Marks(1))
    logger.say("windsysid/T01/blocks", encode_json(block_of(2)), Marks(2, after=1))
    logger.say("windsysid/T01/blocks", encode_json(block_of(3)), Marks(3, after=2))
    wait_for(lambda: ("windsysid/T01/committed", b"3") in logger.heard)
    told = [json.loads(payload) for topic, payload in logger.heard if topic.endswith("refused")]
    assert [each["sequence"] for each in told] == [None, 2]
    assert told[1]["reason"] == "two is none"
    assert (service.source.state.blocks, service.source.state.refused) == (2, 2)
    service.stop()
    logger.close()


def test_a_publisher_lets_go_of_a_block_that_is_refused_and_says_so(
    mosquitto: Mosquitto, caplog: pytest.LogCaptureFixture
):
    class Picky(Taker):
        def push(self, block):
            if block.sequence in (1, 7):
                raise BlockRefused("no such block")
            return super().push(block)

    service = Service(MqttSource(mosquitto.broker, ["T01"]), Picky())
    with Publisher(mosquitto.broker, patience=0.5) as publisher:
        publisher.send(*(block_of(k) for k in range(1, 31)))
        assert publisher.wait(60.0)
        assert publisher.refused == 2
    assert caplog.text.count("no such block") >= 2
    with Publisher(mosquitto.broker) as other:
        with pytest.raises(BlockRefused, match="stream: expected up to 40 letters"):  # it would be sent for ever
            other.send(block_of(1, stream="two words"))
        assert len(other.ring) == 0
    service.stop()
    assert service.taker.numbers() == [k for k in range(1, 31) if k not in (1, 7)]


def test_a_store_that_was_deleted_gets_the_blocks_that_the_broker_says_are_committed(mosquitto: Mosquitto):
    service = Service(MqttSource(mosquitto.broker, ["T01"]))
    blocks = [block_of(k) for k in range(1, 21)]
    with Publisher(mosquitto.broker, patience=0.5) as publisher:
        publisher.send(*blocks)
        assert publisher.wait(60.0)
    service.stop()
    logger = Logger(mosquitto.broker, "windsysid/+/committed")
    wait_for(lambda: ("windsysid/T01/committed", b"20") in logger.heard)  # kept by the broker
    logger.close()
    with Publisher(mosquitto.broker, patience=0.5) as publisher:
        wait_for(lambda: publisher.connected)
        publisher.send(*blocks)
        assert not publisher.wait(1.0)  # nobody has them
        fresh = Service(MqttSource(mosquitto.broker, ["T01"]))
        assert publisher.wait(60.0)
    fresh.stop()
    assert fresh.taker.numbers() == list(range(1, 21))


def test_turbines_that_are_held_back_do_not_stall_the_others_for_good(
    mosquitto: Mosquitto, monkeypatch: pytest.MonkeyPatch
):
    """More is held back than the broker sends unacknowledged; then it is acknowledged, the newest first."""
    monkeypatch.setattr("windsysid.live.sources.mqtt.MAX_UNACKNOWLEDGED_MESSAGES", 40)
    taker = Taker()
    taker.holding = True
    service = Service(MqttSource(mosquitto.broker, ["T01", "T02"]), taker)
    wait_for(lambda: service.source.state.state == "running")
    logger = Logger(mosquitto.broker, "windsysid/+/committed")
    for k in range(1, 101):
        logger.say("windsysid/T01/blocks", encode_json(block_of(k)), Marks(k, after=k - 1 if k > 1 else None))
    for k in range(1, 11):
        logger.say("windsysid/T02/blocks", encode_json(block_of(k, "T02")))
    wait_for(lambda: len(taker.blocks) == 40)
    time.sleep(0.5)
    assert len(taker.blocks) == 40  # the broker's window is full, as it was told
    taker.holding = False
    for future in reversed(taker.held):
        future.set_result(None)
    wait_for(lambda: len(taker.blocks) == 110)
    wait_for(lambda: ("windsysid/T02/committed", b"10") in logger.heard)
    assert [block.sequence for block in taker.blocks if block.turbine == "T01"] == list(range(1, 101))
    service.stop()
    logger.close()


@pytest.mark.slow
def test_a_hundred_turbines_that_are_held_back_leave_room_for_others(mosquitto: Mosquitto):
    behind = [f"T{i:03d}" for i in range(100)]

    class Slow(Taker):
        def push(self, block):
            self.holding = block.turbine in behind
            return super().push(block)

    service = Service(MqttSource(mosquitto.broker, [*behind, "other"]), Slow())
    wait_for(lambda: service.source.state.state == "running")
    logger = Logger(mosquitto.broker, "windsysid/other/committed")
    for k in range(1, MAX_UNCOMMITTED_BLOCKS + 1):  # as many as a publisher has under way
        for turbine in behind:
            logger.say(f"windsysid/{turbine}/blocks", encode_json(block_of(k, turbine)))
        wait_for(lambda k=k: len(service.taker.blocks) == k * len(behind))
    logger.say("windsysid/other/blocks", encode_json(block_of(1, "other")))
    wait_for(lambda: logger.heard == [("windsysid/other/committed", b"1")])
    service.stop()
    logger.close()


def test_blocks_wait_at_the_broker_while_the_engine_is_busy(mosquitto: Mosquitto, monkeypatch: pytest.MonkeyPatch):
    """A message may have 2 MB, and thousands may be on their way: not all of them wait in memory."""

    class Busy(Taker):
        def push(self, block):
            free.wait()
            return super().push(block)

    free, read = threading.Event(), list[int]()
    received = StreamReader.feed_data

    def fed(reader, data):
        read.append(len(data))
        received(reader, data)

    monkeypatch.setattr(StreamReader, "feed_data", fed)
    monkeypatch.setattr("windsysid.live.sources.connection.MAX_READ_BYTES", 20_000)
    service = Service(MqttSource(mosquitto.broker, ["T01"]), Busy())
    wait_for(lambda: service.source.state.state == "running")
    logger = Logger(mosquitto.broker)
    payload = json.loads(encode_json(block_of(1)))
    for k in range(1, 1001):
        logger.say("windsysid/T01/blocks", json.dumps({**payload, "sequence": k, "start": k * SECOND}).encode())
    wait_for(lambda: sum(read) > 40_000)
    time.sleep(0.5)
    assert sum(read) < 600_000  # one read of the system's may be 256 kB
    free.set()
    wait_for(lambda: service.taker.numbers() == list(range(1, 1001)))
    service.stop()
    logger.close()


def test_nothing_is_told_committed_behind_a_block_that_is_missing(mosquitto: Mosquitto):
    service = Service(MqttSource(mosquitto.broker, ["T01"]))
    logger = Logger(mosquitto.broker, "windsysid/+/committed")
    wait_for(lambda: service.source.state.state == "running")
    marks = [Marks(0), Marks(1, after=0), Marks(3, after=2), Marks(2, after=1), Marks(3, after=2)]
    for mark in marks:
        assert mark.sequence is not None
        logger.say("windsysid/T01/blocks", encode_json(block_of(mark.sequence)), mark)
        wait_for(lambda mark=mark: mark.sequence in service.taker.numbers())
    wait_for(lambda: ("windsysid/T01/committed", b"3") in logger.heard)
    numbers = [int(payload) for _, payload in logger.heard]
    assert numbers == sorted(numbers)
    source = MqttSource(mosquitto.broker, ["T01"])
    for mark, expected in zip(marks, (0, 1, 1, 2, 3), strict=True):
        assert mark.sequence is not None
        source.took("T01", "", mark.sequence, mark.after)
        assert source.untold(everything=True) == {("T01", ""): expected}
    service.stop()
    logger.close()


def test_a_broker_that_is_killed_and_a_service_that_is_away_lose_nothing(mosquitto: Mosquitto):
    with Publisher(mosquitto.broker, patience=0.5) as publisher:
        publisher.send(*(block_of(k) for k in range(1, 51)))
        wait_for(lambda: publisher.connected)
        service = Service(MqttSource(mosquitto.broker, ["T01"]))
        wait_for(lambda: len(service.taker.blocks) > 0)
        mosquitto.kill()
        publisher.send(*(block_of(k) for k in range(51, 101)))
        mosquitto.start()
        assert publisher.wait(90.0)
        service.stop()
        publisher.send(*(block_of(k) for k in range(101, 151)))
        taker = service.taker
        service = Service(MqttSource(mosquitto.broker, ["T01"]), taker)
        assert publisher.wait(90.0)
        service.stop()
    assert taker.numbers() == list(range(1, 151))


PUBLISHER = """
import sys
from tests.live.sources.test_mqtt import block_of
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.publisher import Publisher
with Publisher(Broker(sys.argv[1]), buffer=sys.argv[2]) as publisher:
    publisher.send(*(block_of(k) for k in range(1, 31)))
    print("kept", flush=True)
    publisher.wait()
"""


def test_a_buffer_that_is_opened_again_has_its_blocks(tmp_path: Path):
    ring = Ring(tmp_path / "buffer.sqlite")
    ring.put([(Flow("T01", "a"), PackedBlock(number, b"block")) for number in (1, 2)])
    ring.close()
    assert len(Ring(tmp_path / "buffer.sqlite")) == 2


@pytest.mark.slow
def test_a_publisher_that_is_killed_goes_on_from_its_buffer(mosquitto: Mosquitto, tmp_path: Path):
    buffer = tmp_path / "buffer.sqlite"
    with subprocess.Popen(
        [sys.executable, "-c", PUBLISHER, mosquitto.url, str(buffer)], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"kept\n"
        process.kill()
    service = Service(MqttSource(mosquitto.broker, ["T01"]))
    with Publisher(mosquitto.broker, buffer=buffer, patience=0.5) as publisher:
        assert len(publisher.ring) == 30
        assert publisher.wait(60.0)
        assert publisher.send(block_of(30)) == 0
    service.stop()
    assert service.taker.numbers() == list(range(1, 31))


def test_a_broker_that_does_not_answer_is_reported_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.live.sources.connection.MAX_CONNECT_SECONDS", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with Publisher(Broker(f"mqtt://127.0.0.1:{port}")) as publisher:
            wait_for(lambda: publisher.trouble)
            assert publisher.trouble == "no connection (no answer)"


def test_a_full_buffer_drops_the_oldest_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    with Publisher(Broker(f"mqtt://127.0.0.1:{free_port()}"), most=10_000) as publisher:
        for k in range(1, 41):
            publisher.send(block_of(k))
        kept = len(publisher.ring)
        assert publisher.dropped == 40 - kept > 0
    assert f"({publisher.dropped} in all)" in caplog.text


def test_a_block_that_no_message_holds_is_refused_at_once():
    block = block_of(1)
    with Publisher(Broker(f"mqtt://127.0.0.1:{free_port()}")) as publisher:
        with pytest.raises(BlockRefused, match="send shorter blocks"):
            publisher.send(block, replace(block, sequence=2, values=np.zeros((300_000, 2), np.float32)))
        assert len(publisher.ring) == 0


@pytest.mark.skipif(shutil.which("mosquitto_passwd") is None, reason="mosquitto is not installed")
def test_users_passwords_and_tls(tmp_path: Path):
    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], cwd=tmp_path, check=True, capture_output=True)

    name = ("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1")
    openssl(
        "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", "key.pem", "-out", "cert.pem", "-days", "2", *name
    )
    subprocess.run(["mosquitto_passwd", "-c", "-b", tmp_path / "users", "site", "geheim"], check=True)
    (tmp_path / "users").chmod(0o600)
    lines = ("allow_anonymous false", f"password_file {tmp_path}/users")
    server = Mosquitto(tmp_path, f"certfile {tmp_path}/cert.pem", f"keyfile {tmp_path}/key.pem", *lines)
    broker = Broker(f"mqtts://127.0.0.1:{server.port}", "site", Secret("geheim"), tmp_path / "cert.pem")
    service = Service(MqttSource(broker, ["T01"]))
    with Publisher(broker) as publisher:
        publisher.send(block_of(1))
        assert publisher.wait(60.0)
    service.stop()
    for wrong in (
        Broker(broker.url, "site", Secret("falsch"), broker.ca),
        Broker(broker.url, "site", Secret("geheim")),  # the certificate is of no authority that is known
    ):
        lost = Service(MqttSource(wrong, ["T01"]))
        wait_for(lambda lost=lost: lost.source.state.state == "trying")
        assert "falsch" not in lost.source.state.text + lost.source.describe()
        lost.stop()
    server.kill()


def test_a_publisher_without_the_right_to_publish_says_so_and_keeps_its_blocks(tmp_path: Path):
    (tmp_path / "rights").write_text("topic read #\n")
    server = Mosquitto(tmp_path, "allow_anonymous true", f"acl_file {tmp_path}/rights")
    with Publisher(server.broker) as publisher:
        publisher.send(block_of(1))
        wait_for(lambda: publisher.trouble)
        assert publisher.trouble == "the broker refuses a message (not authorized): check the user's rights"
        assert publisher.connected
        assert len(publisher.ring) == 1
    server.kill()


def test_a_source_without_the_right_to_subscribe_says_so():
    async def refuse(_: StreamReader, writer: StreamWriter) -> None:
        writer.write(b"\x20\x03\x00\x00\x00" + SubAckPacket(1, [SubAckReasonCode.NOT_AUTHORIZED]).write())

    async def run() -> str:
        async with await asyncio.start_server(refuse, "127.0.0.1", 0) as server:
            source = MqttSource(Broker(f"mqtt://127.0.0.1:{server.sockets[0].getsockname()[1]}"), ["T01"])
            stop = asyncio.Event()
            running = asyncio.ensure_future(source.run(Taker().push, stop))
            async with asyncio.timeout(30.0):
                while not source.state.refused:
                    await asyncio.sleep(0.02)
            stop.set()
            await running
            return source.state.refusal

    assert asyncio.run(run()) == "the broker refuses a subscription (not authorized): check the user's rights"


def test_a_topic_without_its_turbine_is_refused():
    for topic in ("blocks", "a/{turbine}/#", "{turbine}/{turbine}"):
        with pytest.raises(ConfigurationError, match="one level"):
            Topics(topic)
    assert Topics("a/{turbine}/b").committed("T", "s") == "a/T/committed/s"
    assert Topics("a/{turbine}").refused("T") == "a/T/refused"


POISON = [
    b'{"sequence": 7, "start": 1767268800000000000, "rate": 1e-300, "channels": {"a": {"unit": "m", "values": [1]}}}',
    b'{"sequence": 7, "start": 1767268800000000000, "rate": 20, "channels": {"\\ud800": {"unit": "m", "values": [1]}}}',
    b'{"sequence": 7, "start": 4611686018427387903, "rate": 20, "channels": {"a": {"unit": "m", "values": [1, 2]}}}',
    b'{"sequence": 7, "start": 0, "rate": 20000, "channels": {"a\\u0000": {"unit": "m", "values": [1e308]}}}',
    b"{",
]


@pytest.mark.parametrize("poison", POISON)
def test_a_block_that_breaks_what_takes_it_stops_nothing_behind_it(mosquitto: Mosquitto, poison: bytes):
    store = open_store(":memory:")
    engine = Engine([Followed(Member(name, "tower"), window=7200.0) for name in ("T01", "T02")], store, workers=0)
    service = Service(MqttSource(mosquitto.broker, ["T01", "T02"]), SimpleNamespace(push=engine.push))  # type: ignore[arg-type]
    wait_for(lambda: service.source.state.state == "running")
    logger = Logger(mosquitto.broker, "windsysid/T01/refused")
    logger.say("windsysid/T01/blocks", poison)
    for turbine in ("T01", "T02"):
        logger.say(
            f"windsysid/{turbine}/blocks", encode_json(replace(block_of(1, turbine), start=1_767_268_800 * SECOND))
        )
    wait_for(lambda: len(list(store.waiting("T01"))) == len(list(store.waiting("T02"))) == 1)
    wait_for(lambda: len(logger.heard) == 1)
    state = service.source.state
    assert (state.state, state.blocks, state.refused) == ("running", 2, 1)
    assert json.loads(logger.heard[0][1])["reason"] == state.refusal.partition(": ")[2]
    logger.close()
    service.stop()
    engine.drain(2.0)
    store.close()
