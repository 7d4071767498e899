"""Every case of a stream has one defined result: docs/live_engine.md lists them."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tests.live.streaming import NOON, blocks_of, record
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.limits import cells_allowed
from windsysid.live.windows.timeline import SECOND, Gathered, TurbineWindows, gather
from windsysid.records.record import Record

UNTIL = NOON + 600 * SECOND


def gathered(blocks: list[Block], window: int = NOON, until: int = UNTIL) -> Gathered:
    return gather(blocks, window, until, "T01")


def same(found: Gathered, expected: Record, start: str = "2026-01-01T12:00:00Z") -> bool:
    """Bit for bit: times, values, names, units, start."""
    got = found.record
    assert got is not None
    return (
        got.time.tobytes() == expected.time.tobytes()
        and got.values.tobytes() == expected.values.tobytes()
        and (got.channels, got.units, got.start) == (expected.channels, expected.units, start)
    )


def shifted(block: Block, seconds: float) -> Block:
    return replace(block, start=block.start + round(seconds * SECOND))


@pytest.mark.parametrize("size", [1, 7, 20, 12_000, (1, 500, 33)])
@pytest.mark.parametrize("rate", [20.0, 99.9, 3.0])
def test_blocks_of_any_size_are_the_record(size, rate):
    given = record(round(600 * rate) if size != 1 else 200, rate)
    assert same(gathered(blocks_of(given, rate, size)), given)


def test_order_of_arrival_does_not_matter():
    given = record(12_000)
    blocks = blocks_of(given, 20.0, 37)
    np.random.default_rng(1).shuffle(blocks)
    assert same(gathered(blocks), given)


def test_windows_cut_a_stream_without_losing_or_doubling_a_sample():
    given = record(30_000, 33.3)
    blocks = blocks_of(given, 33.3, 50, start=NOON + 123_456_789)
    parts = []
    for window in range(NOON, NOON + 1200 * SECOND, 100 * SECOND):
        found = gathered(blocks, window, window + 100 * SECOND).record
        parts += [] if found is None else [found.values]
    assert np.array_equal(np.concatenate(parts), given.values)


def test_single_precision_is_kept():
    given = record(400)
    blocks = [replace(block, values=block.values.astype(np.float32)) for block in blocks_of(given, 20.0, 20)]
    expected = replace(given, values=given.values.astype(np.float32).astype(np.float64))
    assert same(gathered(blocks), expected)


def test_a_repeated_block_changes_nothing():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    again = replace(blocks[3], sequence=7000)
    found = gathered([*blocks, blocks[5], again])
    assert same(found, given)
    assert found.repeated == 40


def test_blocks_that_come_again_cut_otherwise_change_nothing():
    given = record(400)
    later = [replace(block, sequence=block.sequence + 100) for block in blocks_of(given, 20.0, 33)[2:6]]
    assert same(gathered([*blocks_of(given, 20.0, 20), *later]), given)


def test_a_missing_block_is_a_hole():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    found = gathered(blocks[:4] + blocks[6:])
    values = given.values.copy()
    values[80:120] = np.nan
    assert same(found, replace(given, values=values))
    assert found.missing == 40


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_samples_that_the_logger_lost_are_a_hole(lost):
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    found = gathered(
        [*blocks[:9], replace(shifted(blocks[9], lost / 20), values=blocks[9].values[lost:]), *blocks[10:]]
    )
    values = given.values.copy()
    values[180 : 180 + lost] = np.nan
    assert same(found, replace(given, values=values))
    assert found.missing == lost


def test_nan_stays_nan_and_is_filled_by_a_block_that_knows():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    holes = blocks[2].values.copy()
    holes[3:6, 1] = np.nan
    with_holes = [*blocks[:2], replace(blocks[2], values=holes), *blocks[3:]]
    found = gathered(with_holes).record
    assert found is not None
    assert np.isnan(found.values).sum() == 3
    assert same(gathered([*with_holes, replace(blocks[2], sequence=99)]), given)


def test_a_block_that_comes_again_with_gaps_takes_nothing_away():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    gaps = blocks[2].values.copy()
    gaps[3:6, 1] = np.nan
    assert same(gathered([*blocks, replace(blocks[2], values=gaps, sequence=99)]), given)


@pytest.mark.parametrize("early", [0, 20_000])
def test_a_sample_on_the_boundary_is_in_the_later_window_only(early: int):
    """Also where its stamp, which is rounded, lies some nanoseconds before."""
    given, cut = record(400), NOON + 10 * SECOND
    blocks = blocks_of(given, 20.0, 20, start=NOON - early)
    first, second = gathered(blocks, NOON, cut).record, gathered(blocks, cut, UNTIL).record
    assert first is not None
    assert second is not None
    assert np.array_equal(np.concatenate([first.values, second.values]), given.values)
    assert first.samples == 200


@pytest.mark.parametrize("seed", range(5))
def test_stamps_that_scatter_within_half_a_sample_move_nothing(seed):
    given = record(12_000)
    jitter = np.random.default_rng(seed).uniform(-0.45, 0.45, 600) / 20.0
    jitter[0] = 0.0
    blocks = [shifted(block, seconds) for block, seconds in zip(blocks_of(given, 20.0, 20), jitter, strict=True)]
    assert same(gathered(blocks, NOON - SECOND, UNTIL + SECOND), given)


@pytest.mark.parametrize("ppm", [-50, 30, 50])
@pytest.mark.parametrize("seconds", [1, 10])
def test_a_clock_that_drifts_makes_no_holes(ppm, seconds):
    given = record(59_000, 100.0)
    size = 100 * seconds
    blocks = [shifted(b, 1e-6 * ppm * seconds * b.sequence) for b in blocks_of(given, 100.0, size)]
    assert same(gathered(blocks), given)


def test_a_clock_set_forward_leaves_a_hole():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    found = gathered([*blocks[:10], *(shifted(block, 30.0) for block in blocks[10:])])
    assert found.record is not None
    assert found.record.samples == 1000
    assert found.missing == 600
    assert np.array_equal(found.record.values[800:], given.values[200:])


def test_a_clock_set_back_leaves_the_longer_piece():
    given = record(4000)
    blocks = blocks_of(given, 20.0, 20)
    found = gathered([*blocks[:50], *(shifted(block, -2.5) for block in blocks[50:])])
    assert found.record is not None
    assert np.array_equal(found.record.values, given.values[1000:])
    assert found.cut == 1000


def test_a_rate_that_changes_leaves_the_longer_piece():
    slow, fast = record(4000), record(4000, 50.0, seed=1)
    change = NOON + 200 * SECOND
    later = [replace(b, sequence=b.sequence + 200) for b in blocks_of(fast, 50.0, 50, start=change)]
    found = gathered([*blocks_of(slow, 20.0, 20), *later])
    assert same(found, slow)
    assert found.rate == 20.0
    assert found.cut == 4000


def test_channels_come_and_go():
    given = record(400)
    blocks = blocks_of(given, 20.0, 20)
    one = [replace(b, channels=b.channels[:1], units=b.units[:1], values=b.values[:, :1]) for b in blocks[5:10]]
    values = given.values.copy()
    values[100:200, 1] = np.nan
    assert same(gathered([*blocks[:5], *one, *blocks[10:]]), replace(given, values=values))


def test_two_loggers_share_the_grid_of_the_faster_one():
    tower, scada = record(2000), record(100, 1.0, seed=1)
    slow = [
        replace(b, channels=("wind_speed", "power"), units=("m/s", "W"), stream="scada")
        for b in blocks_of(scada, 1.0, 10, start=NOON + 4_000_000)
    ]
    found = gathered([*slow, *blocks_of(tower, 20.0, 20)]).record
    assert found is not None
    assert found.samples == 2000
    assert np.array_equal(found["tower_x_acceleration"], tower.values[:, 0])
    assert np.array_equal(found["power"][::20], scada.values[:, 1])
    assert np.isnan(found["power"]).sum() == 1900


def test_samples_of_a_slower_logger_are_put_at_the_nearest_moment():
    tower, scada = record(2000), record(90, 1.0, seed=1)
    late = round(0.6 * SECOND / 20.0)  # nearer to the second sample of the tower than to the first
    slow = [replace(b, channels=("a", "b"), stream="scada") for b in blocks_of(scada, 1.0, 10, start=NOON + late)]
    found = gathered([*slow, *blocks_of(tower, 20.0, 20)]).record
    assert found is not None
    assert np.array_equal(found["a"][1:1800:20], scada.values[:, 0])


def test_fewer_than_two_samples_are_no_record():
    assert gathered([]).record is None
    assert gathered(blocks_of(record(2), 20.0, 1)[:1]).record is None


def test_windows_of_turbines_end_at_different_seconds():
    starts = {TurbineWindows.of(f"T{i:02d}", 600.0).start(NOON) for i in range(50)}
    assert len(starts) > 40
    assert all(start % SECOND == 0 and NOON - 600 * SECOND < start <= NOON for start in starts)


def test_a_block_over_a_boundary_belongs_to_both_windows():
    windows = TurbineWindows(600 * SECOND)
    block = blocks_of(record(40), 20.0, 40, start=UNTIL - SECOND)[0]
    assert list(windows.of_block(block)) == [NOON, UNTIL]
    on_it = blocks_of(record(20), 20.0, 20, start=UNTIL - SECOND)[0]
    assert list(windows.of_block(on_it)) == [NOON]


def at(seconds: float, rate: float, samples: int, *, channels: int = 2, number: int = 0, stream: str = "") -> Block:
    """Noise of a logger that begins so many seconds after noon."""
    values = np.random.default_rng(number).normal(size=(samples, channels))
    names = tuple(f"c{i}" for i in range(channels))
    start = NOON + round(seconds * SECOND)
    return Block("T01", number, start, rate, names, ("m/s^2",) * channels, values, stream)


def cells(blocks: list[Block]) -> int:
    """Largest table that was made for a window of these blocks."""
    made = [0]

    def full(shape: tuple[int, int], value: float) -> np.ndarray:
        made.append(int(np.prod(shape)))
        return np.zeros(shape) + value

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "full", full)
        gathered(blocks)
    return max(made)


@pytest.mark.parametrize("channels", [1, 200])
def test_a_few_samples_far_apart_make_no_large_table(channels):
    seconds = (1, 150, 151, 300, 301, 450, 451, 598, 599)
    blocks = [at(s, 20_000.0, 2, channels=channels, number=i) for i, s in enumerate(seconds)]
    assert cells(blocks) <= cells_allowed(18 * channels)


def test_a_slow_logger_beside_a_few_fast_samples_makes_no_large_table():
    slow = [at(s, 1.0, 60, channels=200, number=s, stream="scada") for s in range(0, 600, 60)]
    fast = [at(0.0, 2000.0, 14_000, channels=1), at(599.0, 2000.0, 2, channels=1, number=1)]
    assert cells([*slow, *fast]) <= cells_allowed(600 * 200 + 14_002)
    found = gathered([*slow, *fast])
    assert found.record is not None
    assert (found.record.channels, found.cut) == (("c0",), 600)


def test_a_gap_of_nine_tenths_is_a_gap_in_a_record_of_usual_size():
    found = gathered([at(0.0, 100.0, 1000), at(500.0, 100.0, 10_000, number=1)])
    assert found.record is not None
    assert found.record.samples == 60_000
    assert (found.missing, found.cut) == (49_000, 0)


def test_behind_a_gap_that_is_too_long_for_what_came_a_new_piece_begins():
    early, late = at(0.0, 20_000.0, 200, channels=8), at(500.0, 20_000.0, 400, channels=8, number=1)
    found = gathered([early, late])
    assert found.record is not None
    assert np.array_equal(found.record.values, late.values)
    assert found.cut == 200


def test_one_fast_sample_does_not_take_the_record_of_all_others():
    given = record(2000)
    found = gathered([*blocks_of(given, 20.0, 20), at(0.0, 5000.0, 1, channels=1, stream="x")])
    assert found.record is not None
    assert np.array_equal(found.record.values[:, :2], given.values)


def test_of_more_channels_than_a_table_may_have_those_with_the_most_samples_stay():
    given = record(400)
    others = [
        replace(one, channels=tuple(f"x{i}_{k}" for k in range(200)))
        for i, one in enumerate(at(s, 20.0, 1, channels=200, number=900 + s) for s in range(10))
    ]
    found = gathered([*blocks_of(given, 20.0, 20), *others])
    assert found.record is not None
    assert len(found.record.channels) == 1000
    assert np.array_equal(found.record["tower_x_acceleration"], given.values[:, 0])


@pytest.mark.parametrize("step", [0.05, *(pytest.param(one, marks=pytest.mark.slow) for one in (-1.0, 0.0, 7.0))])
def test_many_small_blocks_take_little_time_however_they_lie(step):
    blocks = [at(300.0 + step * (k % 40), 20.0, 1, number=k) for k in range(6000)]
    begun = time.process_time()
    gathered(blocks)
    assert time.process_time() - begun < 5.0


def test_a_sample_of_which_a_channel_came_again_is_repeated_and_no_new_one():
    """A row counts as new only where none of its channels was there."""
    given = record(40)
    blocks = blocks_of(given, 20.0, 20)
    holes = blocks[1].values.copy()
    holes[:, 1] = np.nan
    first, again = replace(blocks[1], values=holes), replace(blocks[1], sequence=7)
    found = gathered([blocks[0], first, again])
    assert same(found, given)
    assert found.repeated == 20
    assert found.missing == 0
