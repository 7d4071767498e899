"""A time column without a unit is in seconds only if no other is plausible; each remedy of the refusal works."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from tests.records.formats.helpers import refused, write
from windsysid.errors import ConfigurationError
from windsysid.records.formats import iterate_record, read_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.formats.time.time_units import confirmed_unit

SECONDS = {"ms": 1e-3, "µs": 1e-6, "min": 60.0, "h": 3600.0, "d": 86_400.0}


def file_of(folder, times, header="time", name="x.csv"):
    return write(folder, f"{header},a [m]\n" + "".join(f"{t},{k % 7}\n" for k, t in enumerate(times)), name)


def mapped(path, **rule):
    return read_record(path, mapping=Mapping(time=TimeRule(**rule)))


@pytest.mark.parametrize("first", [0.0, 60.0, 44_384.5, 1_625_659_200.0])
def test_steps_that_only_seconds_explain_are_seconds(first):
    for rate in (10, 12.5, 16, 20, 25, 40, 50, 51.2, 62.5, 100, 128, 200, 256, 400, 1000, 2000, 10_000):
        for decimals in (5, 9):
            assert confirmed_unit(np.round(first + np.arange(20) / rate, decimals)) == "s", (rate, decimals)


@pytest.mark.parametrize(("unit", "decimals"), [("ms", 3), ("µs", 0), ("min", 4), ("min", 7), ("h", 8), ("d", 9)])
@pytest.mark.parametrize("first", [0.0, 17.0])
def test_no_other_unit_is_taken_for_seconds(unit, decimals, first):
    for rate in (1, 2, 4, 5, 10, 20, 25, 50, 64, 100, 128, 200, 500, 1000, 5000, 9000):
        times = np.round(first + np.arange(20) / rate / SECONDS[unit], decimals)
        with pytest.raises(ValueError, match="the time has no unit"):
            confirmed_unit(times)


@pytest.mark.parametrize("first", [0, 1, 51_234])
@pytest.mark.parametrize("step", [1, 2, 5, 10])
def test_counters_are_not_taken_for_seconds(first, step):
    with pytest.raises(ValueError, match="or a count"):
        confirmed_unit(first + step * np.arange(20.0))


def test_seconds_since_1970_are_known_by_their_size():
    assert confirmed_unit(1_625_659_200.0 + np.arange(20.0)) == "s"
    with pytest.raises(ValueError, match="no unit"):
        confirmed_unit(1_625_659_200.0 + 10.0 * np.arange(20.0))  # or 18 days in milliseconds


@pytest.mark.parametrize("name", ["x.csv", "bare.csv", "x.parquet", "x.nc", "x.h5", "x.mat"])
def test_every_format_refuses_a_counter_and_takes_unit_and_rate(tmp_path, name):
    counts, values = np.arange(40.0) + 7.0, np.arange(40.0) % 7.0
    path = tmp_path / name
    if name == "x.csv":
        file_of(tmp_path, counts)
    elif name == "bare.csv":
        np.savetxt(path, np.column_stack([counts, values]), delimiter=",")
    elif name == "x.parquet":
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
        pd.DataFrame({"time": counts, "a [m]": values}).to_parquet(path, index=False)
    elif name == "x.nc":
        made = xr.Dataset({"a": ("time", values, {"units": "m"})}, {"time": ("time", counts)})
        made.to_netcdf(path, engine="h5netcdf")
    elif name == "x.h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["time"], file["a_m"] = counts, values
    else:
        pytest.importorskip("scipy.io").savemat(path, {"t": counts, "a_m": values})
    refused(path, "the time has no unit: steps of 1 mean 1 Hz in s, 1000 Hz in ms, or a count; .*unit or rate")
    record = mapped(path, unit="ms")
    np.testing.assert_allclose(record.time, 1e-3 * counts, rtol=1e-12)
    assert len(record.channels) == 1
    if name != "x.nc":
        record = mapped(path, rate=20.0)
        np.testing.assert_allclose(record.time, np.arange(40) / 20.0, rtol=1e-12)
        assert len(record.channels) == 1


@pytest.mark.parametrize("header", ["time [s]", "Time (s)", "time_s", "t [sec]"])
def test_a_header_that_says_seconds_is_believed(tmp_path, header):
    assert read_record(file_of(tmp_path, range(9), header)).time.tolist() == [*range(9)]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("count", r"first column is 'count'.*\[time\] rate"),
        ("sample", r"first column is 'sample'.*\[time\] rate"),
        ("time [counts]", r"time is in 'counts', not in a unit of time.*count of samples \[time\] rate"),
        ("time [-]", r"not in a unit of time.*\[time\] rate"),
        ("time", r"has no unit.*\[time\] unit or rate"),
    ],
)
def test_hints_for_counters_lead_to_the_rate_which_keeps_lost_rows_as_gaps(tmp_path, header, message):
    counts = [*range(3, 40), *range(45, 60)]
    path = file_of(tmp_path, counts, header)
    refused(path, message)
    record = mapped(path, rate=50.0)
    np.testing.assert_allclose(record.time, (np.array(counts) - 3) / 50.0, atol=1e-12)
    assert record.channels == ("a",)
    pieces = list(iterate_record(path, 0.3, mapping=Mapping(time=TimeRule(rate=50.0))))
    np.testing.assert_array_equal(np.concatenate([piece.time for piece in pieces]), record.time)
    assert np.isnan(record.on_uniform_grid()["a"]).sum() == 5


def test_a_column_that_the_mapping_names_is_no_second_and_takes_the_rate(tmp_path):
    path = write(tmp_path, "a [m],tick\n" + "".join(f"{k % 7},{k}\n" for k in range(9)))
    named = TimeRule(column="tick")
    refused(path, "the time has no unit", mapping=Mapping(time=named))
    record = mapped(path, column="tick", rate=4.0)
    assert record.time[1] == 0.25
    assert record.channels == ("a",)


@pytest.mark.parametrize(("rate", "factor", "decimals"), [(200.0, 1e3, 0), (128.0, 1e3, 0), (50.0, 1 / 60, 6)])
def test_a_rate_tells_the_unit_of_times_that_are_rounded(tmp_path, rate, factor, decimals):
    times = np.round(51_234 + factor * np.delete(np.arange(400), [200, 201]) / rate, decimals)
    record = mapped(file_of(tmp_path, times), rate=rate)
    assert record.rate == pytest.approx(rate, rel=2e-3)
    assert np.isnan(record.on_uniform_grid()["a"]).sum() == 2


def test_a_rate_that_contradicts_the_unit_of_the_column_is_refused(tmp_path):
    path = file_of(tmp_path, np.arange(20) / 100.0, "time [s]")
    assert mapped(path, rate=100.0).time[-1] == 0.19
    with pytest.raises(
        ConfigurationError, match=r"time.rate is 50 Hz, but the time column has steps of 0.01 s; .*remove"
    ):
        mapped(path, rate=50.0)


def test_times_without_steps_in_the_first_rows_are_refused_and_the_rate_counts_the_rows(tmp_path):
    path = file_of(tmp_path, np.repeat(np.arange(3), 30))
    refused(path, "no unit, and its first values are all equal.*rate")
    np.testing.assert_allclose(mapped(path, rate=30.0).time, np.arange(90) / 30.0)


def test_a_rate_counts_rows_whose_dates_cannot_be_read(tmp_path):
    path = write(tmp_path, "timestamp,a [m]\n" + "".join(f"mark{k},{k % 7}\n" for k in range(9)))
    assert mapped(path, rate=4.0).time[-1] == 2.0


def test_dates_that_increase_stay_the_clock_where_a_rate_is_given(tmp_path):
    seconds = [0, 1, 2, 5, 6, 7, 8, 9]
    path = write(tmp_path, "time,a [m]\n" + "".join(f"2021-07-07 12:00:{k:02d},{k % 7}\n" for k in seconds))
    record = mapped(path, rate=1.0)
    assert record.time.tolist() == seconds
    assert record.start == "2021-07-07T12:00:00"


def test_two_steps_without_a_usual_one_are_named_by_their_median(tmp_path):
    refused(write(tmp_path, "time,a [m]\n0,1\n1,2\n10,3\n"), "steps of 5 mean 0.2 Hz in s")
