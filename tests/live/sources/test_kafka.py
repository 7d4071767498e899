"""The live engine on Kafka (`examples/kafka/live_on_kafka.py`): what it gives is what the engine gives with SQLite."""

import json
import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from examples.kafka.live_on_kafka import Turbines, application

from tests.conftest import identify_once
from tests.live.streaming import blocks_of, record
from windsysid.fleet import rows
from windsysid.fleet.members import Member
from windsysid.live import engine as module
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import encode_arrow
from windsysid.live.engine import Engine, Followed
from windsysid.live.store import open_store
from windsysid.results.serialization import finite


@pytest.fixture(scope="module", autouse=True)
def every_window_is_identified_once(without_effects: None) -> Iterator[None]:
    """What is compared is which windows there are, of which samples, and what is made of their results."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rows, "identify", identify_once)
        yield


TOWER = Followed(Member("T01", "tower"), window=120.0)


class State:
    """The keyed state of one turbine, as Quix Streams has it: JSON or bytes by name."""

    def __init__(self) -> None:
        self.held: dict[str, bytes] = {}

    def get(self, key: str, default: Any = None) -> Any:
        return json.loads(self.held[key]) if key in self.held else default

    def set(self, key: str, value: Any) -> None:
        self.held[key] = json.dumps(value, allow_nan=False).encode()

    def get_bytes(self, key: str) -> bytes | None:
        return self.held.get(key)

    def set_bytes(self, key: str, value: bytes) -> None:
        self.held[key] = value

    def delete(self, key: str) -> None:
        del self.held[key]


def message(turbines: Turbines, block: Block, state: State) -> list[dict[str, Any]]:
    return turbines.take(encode_arrow(block), block.turbine, 0, None, state)


def estimates(out: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    keys = ("window", "until", "row", "levels")
    return [tuple(told[key] for key in keys) for told in out if told["topic"] == "estimates"]


@pytest.fixture(scope="module")
def blocks() -> list[Block]:
    """Seven minutes; two blocks are out of order, one comes twice."""
    sent = blocks_of(record(20 * 420), 20.0, 400)
    sent[4], sent[5] = sent[5], sent[4]
    return [*sent[:9], sent[8], *sent[9:]]


@pytest.fixture(scope="module")
def expected(blocks: list[Block]) -> tuple[list[tuple[Any, ...]], tuple[int, bytes] | None]:
    """Results and the newest checkpoint of the engine with SQLite."""
    store = open_store(":memory:")
    engine = Engine([TOWER], store, workers=0)
    for block in blocks:
        engine.push(block).result()
        assert engine.wait_idle(60.0)
    known = [
        (result.window, result.until, finite(result.row), [finite(level._asdict()) for level in result.levels])
        for result in store.results("T01")
    ]
    checkpoint = store.checkpoint("T01")
    engine.drain()
    store.close()
    assert [row["status"] for _, _, row, _ in known].count("ok") >= 2
    return known, checkpoint


def after(state: State) -> tuple[int, bytes]:
    content = state.held["checkpoint"]
    return int.from_bytes(content[:8], "big"), content[8:]


@pytest.mark.slow
def test_two_processes_that_take_turns_give_what_sqlite_gives(blocks, expected):
    """The partition moves to and fro: whoever has it goes on from the state, not from what it remembers."""
    state, processes = State(), [Turbines([TOWER]), Turbines([TOWER])]
    out = [told for i, block in enumerate(blocks) for told in message(processes[i // 3 % 2], block, state)]
    assert (estimates(out), after(state)) == expected
    windows = {window for window, _ in state.get("windows")}
    assert {int(key.split()[1]) for key in state.held if key.startswith("block ")} == windows
    assert windows.isdisjoint(told["window"] for told in out if told["topic"] == "estimates")


def test_a_transaction_that_was_undone_leaves_nothing(blocks, expected):
    """The state is as before and the message comes again, to the same process."""
    state, turbines = State(), Turbines([TOWER])
    out = []
    for block in blocks:
        before = dict(state.held)
        message(turbines, block, state)
        state.held = before
        out += message(turbines, block, state)
    assert (estimates(out), after(state)) == expected


def test_an_open_alarm_moves_along_and_is_not_opened_again(blocks):
    state = State()
    ahead = replace(blocks[0], start=2**62 - 1)
    began = message(Turbines([TOWER]), ahead, state)
    assert [(told["topic"], told["kind"], told["ended"]) for told in began] == [("alarms", "data", None)]
    assert [alarm["key"] for alarm in state.get("alarms")] == [began[0]["key"]]
    assert message(Turbines([TOWER]), ahead, state) == []


def test_what_is_no_block_is_logged_and_passed_over(blocks, caplog):
    state, turbines = State(), Turbines([TOWER])
    with caplog.at_level(logging.WARNING):
        assert turbines.take(b"no block", "T01", 0, None, state) == []
        assert message(turbines, replace(blocks[0], turbine="T09"), state) == []
    assert "T01: block begins with b'no block'" in caplog.text
    assert "'T09': it is not followed" in caplog.text
    assert not state.held


@pytest.mark.parametrize(("guarantee", "machines"), [("exactly-once", 1), ("at-least-once", 2)])
def test_with_quix_streams_each_window_comes_once(guarantee: str, machines: int, monkeypatch, tmp_path: Path):
    """The mock cluster in librdkafka neither makes nor describes topics on request: it makes those asked about.

    It takes transactions and seems to forget their offsets, so that a partition moves without them here.
    """
    pytest.importorskip("quixstreams", reason="needs: pip install quixstreams")
    from confluent_kafka import Consumer, Producer
    from quixstreams.models.topics import TopicAdmin, TopicConfig

    from tests.live.test_engine import Counting

    monkeypatch.setattr(module, "estimators", lambda _: [Counting()])
    producer = Producer({"test.mock.num.brokers": 1, "bootstrap.servers": "mock"})
    broker = next(iter(producer.list_topics(timeout=30).brokers.values()))
    address = f"{broker.host}:{broker.port}"

    def inspect(_: Any, names: list[str], timeout: float = 30) -> dict[str, Any]:
        found = {name: producer.list_topics(name, timeout=timeout).topics[name] for name in names}
        keeps = {"retention.ms": "-1", "retention.bytes": "-1"}
        return {name: TopicConfig(len(topic.partitions), 1, keeps) for name, topic in found.items()}

    monkeypatch.setattr(TopicAdmin, "inspect_topics", inspect)
    hurry = {"session.timeout.ms": 6000}  # the mock cluster waits so long for a group to form
    names = ["T01", "T02"]
    sent = [block for name in names for block in blocks_of(record(20 * 420), 20.0, 400, turbine=name)]
    sent.sort(key=lambda block: block.sequence)
    expected = _windows(names, sent)
    share = len(sent) // machines
    for machine in range(machines):
        for block in sent[machine * share : (machine + 1) * share]:
            producer.produce("blocks", key=block.turbine, value=encode_arrow(block))
        assert producer.flush(30.0) == 0
        followed = [Followed(Member(name, "tower"), window=120.0) for name in names]
        options = {"state_dir": tmp_path / str(machine), "processing_guarantee": guarantee}
        application(address, followed, consumer_extra_config=hurry, **options).run(timeout=8.0)

    reader = Consumer({
        "bootstrap.servers": address, "group.id": "reader", "auto.offset.reset": "earliest",
        "isolation.level": "read_committed",
    })  # fmt: skip
    reader.subscribe(["estimates"])
    got: list[tuple[str, int, int]] = []
    while (heard := reader.poll(60.0 if len(got) < len(expected) else 3.0)) is not None:
        assert heard.error() is None, heard.error()
        told = json.loads(heard.value())
        assert heard.key().decode() == told["turbine"]
        got.append((told["turbine"], told["window"], told["row"]["samples"]))
    reader.close()
    assert sorted(got) == expected


def _windows(names: list[str], sent: list[Block]) -> list[tuple[str, int, int]]:
    """Windows that are over, and how many samples each has, as the engine with SQLite says."""
    store = open_store(":memory:")
    engine = Engine([Followed(Member(name, "tower"), window=120.0) for name in names], store, workers=0)
    for block in sent:
        engine.push(block).result()
    assert engine.wait_idle(60.0)
    engine.drain()
    found = [(one.turbine, one.window, one.row["samples"]) for name in names for one in store.results(name)]
    store.close()
    return sorted(found)
