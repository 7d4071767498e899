"""A record becomes the blocks that its logger would have sent, and they are played."""

import asyncio
import time
from concurrent.futures import Future

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, RecordError
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.sources.cutting import begin_of, blocks_of, even_rate, moment_ns
from windsysid.live.sources.replay import Replay, begin_or_now
from windsysid.records.formats import write_record
from windsysid.records.record import Record

CHANNELS, UNITS = ("tower_x_acceleration", "tower_y_acceleration"), ("m/s^2", "m/s^2")


def record_of(time: np.ndarray, start: str | None = "2026-01-05T12:00:00Z") -> Record:
    values = np.random.default_rng(7).standard_normal((len(time), 2))
    return Record(time, values, CHANNELS, UNITS, start=start)


class Taker:
    """Takes blocks in as an engine does; every so manieth is refused."""

    def __init__(self) -> None:
        self.blocks: list[Block] = []

    def push(self, block: Block) -> Future[None]:
        if np.isinf(block.rate):
            raise BlockRefused("no rate")
        self.blocks.append(block)
        future: Future[None] = Future()
        future.set_result(None)
        return future


def played(replay: Replay) -> list[Block]:
    taker = Taker()
    asyncio.run(replay.run(taker.push, asyncio.Event()))
    return taker.blocks


def test_blocks_hold_every_sample_bit_for_bit_and_start_when_it_was_taken():
    record = record_of(np.arange(1050) / 100.0)
    begin = begin_of(record)
    assert begin == 1_767_614_400_000_000_000
    blocks = list(blocks_of(record, "T01", begin, seconds=1.0))
    assert [len(block.values) for block in blocks] == [100] * 10 + [50]
    assert np.array_equal(np.concatenate([block.values for block in blocks]), record.values)
    assert [block.start for block in blocks] == [begin + k * 1_000_000_000 for k in range(11)]
    assert all(block.sequence == block.start and block.rate == 100.0 and block.turbine == "T01" for block in blocks)


def test_a_gap_ends_a_block():
    time = np.concatenate([np.arange(150), np.arange(400, 500)]) / 100.0
    blocks = list(blocks_of(record_of(time), "T01", 0, seconds=1.0))
    assert [(block.start, len(block.values)) for block in blocks] == [
        (0, 100), (1_000_000_000, 50), (4_000_000_000, 100),
    ]  # fmt: skip


def test_samples_that_are_not_evenly_spaced_are_refused():
    time = np.arange(100) / 100.0
    time[1::2] += 0.004
    with pytest.raises(RecordError, match="not evenly spaced"):
        list(blocks_of(record_of(time), "T01", 0))


@pytest.mark.parametrize("rate", [100.0, 51.2, 1.0 / 0.0195, 20.0, 100.003])
def test_the_rate_is_the_same_whatever_the_clock_of_the_file(rate: float):
    near, far = record_of(np.arange(6000) / rate), record_of(1e5 + np.round(np.arange(6000) / rate, 4))
    assert even_rate(near) == even_rate(far) == pytest.approx(rate, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1970-01-01T00:00:01.5Z", 1_500_000_000),
        ("1970-01-01T02:00:00.000000007+02:00", 7),
        ("1970-01-02 00:00Z", 86_400_000_000_000),
    ],
)
def test_moments_are_nanoseconds(text: str, expected: int):
    assert moment_ns(text) == expected


def test_a_moment_without_its_zone_is_refused():
    with pytest.raises(ConfigurationError, match="with its zone"):
        moment_ns("2026-01-05T12:00:00")


def test_a_replay_takes_every_block_in_order_from_memory_and_from_a_file(tmp_path):
    record = record_of(np.arange(3000) / 100.0)
    write_record(record, tmp_path / "a.nc")
    for source in (record, tmp_path / "a.nc"):
        blocks = played(Replay(source, "T01", speed=0.0, seconds=2.0))
        assert np.array_equal(np.concatenate([block.values for block in blocks]), record.values)
        assert blocks[0].start == begin_of(record)
        assert [block.sequence for block in blocks] == sorted({block.sequence for block in blocks})


@pytest.mark.parametrize(("speed", "earlier"), [(1.0, 0.0), (2.0, 1.5), (0.0, 3.0)])
def test_a_record_without_a_moment_is_played_as_if_it_were_measured_now(speed: float, earlier: float):
    before = time.time_ns()
    begin = begin_or_now(record_of(np.arange(300) / 100.0, None), speed)
    assert before <= begin + round(earlier * 1e9) <= time.time_ns()


def test_a_replay_is_paced_and_ends_when_it_is_told():
    async def first_blocks() -> int:
        stop, taker = asyncio.Event(), Taker()
        replay = Replay(record_of(np.arange(10_000) / 100.0), "T01", speed=50.0)
        running = asyncio.ensure_future(replay.run(taker.push, stop))
        while len(taker.blocks) < 3:
            await asyncio.sleep(0.005)
        stop.set()
        await running
        assert replay.state.state == "ended"
        return len(taker.blocks)

    assert 3 <= asyncio.run(first_blocks()) < 100


def test_a_refused_block_is_counted_and_the_rest_is_taken():
    class Refuser(Taker):
        def push(self, block: Block) -> Future[None]:
            if not self.blocks:
                self.blocks.append(block)
                raise BlockRefused("never")
            return super().push(block)

    taker, replay = Refuser(), Replay(record_of(np.arange(300) / 100.0), "T01", speed=0.0)
    asyncio.run(replay.run(taker.push, asyncio.Event()))
    assert (replay.state.blocks, replay.state.refused, replay.state.refusal) == (2, 1, "never")
