"""Records from pandas and xarray and back, and windsysid's formats as an engine of xarray."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from tests.records.formats.helpers import write
from windsysid.errors import RecordError
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.record import Record
from windsysid.records.xarray_backend import WindsysidBackend

TIME = 0.05 * np.arange(30)
VALUES = np.random.default_rng(4).standard_normal((30, 2))
HEADINGS = ["tower_x_acceleration [g]", "column_2"]


def frame(index=None, columns=None):
    return pd.DataFrame(VALUES, index=pd.Index(TIME) if index is None else index, columns=columns or HEADINGS)


def test_a_frame_gives_values_units_and_times_bit_for_bit():
    record = Record.from_dataframe(frame())
    assert record.time.tobytes() == TIME.tobytes()
    assert record["tower_x_acceleration"].tobytes() == (VALUES[:, 0] * 9.80665).tobytes()
    assert record.units == ("m/s^2", "as written: unknown")
    assert record.start is None


@pytest.mark.parametrize(
    ("zone", "start"),
    [
        (None, "2021-07-07T12:00:00.250"), ("UTC", "2021-07-07T12:00:00.250Z"),
        ("Europe/Stockholm", "2021-07-07T12:00:00.250+02:00"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("as_column", [False, True])
def test_dates_give_the_start_with_the_zone_that_they_have(zone, start, as_column):
    dates = pd.DatetimeIndex(pd.Timestamp("2021-07-07T12:00:00.25", tz=zone) + pd.to_timedelta(TIME, unit="s"))
    given = frame(dates)
    if as_column:
        given = given.reset_index(names="time")
    record = Record.from_dataframe(given)
    np.testing.assert_allclose(record.time, TIME, atol=1e-9)
    assert record.start == start


def test_dates_keep_their_distance_where_clocks_are_changed():
    dates = pd.date_range("2021-10-31T00:00", periods=30, freq="15min", tz="UTC").tz_convert("Europe/Stockholm")
    np.testing.assert_array_equal(Record.from_dataframe(frame(dates)).time, 900.0 * np.arange(30))


def test_units_may_stand_in_the_attributes_and_the_time_in_milliseconds():
    given = frame(pd.Index(1000.0 * TIME, name="t [ms]"), ["tower_x_acceleration", "column_2"])
    given.attrs = {"units": {"tower_x_acceleration": "mg"}, "site": "hill", "start_time": "2021-07-07T12:00:00Z"}
    record = Record.from_dataframe(given)
    np.testing.assert_allclose(record.time, TIME, atol=1e-12)
    assert record["tower_x_acceleration"].tobytes() == (VALUES[:, 0] * (9.80665 * 1e-3)).tobytes()
    assert (record.attributes, record.start) == ({"site": "hill"}, "2021-07-07T12:00:00Z")


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (frame(columns=["rotor_speed", "b [m]"]), r"'rotor_speed' has no unit.*call the column"),
        (frame(columns=["a [m]", "a [kN]"]), "column 'a' is there twice"),
        (frame(columns=["a [m]", "b [furlong]"]), "unknown unit 'furlong'"),
        (frame(pd.Index(["x"] * 30)), "expected seconds or dates"),
        (frame(pd.DatetimeIndex([pd.NaT] * 30)), "expected a date in every row"),
        (frame().assign(**{"c [m]": "x"}), "'c': expected numbers"),
        (frame(pd.Index(TIME, name="t [m]")), "expected s, got m"),
        (frame(pd.Index(TIME[::-1])), "the time runs backwards"),
    ],
)  # fmt: skip
def test_a_frame_that_is_no_record_is_refused(given, complaint):
    with pytest.raises(RecordError, match=complaint):
        Record.from_dataframe(given)


def test_a_dataset_with_dates_is_a_record_with_a_start():
    dates = np.datetime64("2021-07-07T12:00:00") + (TIME * 1e9).astype("timedelta64[ns]")
    dataset = xr.Dataset({"a": ("time", VALUES[:, 0], {"units": "kN"})}, coords={"time": dates})
    record = Record.from_xarray(dataset)
    assert record.start == "2021-07-07T12:00:00"
    np.testing.assert_allclose(record.time, TIME, atol=1e-9)


def test_xarray_reads_what_windsysid_reads(tmp_path):
    path = write(tmp_path, "a [m],b [kN]\n" + "".join(f"{x:.3f},{y:.3f}\n" for x, y in VALUES))
    mapping = Mapping(time=TimeRule(rate=20.0, start="2021-07-07T12:00:00Z"))
    dataset = xr.open_dataset(path, engine=WindsysidBackend, mapping=mapping, drop_variables="a")
    assert list(dataset) == ["b"]
    assert dataset["b"].attrs["units"] == "N"
    assert Record.from_xarray(dataset).start == "2021-07-07T12:00:00Z"
    part = xr.open_dataset(path, engine=WindsysidBackend, mapping=mapping, section=(0.5, 1.0))
    assert part.sizes["time"] == 10


def test_the_engine_offers_itself_for_files_that_no_other_reads():
    engine = WindsysidBackend()
    assert all(map(engine.guess_can_open, ("x.tdms", Path("x.MF4"), "x.csv", "x.%04", "x.outb")))
    assert not any(map(engine.guess_can_open, ("x.nc", "x.h5", "x.zarr", b"bytes")))


def test_the_package_declares_the_engine():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    declared = tomllib.loads(text)["project"]["entry-points"]["xarray.backends"]["windsysid"]
    assert declared == f"{WindsysidBackend.__module__}:{WindsysidBackend.__name__}"
