"""Rows that share a time stamp: no reading is lost, none is aliased, and lost rows stay gaps."""

import numpy as np
import pytest
from scipy.signal import periodogram

from tests.records.formats.helpers import refused, write
from windsysid.inspection import inspect_record
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.packets import is_even, place_packets

RATE, ROWS = 100.0, 6000


def regular(rate=RATE, rows=ROWS):
    return np.arange(rows) / rate


def stamps_of(time, size, scatter=0.0, seed=0):
    """Each reading with the time of the first of its packet, which scatters by a share of the packet's duration."""
    packet = np.arange(len(time)) // size
    off = scatter * size * (time[1] - time[0]) * np.random.default_rng(seed).uniform(-1, 1, packet[-1] + 1)
    return np.maximum.accumulate(time[size * packet] + off[packet])


def is_placed_as(placed, time, rate=RATE):
    """All rows have their place on the grid: the same number of steps after the first row."""
    assert placed is not None
    assert placed.step == pytest.approx(1.0 / rate, rel=1e-3)
    np.testing.assert_array_equal(
        np.rint((placed.time - placed.time[0]) / placed.step), np.rint((time - time[0]) * rate)
    )
    assert placed.lost == round((time[-1] - time[0]) * rate) + 1 - len(time)


@pytest.mark.parametrize("size", [2, 3, 5, 20])
@pytest.mark.parametrize("scatter", [0.0, 0.1, 0.4, 1.0])
def test_packets_of_one_size_are_spread_evenly_though_their_stamps_scatter(size, scatter):
    is_placed_as(place_packets(stamps_of(regular(), size, scatter)), regular())


@pytest.mark.parametrize("scatter", [0.0, 0.3])
def test_lost_packets_stay_gaps(scatter):
    kept = np.ones(ROWS, dtype=bool)
    for packet in (3, 100, 101, 500, 900, 901, 902):
        kept[5 * packet : 5 * packet + 5] = False
    is_placed_as(place_packets(stamps_of(regular(), 5, scatter)[kept]), regular()[kept])


def test_rows_that_a_packet_lost_are_missing_in_that_packet():
    kept = np.ones(ROWS, dtype=bool)
    kept[[504, 2004]] = False
    is_placed_as(place_packets(stamps_of(regular(), 5)[kept]), regular()[kept])


@pytest.mark.parametrize(("rate", "decimals"), [(128.0, 2), (200.0, 2), (333.0, 2), (1000.0, 2), (20.0, 0), (33.3, 0)])
@pytest.mark.parametrize("gap", [None, (2000, 2700), (4000, 4050)])
def test_times_with_few_digits_are_put_right_with_their_gaps(rate, decimals, gap):
    time = 0.37 + regular(rate, 20_000)
    kept = np.ones(len(time), dtype=bool)
    if gap:
        kept[slice(*gap)] = False
    if gap and decimals == 0:  # a gap that begins inside a second is known to the second
        kept[slice(*(int(np.searchsorted(time, np.rint(time[k]))) for k in gap))] = False
        kept[gap[0] : int(np.searchsorted(time, np.rint(time[gap[0]])))] = True
        kept[int(np.searchsorted(time, np.rint(time[gap[1]]))) : gap[1]] = True
    cut = float(10**decimals)
    is_placed_as(place_packets(np.floor(time * cut)[kept] / cut), time[kept], rate)


def test_stamps_of_a_busy_computer_are_counted():
    time, rng = regular(), np.random.default_rng(4)
    late = np.maximum.accumulate(time + 0.001 * rng.random(ROWS) + 0.08 * (rng.random(ROWS) < 0.02))
    is_placed_as(place_packets(np.asarray(np.round(late, 3), dtype=np.float64)), time)


@pytest.mark.parametrize("seed", range(3))
def test_stamps_that_show_no_grid_are_left(seed):
    rng = np.random.default_rng(seed)
    assert place_packets(np.array([0.0, 0.0, 1.0])) is None
    assert place_packets(regular()) is None
    assert place_packets(np.sort(rng.choice(regular(), ROWS))) is None
    assert place_packets(np.cumsum(rng.choice([0.0, 0.01, 0.5], ROWS))) is None
    assert place_packets(np.cumsum(rng.choice([0.0, 0.01, -0.01], ROWS))) is None
    twice = np.sort(np.concatenate([regular(), rng.choice(regular(), ROWS // 20, replace=False)]))
    assert place_packets(twice) is None  # some rows have been written twice


def test_readings_in_bursts_of_two_loggers_or_written_twice_are_not_even():
    rng = np.random.default_rng(5)
    time = np.repeat(regular(RATE, ROWS // 2), 2)
    motion = np.cumsum(rng.standard_normal((ROWS, 2)), axis=0)
    assert is_even(time, motion)
    assert is_even(time, np.mod(0.2 * np.arange(ROWS), 2 * np.pi)[:, None])
    assert not is_even(time, np.repeat(motion[::2], 2, axis=0) + 1e-3 * rng.standard_normal((ROWS, 2)))
    assert not is_even(time, motion + 30.0 * (np.arange(ROWS) % 2)[:, None])


def packets_file(folder, stamps, name="x.csv", seed=2):
    rng = np.random.default_rng(seed)
    t = regular(rows=len(stamps))
    a = np.sin(2 * np.pi * 1.2 * t) + np.sin(2 * np.pi * 21.0 * t) + 0.05 * rng.standard_normal(len(t))
    lines = "".join(f"{s},{x:.6f}\n" for s, x in zip(stamps, a, strict=True))
    return write(folder, "time [s],tower_x_acceleration [m/s^2]\n" + lines, name), np.round(a, 6)


def test_a_mode_keeps_its_frequency_and_the_result_says_what_was_done(tmp_path):
    path, values = packets_file(tmp_path, np.round(stamps_of(regular(), 3), 3))
    record = read_record(path)
    np.testing.assert_array_equal(record["tower_x_acceleration"], values)
    np.testing.assert_allclose(record.time, regular(), atol=1e-9)
    f, power = periodogram(record["tower_x_acceleration"], record.rate)
    assert f[np.argmax(np.where(f > 5.0, power, 0.0))] == pytest.approx(21.0, abs=0.02)
    (found,) = [one for one in inspect_record(record).findings if one.kind == "shared time stamps"]
    assert found.severity == "note"
    assert found.text.startswith(
        "4000 of 6000 rows have the time stamp of the row before; rows were placed on a regular grid of 100 Hz"
    )


def test_sections_and_pieces_have_the_times_of_the_whole(tmp_path):
    path, _ = packets_file(tmp_path, np.round(stamps_of(regular(), 4, 0.2), 3))
    whole = read_record(path)
    part = read_record(path, section=(10.0, 20.0))
    np.testing.assert_array_equal(part.time, whole.section(10.0, 20.0).time)
    pieces = list(iterate_record(path, 7.0))
    np.testing.assert_array_equal(np.concatenate([piece.time for piece in pieces]), whole.time)
    assert all("on a regular grid" in piece.attributes["time_stamps"] for piece in pieces)


def test_dates_of_whole_seconds_are_packets(tmp_path):
    seconds = np.floor(0.3 + regular(20.0, 1000)).astype(int)
    lines = [f"2024-01-13 12:{s // 60:02d}:{s % 60:02d},{k % 7}" for k, s in enumerate(seconds)]
    record = read_record(write(tmp_path, "time,a [m]\n" + "\n".join(lines) + "\n"))
    np.testing.assert_allclose(np.diff(record.time), 0.05, rtol=1e-9)
    assert record.start == "2024-01-13T12:00:00"
    assert record.time[0] == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("where", [10, 3000])
def test_a_row_that_is_there_twice_is_refused_and_both_remedies_work(tmp_path, where):
    stamps = np.insert(np.round(regular(), 2), where, round(where / RATE, 2))
    path, _ = packets_file(tmp_path, stamps)
    refused(path, rf"time is repeated at line {where + 3} .*\[time\] rate = .*written twice, delete it")
    record = read_record(path, mapping=Mapping(time=TimeRule(rate=100.0)))
    np.testing.assert_allclose(record.time, regular(rows=ROWS + 1), rtol=1e-12)
    rows = path.read_text().splitlines(keepends=True)
    del rows[where + 1]
    assert read_record(write(tmp_path, "".join(rows), "once.csv")).samples == ROWS


def test_rows_out_of_order_are_refused_and_sorting_them_works(tmp_path):
    path, _ = packets_file(tmp_path, np.round(regular(), 2))
    rows = path.read_text().splitlines(keepends=True)
    rows[50:53] = rows[52], rows[50], rows[51]
    refused(write(tmp_path, "".join(rows), "mixed.csv"), "runs backwards at line 52 .*sort the rows")
    rows[1:] = sorted(rows[1:], key=lambda row: float(row.split(",")[0]))
    assert read_record(write(tmp_path, "".join(rows), "sorted.csv")).samples == ROWS


@pytest.mark.parametrize("header", ["time [s]", "time", "time [ms]"])
def test_rows_that_were_lost_from_a_regular_record_are_gaps(tmp_path, header):
    kept = np.delete(np.arange(400), [7, 100, 101, 102, 350])
    scale = 1e3 if "ms" in header else 1.0
    lines = "".join(f"{scale * k / 50.0:.3f},{k % 7}\n" for k in kept)
    record = read_record(write(tmp_path, f"{header},a [m]\n" + lines)).on_uniform_grid()
    assert record.samples == 400
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(record["a"])), [7, 100, 101, 102, 350])


def test_one_row_in_ten_that_is_lost_is_a_gap_and_moves_no_frequency(tmp_path):
    kept = np.random.default_rng(6).random(ROWS) > 0.1
    kept[0] = kept[-1] = True
    lines = "".join(f"{k / RATE:.2f},{k % 7}\n" for k in np.flatnonzero(kept))
    record = read_record(write(tmp_path, "time,a [m]\n" + lines)).on_uniform_grid()
    assert record.samples == ROWS
    np.testing.assert_array_equal(np.isnan(record["a"]), ~kept)


@pytest.mark.parametrize("size", [10, 20])
@pytest.mark.parametrize("share", [0.02, 0.05])
def test_rows_lost_one_by_one_inside_packets_are_refused(tmp_path, size, share):
    time = regular(20.0, 12_000)
    kept = np.random.default_rng(7).random(len(time)) > share
    stamps = stamps_of(time, size)[kept]
    refused(packets_file(tmp_path, stamps)[0], "rows were lost among rows that share a time stamp .*more digits")


def test_packets_of_many_sizes_whose_stamps_follow_them_lose_nothing():
    sizes = 1 + np.random.default_rng(8).poisson(4.0, 2000)
    stamps = np.repeat(np.cumsum(sizes) / 20.0, sizes)
    is_placed_as(place_packets(stamps), regular(20.0, len(stamps)), 20.0)


@pytest.mark.parametrize(("kept", "rate"), [(np.arange(6000) % 20 > 0, 100.0), (np.ones(6000, dtype=bool), 80.0)])
def test_a_rate_that_contradicts_the_span_of_the_stamps_is_refused(tmp_path, kept, rate):
    seconds = np.floor(regular())
    jitter = np.sort(regular() + 0.02 * np.random.default_rng(3).random(6000))
    for k, stamps in enumerate((seconds, jitter)):
        path, _ = packets_file(tmp_path, stamps[kept], f"{k}.csv")
        mapping = Mapping(time=TimeRule(rate=rate))
        refused(path, r"rows at \[time\] rate = \d+ Hz take [\d.]+ s, but .* span [\d.]+ s", mapping=mapping)


def test_a_rate_that_fits_the_span_of_rounded_stamps_is_taken(tmp_path):
    stamps = np.round(regular(8.0), 1)
    path, _ = packets_file(tmp_path, stamps)
    record = read_record(path, mapping=Mapping(time=TimeRule(rate=8.0)))
    np.testing.assert_allclose(record.time, regular(8.0), atol=1e-4)


def test_rows_that_are_written_twice_are_to_be_dropped_and_no_rate_is_advised(tmp_path):
    twice = np.sort(np.concatenate([np.arange(6000), np.arange(0, 6000, 7)]))
    values = np.random.default_rng(4).standard_normal(6000)
    rows = "".join(f"{k / 20},{values[k]:.6f}\n" for k in twice)
    path = write(tmp_path, "time [s],a [m/s^2]\n" + rows)
    refused(path, "time is repeated at line 3 .*; drop the rows that were written twice")
    refused(path, r"rate = 20 Hz take 342.9 s.*written twice", mapping=Mapping(time=TimeRule(rate=20.0)))
