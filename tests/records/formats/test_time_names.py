"""A time column that says its unit at the end of its name."""

import numpy as np
import pytest
from scipy.io import savemat

from tests.records.formats.helpers import refused, write
from windsysid.records.formats import read_record
from windsysid.records.formats.contents.columns import Cell, find_times, is_called_time
from windsysid.records.formats.contents.mapping import Mapping, TimeRule


@pytest.mark.parametrize(
    ("name", "per_second"),
    [
        ("time_ms", 1e3), ("Time_ms", 1e3), ("TIME_MS", 1e3), ("t_us", 1e6), ("Time(ms)", 1e3), ("time [ms]", 1e3),
        ("time_ms [ms]", 1e3), ("timestamp_ns", 1e9), ("Time in ms", 1e3), ("timeMs", 1e3), ("time_min", 1 / 60),
        ("Elapsed Time (s)", 1.0), ("Time_sec", 1.0), ("t_milliseconds", 1e3), ("elapsed_us", 1e6),
    ],
)  # fmt: skip
def test_the_unit_at_the_end_of_a_times_name_is_its_unit(tmp_path, name, per_second):
    rows = "".join(f"{0.05 * k * per_second!r},{k}.5\n" for k in range(40))
    record = read_record(write(tmp_path, f"{name},a [m]\n{rows}"))
    np.testing.assert_allclose(record.time, 0.05 * np.arange(40), atol=1e-12)


def test_milliseconds_since_1970_keep_their_start(tmp_path):
    rows = "".join(f"{1_625_659_200_000 + 50 * k},{k}.5\n" for k in range(40))
    record = read_record(write(tmp_path, f"timestamp_ms,a [m]\n{rows}"))
    assert record.start == "2021-07-07T12:00:00Z"
    np.testing.assert_allclose(record.time, 0.05 * np.arange(40), atol=1e-9)


def test_a_time_with_two_units_is_refused(tmp_path):
    refused(write(tmp_path, "time_ms [s],a [m]\n0,1\n1,2\n2,3\n"), r"'time_ms \[s\]' is in ms and in s")
    refused(write(tmp_path, "time_ms,a\ns,m\n0,1\n1,2\n2,3\n"), "'time_ms' is in 's' after line 2")


@pytest.mark.parametrize("name", ["t_min", "T_d", "tms", "timer_ms", "settling_time_ms", "temperature_s"])
def test_other_names_are_no_times(name):
    assert not is_called_time(name)


@pytest.mark.parametrize("header", ["time [s],T_s [degC]", "time,T_s\ns,degC"])
def test_a_name_like_a_time_in_another_unit_is_a_channel(tmp_path, header):
    rows = "".join(f"{0.1 * k:.1f},{k}.5\n" for k in range(40))
    record = read_record(write(tmp_path, f"{header}\n{rows}"))
    assert record.channels == ("T_s",)
    assert record.unit("T_s") == "degC"


def test_a_second_time_is_a_channel_under_its_whole_name(tmp_path):
    rows = "".join(f"{0.1 * k:.1f},{100 * k},{k}.5\n" for k in range(40))
    record = read_record(write(tmp_path, f"time [s],time_ms,a [m]\n{rows}"))
    assert record.channels == ("time_ms", "a")
    np.testing.assert_allclose(record["time_ms"], record.time, atol=1e-12)


def test_a_matlab_time_says_its_unit_in_its_name(tmp_path):
    savemat(tmp_path / "x.mat", {"time_ms": 50.0 * np.arange(100), "a": np.arange(100.0)})
    np.testing.assert_allclose(read_record(tmp_path / "x.mat").time, 0.05 * np.arange(100))


def test_with_a_rate_a_first_column_with_a_unit_in_its_name_is_the_time():
    mapping = Mapping(time=TimeRule(rate=10.0))
    assert find_times([Cell("timeMs", "timeMs"), Cell("x", "x")], mapping) == (0,)
    assert find_times([Cell("x", "x"), Cell("timeMs", "timeMs")], mapping) == ()
