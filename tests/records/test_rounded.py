"""Time stamps with few digits: the rate is that of the rows, and not that of the digits."""

import numpy as np
import pytest

from tests.records.formats.helpers import write
from windsysid.records.formats import read_record
from windsysid.records.rounded import rounded_grid

RATES = [
    (64.0, 2), (62.5, 2), (60.0, 2), (66.6667, 2), (75.0, 2), (80.0, 2), (8.0, 1), (6.4, 1), (7.5, 1), (750.0, 3),
    (512.0, 3), (15.0, 1), (128.0, 1), (19.97, 1), (30.3, 1),
]  # fmt: skip


def written(time, decimals, cut):
    return np.floor(time * 10**decimals + 1e-9) / 10**decimals if cut else np.round(time, decimals)


@pytest.mark.parametrize(("rate", "decimals"), RATES)
@pytest.mark.parametrize("cut", [False, True])
def test_stamps_with_few_digits_have_the_rate_of_their_rows(rate, decimals, cut):
    time = np.arange(int(100 * rate)) / rate
    grid = rounded_grid(written(time, decimals, cut))
    assert grid is not None
    assert grid.step == pytest.approx(1.0 / rate, rel=1e-4)
    assert grid.begin == 0.0
    np.testing.assert_array_equal(grid.places, np.arange(len(time)))


@pytest.mark.parametrize(("rate", "decimals"), [(64.0, 2), (8.0, 1), (62.5, 2), (750.0, 3)])
@pytest.mark.parametrize("lost", [[200], [3, 700], slice(300, 340)])
def test_lost_rows_stay_gaps_where_stamps_have_few_digits(rate, decimals, lost):
    rows = np.delete(np.arange(2000), lost)
    grid = rounded_grid(np.round(rows / rate, decimals))
    assert grid is not None
    np.testing.assert_array_equal(grid.places, rows)


@pytest.mark.parametrize(("unit", "decimals", "rate"), [(86_400.0, 6, 20.0), (3600.0, 5, 20.0), (60.0, 3, 20.0)])
def test_days_hours_and_minutes_with_few_digits(unit, decimals, rate):
    grid = rounded_grid(np.round(np.arange(12_000) / rate / unit, decimals) * unit)
    assert grid is not None
    assert grid.step == pytest.approx(1.0 / rate, rel=1e-5)
    assert grid.places[-1] == 11_999


def test_stamps_that_scatter_by_more_than_their_digits_are_left():
    rng = np.random.default_rng(1)
    assert rounded_grid(np.round(np.arange(2000) / 50 + 0.004 * rng.standard_normal(2000), 3)) is None
    assert rounded_grid(np.arange(2000) / 50.0) is None
    assert rounded_grid(np.delete(np.arange(2000), [7, 900]) / 50.0) is None
    assert rounded_grid(np.delete(np.arange(2000), 900) / 100.0) is None
    assert rounded_grid(np.delete(np.arange(2000), slice(6, None, 7)) / 20.0) is None


def file_of(folder, stamps, values, head="time [s]"):
    lines = "".join(f"{s},{x:.6f}\n" for s, x in zip(stamps, values, strict=True))
    return write(folder, head + ",tower_x_acceleration [m/s^2]\n" + lines)


def motion(time):
    return np.sin(2 * np.pi * 0.36 * time) + 0.02 * np.random.default_rng(3).standard_normal(len(time))


@pytest.mark.parametrize(
    ("rate", "unit", "head", "decimals"),
    [(8.0, 1.0, "time [s]", 1), (64.0, 1.0, "time [s]", 2), (20.0, 3600.0, "time [h]", 5), (128.0, 1.0, "time [s]", 1),
     (15.0, 1.0, "time [s]", 1), (20.0, 86_400.0, "time [d]", 6)],
)  # fmt: skip
def test_a_file_with_few_digits_is_read_at_its_own_rate_and_a_note_says_so(tmp_path, rate, unit, head, decimals):
    time = np.arange(int(200 * rate)) / rate
    stamps = [f"{45_000.0 * (unit > 1e4) + one / unit:.{decimals}f}" for one in time]
    record = read_record(file_of(tmp_path, stamps, motion(time), head))
    assert record.is_uniform
    assert record.rate == pytest.approx(rate, rel=1e-4)
    assert "placed on a regular grid" in record.attributes["time_stamps"]
    assert "with 0 lost" in record.attributes["time_stamps"]


def test_rows_that_were_lost_one_in_five_stay_lost_where_readings_are_smoother_at_their_stamps(tmp_path):
    time = np.delete(np.arange(3000), slice(4, None, 5)) / 10.0  # also 8 Hz, cut to tenths
    values = np.sin(2 * np.pi * 0.36 * time) + 1e-3 * np.random.default_rng(3).standard_normal(len(time))
    record = read_record(file_of(tmp_path, [f"{one:.1f}" for one in time], values))
    np.testing.assert_allclose(record.time, time)
