"""Which blocks a turbine's follower knows, and up to which number a publisher may forget its own."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.live.streaming import NOON, blocks_of, record
from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.follower import Followed, Follower, Placed
from windsysid.live.watch.watching import WatchOptions, start
from windsysid.live.windows.timeline import SECOND, TurbineWindows

START = TurbineWindows.of("T01", 60.0).start(NOON)
JUMP = 300 * SECOND


@pytest.fixture
def follower() -> Follower:
    return Follower(Followed(Member("T01", "tower"), window=60.0), "", start("T01", WatchOptions(60.0)))


def blocks(count: int, *, first: int = 0) -> list[Block]:
    """One block a second, numbered from `first`."""
    given = blocks_of(record(count * 20), 20.0, 20, start=START)
    return [replace(block, sequence=first + block.sequence) for block in given]


def placed(follower: Follower, given: Sequence[Block]) -> list[Placed]:
    return [follower.place(block, JUMP) for block in given]


def committed(follower: Follower) -> int | None:
    return follower.status().sequences.get("")


def test_a_block_that_was_forgotten_is_new_when_it_comes_again(follower):
    given = blocks(5, first=100)
    before = placed(follower, given)
    assert committed(follower) == 104
    follower.forget(given[2], before[2])
    assert committed(follower) == 101
    assert follower.place(given[1], JUMP).arrival == "repeated"
    assert follower.place(given[2], JUMP) == before[2]
    assert follower.place(given[2], JUMP).arrival == "repeated"
    assert committed(follower) == 104


def test_to_forget_a_block_behind_a_gap_leaves_what_is_committed(follower):
    given = blocks(5, first=100)
    before = placed(follower, [*given[:2], given[4]])
    assert committed(follower) == 101
    follower.forget(given[4], before[2])
    assert committed(follower) == 101


def test_a_block_of_two_windows_is_forgotten_in_both(follower):
    block = replace(blocks(1, first=7)[0], start=START + 59 * SECOND + SECOND // 2)
    before = follower.place(block, JUMP)
    assert before.windows == (START, START + 60 * SECOND)
    follower.forget(block, before)
    assert [numbers for window in follower.open.values() for numbers in window.values()] == [set(), set()]


def test_to_forget_a_block_that_is_known_by_its_start_moves_no_number(follower):
    by_start = [replace(block, sequence=block.start) for block in blocks(3)]
    before = placed(follower, by_start)
    told = committed(follower)
    follower.forget(by_start[1], before[1])
    assert committed(follower) == told
    assert follower.place(by_start[1], JUMP).arrival == "new"


def test_a_logger_that_counts_anew_is_acknowledged_by_its_own_numbers(follower):
    placed(follower, blocks(3, first=50))
    again = [replace(block, sequence=50 + i) for i, block in enumerate(blocks(9)[5:7])]
    assert [one.sequence for one in placed(follower, again)] == [block.start for block in again]
    assert committed(follower) == 51


def test_a_closed_window_gives_up_what_is_missing_in_it(follower):
    given = blocks(8, first=20)
    placed(follower, [given[0], given[3]])
    assert committed(follower) == 20
    follower.close(START, NOON)
    assert committed(follower) == 23
    for sequence, arrival in ((21, "repeated"), (23, "repeated"), (24, "too late")):
        assert follower.place(replace(given[1], sequence=sequence), JUMP).arrival == arrival


def test_a_closed_window_of_blocks_that_were_all_forgotten_moves_no_number(follower):
    given = blocks(2, first=20)
    before = placed(follower, given)
    for block, one in zip(given, before, strict=True):
        follower.forget(block, one)
    follower.close(START, NOON)
    assert committed(follower) == 19


def test_a_refused_block_takes_no_place_among_the_loggers(follower):
    wide = replace(blocks(1)[0], values=np.zeros((200_000, 2)))
    for k in range(20):
        with pytest.raises(BlockRefused, match="no longer than a window"):
            follower.place(replace(wide, stream=f"s{k}"), JUMP)
    assert follower.streams == {}


def far(seconds: float, rate: float = 20_000.0, channels: int = 200, number: int = 0) -> Block:
    names = tuple(f"c{i}" for i in range(channels))
    at = START + round(seconds * SECOND)
    return Block("T01", number, at, rate, names, ("m",) * channels, np.zeros((2, channels)))


def test_a_block_that_makes_the_table_of_a_window_far_larger_than_what_came_is_refused(follower):
    follower.place(far(0.0), JUMP)
    said = r"block of 2 samples makes the window's table 59\.9 s at 20000 Hz × 200 channels: expected"
    with pytest.raises(BlockRefused, match=said) as refused:
        follower.place(far(59.9, number=1), JUMP)
    assert len(str(refused.value)) <= 160
    assert follower.place(far(0.5, number=1), JUMP).arrival == "new"


@pytest.mark.parametrize("one", [far(1.0, channels=200, rate=20.0), far(1.0, channels=1), far(1.0)])
def test_one_wide_or_fast_block_leaves_room_for_those_behind_it(follower, one):
    follower.place(one, JUMP)
    assert {one.arrival for one in placed(follower, blocks(60, first=1))} == {"new"}


@pytest.mark.parametrize(("channels", "gap"), [(60, 1), (60, 300), (60, 598), (200, 1), (200, 400)])
def test_a_gap_is_no_reason_to_refuse_a_logger_that_may_still_send_enough(channels, gap):
    usual = Follower(Followed(Member("T01", "tower"), window=600.0), "", start("T01", WatchOptions(600.0)))
    begin = usual.windows.start(NOON)
    make: Callable[[int], Block] = lambda second: Block(  # noqa: E731
        "T01", second, begin + second * SECOND, 100.0, tuple(f"c{i}" for i in range(channels)), ("m",) * channels,
        np.zeros((100, channels)),
    )  # fmt: skip
    assert {usual.place(make(second), JUMP).arrival for second in (0, *range(gap, 600, 7))} == {"new"}
