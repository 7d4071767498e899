"""`windsysid publish` sends records and what a logger says, and says what became of them."""

import io
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.live.sources.conftest import Service
from tests.live.sources.servers import Mosquitto
from windsysid.live.blocks.codec import encode_json
from windsysid.live.sources.cutting import blocks_of
from windsysid.live.sources.mqtt import MqttSource
from windsysid.live.sources.publisher import _Sending
from windsysid.records.formats import write_record
from windsysid.records.record import Record

CHANNELS, UNITS = ("tower_x_acceleration", "tower_y_acceleration"), ("m/s^2", "m/s^2")


def record_of(minute: int, start: bool = True) -> Record:
    values = np.random.default_rng(minute).standard_normal((1000, 2))
    moment = f"2026-01-05T12:{minute:02d}:00Z" if start else None
    return Record(np.arange(1000) / 20.0, values, CHANNELS, UNITS, start=moment)


def test_records_may_be_sent_again_by_another_publisher(mosquitto: Mosquitto, tmp_path: Path, run):
    service = Service(MqttSource(mosquitto.broker, ["T01"]))
    for minute in range(2):
        write_record(record_of(minute), tmp_path / f"{minute}.nc")
    words = ("publish", tmp_path / "0.nc", tmp_path / "1.nc", "--turbine", "T01", "--broker", mosquitto.url)
    first = run(*words, "--speed", 0, "--block", "10 s", "--buffer", tmp_path / "buffer")
    assert (first.code, first.out, first.err) == (0, "T01: 10 blocks committed\n", [])
    again = run(*words, "--speed", 0, "--block", "10 s")
    assert again.code == 0  # it may hear meanwhile that they are committed
    third = run(*words, "--speed", 0, "--block", "10 s", "--buffer", tmp_path / "buffer")
    assert third.out == "T01: 0 blocks committed; 10 were sent before\n"
    service.stop()
    blocks = {block.start: block.values for block in service.taker.blocks}
    values = np.concatenate([blocks[start] for start in sorted(blocks)])
    assert np.array_equal(values, np.concatenate([record_of(0).values, record_of(1).values]))


def test_a_loggers_lines_are_sent_and_one_that_is_no_block_is_said(mosquitto: Mosquitto, run, monkeypatch):
    service = Service(MqttSource(mosquitto.broker, ["T01"]))
    blocks = list(blocks_of(record_of(0), "T01", 0, seconds=10.0))
    lines = b"\n".join([*(encode_json(block) for block in blocks), b"nonsense", b""])
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(lines)))
    ended = run("publish", "-", "--turbine", "T01", "--broker", mosquitto.url, "--stream", "tower")
    assert (ended.code, ended.out) == (0, "T01: 5 blocks committed\n")
    assert len(ended.err) == 1
    assert ended.err[0].startswith("windsysid: line 6 was not sent: block begins with")
    service.stop()
    assert {block.stream for block in service.taker.blocks} == {"tower"}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("a.csv", "--broker", "mqtt://localhost"), "a.csv: no start time with its zone: give --start"),
        (("a.csv", "--broker", "http://localhost"), "broker: expected a URL that begins with mqtt:// or mqtts://"),
        (("a.csv", "--broker", "mqtt://me:secret@localhost"), "take it out, and give it by --password-file"),
        (("a.csv", "-", "--broker", "mqtt://localhost"), "RECORD: expected - alone or files"),
        (("a.csv", "--broker", "mqtt://localhost", "--block", "0 s"), "--block: expected above 0 s to 10 min"),
        (("none.csv", "--broker", "mqtt://localhost"), "none.csv"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(words, line, tmp_path: Path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_record(record_of(0, start=False), tmp_path / "a.csv")
    ended = run("publish", *words, "--turbine", "T01")
    assert ended.code == 2
    assert len(ended.err) == 1
    assert line in ended.err[0]
    assert "secret" not in ended.err[0]


def test_blocks_under_way_are_counted_over_all_flows():
    under_way = Counter[str]()
    first, second = (_Sending(1.0, under_way) for _ in range(2))
    for number in (1, 2, 3):
        first.add(number)
    second.add(7)
    assert under_way["blocks"] == 4
    first.commit(1)
    second.drop(7)
    second.drop(8)
    assert under_way["blocks"] == len(first.sent) == 2
    first.go_back(1)
    assert under_way["blocks"] == 0
