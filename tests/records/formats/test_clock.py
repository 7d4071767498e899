import numpy as np
import pytest
import xarray as xr

from tests.records.formats.helpers import refused, write
from windsysid.errors import RecordError, WindsysidError
from windsysid.records.formats import read_record, write_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.moments import in_words
from windsysid.records.record import Record


def of(folder, cells, header="time", mapping=None):
    content = f"{header};a [m]\n" + "".join(f"{cell};{k}\n" for k, cell in enumerate(cells))
    options = {"mapping": write(folder, mapping, "m.toml")} if mapping else {}
    return read_record(write(folder, content), **options)


@pytest.mark.parametrize(
    ("cells", "header", "mapping", "start"),
    [
        (["2021-07-07T12:00:00Z", "2021-07-07T12:00:00.5Z", "2021-07-07T12:00:01Z"], "time", None,
        "2021-07-07T12:00:00Z"),
        (["2021-07-07 12:00:00+02:00", "2021-07-07 12:00:00.5+02:00", "2021-07-07 10:00:01Z"], "TIMESTAMP", None,
        "2021-07-07T12:00:00+02:00"),
        (["2021-07-07 12:00:00", "2021-07-07 12:00:00,5", "2021-07-07 12:00:01"], "time [UTC]", None,
        "2021-07-07T12:00:00Z"),
        (["2021-07-07 12:00:00", "2021-07-07 12:00:00.5", "2021-07-07 12:00:01"], "time",
        '[time]\nzone = "Europe/Stockholm"', "2021-07-07T12:00:00+02:00"),
        (["07.07.2021 12:00:00.0", "07.07.2021 12:00:00.5", "07.07.2021 12:00:01.0"], "time",
        '[time]\nformat = "%d.%m.%Y %H:%M:%S.%f"\nzone = "UTC"', "2021-07-07T12:00:00Z"),
        (["44384.5", "44384.500005787037", "44384.500011574074"], "time [d]", '[time]\nzone = "UTC"',
        "2021-07-07T12:00:00Z"),
        (["738344.5", "738344.500005787037", "738344.500011574074"], "time", '[time]\nformat = "matlab"\nzone = "UTC"',
        "2021-07-07T12:00:00Z"),
        (["1625659200", "1625659200.5", "1625659201"], "time", '[time]\nformat = "unix"', "2021-07-07T12:00:00Z"),
        (["3708504000000", "3708504000500", "3708504001000"], "time", '[time]\nformat = "labview"\nunit = "ms"',
        "2021-07-07T12:00:00Z"),
    ],
)  # fmt: skip
def test_moments_become_seconds_from_the_first_sample(tmp_path, cells, header, mapping, start):
    record = of(tmp_path, cells, header, mapping)
    np.testing.assert_allclose(record.time, [0.0, 0.5, 1.0], atol=2e-5 if "738344.5" in cells else 2e-6)
    assert record.start == start


def test_without_a_zone_the_start_is_local(tmp_path):
    record = of(tmp_path, ["2021-07-07 12:00:00.25", "2021-07-07 12:00:00.5"])
    assert record.start == "2021-07-07T12:00:00.250"
    assert in_words(record.start) == "2021-07-07T12:00:00.250, local time, zone not given"


def test_elapsed_time_stays_as_it_is_and_days_of_a_year_start_at_zero(tmp_path):
    assert of(tmp_path, ["1000.25", "1000.5"], "time [ms]").time.tolist() == [1.00025, 1.0005]
    days = of(tmp_path, ["188.5", "188.50000578703704"], "time [d]")
    np.testing.assert_allclose(days.time, [0.0, 0.5], atol=1e-8)
    assert days.start is None


def test_days_without_a_unit_are_recognised_only_where_seconds_are_out_of_the_question(tmp_path):
    step = 0.5 / 86400.0
    fast = of(tmp_path, [f"{44384.5 + k * step:.12f}" for k in range(9)])
    np.testing.assert_allclose(fast.time, np.arange(9) * 0.5, atol=1e-5)
    assert fast.start == "2021-07-07T12:00:00"
    with pytest.raises(ValueError, match=r"has no unit.*mapping file"):
        of(tmp_path, [f"{44384.5 + k / 144:.12f}" for k in range(9)])
    seconds = of(tmp_path, [f"{44384.5 + k / 100:.2f}" for k in range(9)])
    assert seconds.time[0] == 44384.5


@pytest.mark.parametrize(
    ("cells", "mapping", "message"),
    [
        (["2021-10-31 02:59:59", "2021-10-31 02:00:00"], None,
        "runs backwards at line 3.*02:59:59.*02:00:00.*cut the file in two"),
        (["2021-10-31 02:59:59", "2021-10-31 02:59:59"], None, "repeated at line 3"),
        (["2021-10-31 01:59:59", "2021-10-31 02:00:00"], '[time]\nzone = "Europe/Stockholm"',
        "at line 3 occurs twice or not at all in Europe/Stockholm"),
        (["2021-03-28 01:59:59", "2021-03-28 02:00:00"], '[time]\nzone = "Europe/Stockholm"',
        "at line 3 occurs twice or not at all"),
        (["07.07.2021 12:00", "07.07.2021 12:01"], None, "neither a number nor ISO.*format ="),
        (["12:00:00", "12:00:01"], None, "has no date"),
        (["2021-07-07 12:00:00", "2021-07-07 12:00:01Z"], None, "line 3 is not an ISO time without a zone"),
        (["2021-07-07 12:00:00", ""], None, "'' at line 3 is not an ISO time"),
        (["2021-02-28 12:00:00", "2021-02-30 12:00:01"], None, "'2021-02-30 12:00:01' at line 3 does not fit"),
        (["1600-02-28 12:00:00", "1601-02-30 12:00:01"], None, "does not fit|too far"),
        (["1e300", "2e300"], '[time]\nformat = "unix"', "expected a date"),
    ],
)  # fmt: skip
def test_a_time_that_is_in_doubt_is_refused_with_its_place(tmp_path, cells, mapping, message):
    with pytest.raises(ValueError, match=message) as caught:
        of(tmp_path, cells, mapping=mapping)
    assert "\n" not in str(caught.value)


def test_the_jump_at_daylight_saving_disappears_where_the_zone_is_known(tmp_path):
    cells = ["2021-03-28 01:59:59", "2021-03-28 03:00:00", "2021-03-28 03:00:01"]
    assert of(tmp_path, cells, mapping='[time]\nzone = "Europe/Stockholm"').time.tolist() == [0.0, 1.0, 2.0]


def test_a_time_column_that_is_not_first_needs_the_mapping(tmp_path):
    content = "a [m],when\n1,0.0\n2,0.5\n"
    refused(write(tmp_path, content), r"\[time\] column")
    record = read_record(
        write(tmp_path, content), mapping=write(tmp_path, '[time]\ncolumn = "when"\nunit = "min"', "m.toml")
    )
    assert record.time.tolist() == [0.0, 30.0]
    assert record["a"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    "start", ["2021-07-07T12:00:00Z", "2021-07-07T12:00:00.250+02:00", "2021-07-07T12:00:00", None]
)
@pytest.mark.parametrize("name", ["x.csv", "x.nc", "x.parquet"])
def test_a_written_record_is_read_back_with_its_start(tmp_path, name, start):
    if name == "x.parquet":
        pytest.importorskip("pyarrow")
    record = Record(np.arange(5.0), np.ones((5, 1)), ("a",), ("m",), start=start).section(2.0, 5.0)
    write_record(record, tmp_path / name)
    again = read_record(tmp_path / name)
    assert again.start == start
    assert again.time.tolist() == [2.0, 3.0, 4.0]
    assert again.attributes == {}
    assert Record.from_xarray(record.to_xarray()).start == start


def test_an_elapsed_time_may_say_its_zero(tmp_path):
    record = of(tmp_path, ["90", "91"], "time [min since 2021-07-07 12:00:00+02:00]")
    assert (record.start, record.time.tolist()) == ("2021-07-07T12:00:00+02:00", [5400.0, 5460.0])
    refused(
        write(tmp_path, "time [s since breakfast],a [m]\n0,1\n1,2\n"),
        "expected a date and time such as .*got 'breakfast'",
    )


@pytest.mark.parametrize(
    ("mapping", "start"),
    [
        ('start = "2021-07-07T12:00:00Z"', "2021-07-07T12:00:00Z"),
        ("start = 2021-07-07T12:00:00+02:00", "2021-07-07T12:00:00+02:00"),
        ('start = "2021-07-07 12:00"\nzone = "Europe/Stockholm"', "2021-07-07T12:00:00+02:00"),
        ('start = "2021-07-07 12:00"', "2021-07-07T12:00"),
    ],
)
def test_a_mapping_says_the_start_that_the_file_does_not(tmp_path, mapping, start):
    assert of(tmp_path, ["0", "1"], "time [s]", f"[time]\n{mapping}").start == start


@pytest.mark.parametrize(
    ("cells", "mapping", "message"),
    [
        (["0", "1"], 'start = "noon"', "start: expected a date and time such as .*got 'noon'"),
        (["2021-07-07 12:00:00", "2021-07-07 12:00:01"], 'start = "2021-07-07T12:00:00Z"',
        "the file itself says that it starts at"),
        (["0", "1"], 'start = "2021-10-31T02:30:00"\nzone = "Europe/Stockholm"',
        "occurs twice or not at all in Europe/Stockholm"),
    ],
)  # fmt: skip
def test_a_start_that_is_in_doubt_is_refused(tmp_path, cells, mapping, message):
    with pytest.raises(WindsysidError, match=message) as caught:
        of(tmp_path, cells, "time [s]" if cells[0] == "0" else "time", f"[time]\n{mapping}")
    assert "\n" not in str(caught.value)


def test_netcdf_of_others_and_of_version_010_says_its_start(tmp_path):
    def read(units="s", **attributes):
        time = ("time", np.array([10.0, 11.0]), {"units": units})
        made = xr.Dataset({"a": ("time", np.ones(2), {"units": "m"})}, coords={"time": time}, attrs=attributes)
        made.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
        return read_record(tmp_path / "x.nc").start

    assert read() is None
    assert read("seconds since 2021-07-07 12:00:00") == "2021-07-07T12:00:00Z"  # CF: UTC unless it says another zone
    assert read("seconds since 2021-07-07") == "2021-07-07T00:00:00Z"
    assert read(time_coverage_start="2021-07-07T12:00:00Z") == "2021-07-07T11:59:50Z"  # ACDD: of the first sample
    assert read(start_time="2021-07-07T12:00:00Z") == "2021-07-07T12:00:00Z"
    assert read(start_time_local="2021-07-07T12:00:00") == "2021-07-07T12:00:00"
    assert read(start_time="after lunch") is None


def test_a_start_that_is_no_moment_is_refused():
    with pytest.raises(RecordError, match=r"start: expected a date and time .* got '2021-07-07'"):
        Record(np.arange(2.0), np.ones((2, 1)), ("a",), ("m",), start="2021-07-07")


@pytest.mark.parametrize(
    ("shape", "pattern"),
    [("{h:02d}:{m:02d}:{s:06.3f}", "%H:%M:%S.%f"), ("{m:02d}:{s:04.1f}", "%M:%S.%f"),
     ("{h}:{m:02d}:{w:02d}", "%H:%M:%S"), ("{m:02d}:{w:02d}", "%M:%S")],
)  # fmt: skip
def test_a_time_without_a_date_is_read_in_the_format_of_the_message_and_has_no_start(tmp_path, shape, pattern):
    seconds = np.arange(200) * (0.2 if "s:" in shape else 1.0) + 50.0
    cells = [shape.format(h=0, m=int(one // 60), s=one % 60, w=round(one % 60)) for one in seconds]
    path = write(tmp_path, "time,a [m]\n" + "".join(f"{cell},{k % 7}\n" for k, cell in enumerate(cells)))
    refused(path, rf'has no date; .*format = "{pattern}" or rate')
    record = read_record(path, mapping=Mapping(time=TimeRule(format=pattern)))
    np.testing.assert_allclose(record.time, seconds - 50.0, atol=1e-9)
    assert record.start is None


def test_names_of_zones_are_not_read_and_the_message_tells_how_to_give_the_zone():
    with pytest.raises(ValueError, match=r"names of zones \(%Z\) are not read.*\[time\] zone"):
        TimeRule(format="%Y-%m-%d %H:%M:%S.%f %Z")


@pytest.mark.parametrize("rows", ["0,1\n", "0,1\n,2\n0.1,3\n", "2024-01-13 12:00:00,1\n"])
def test_a_rate_is_taken_where_the_time_has_one_row_or_is_missing_in_some(tmp_path, rows):
    path, mapping = write(tmp_path, "time [s],a [m]\n" + rows), Mapping(time=TimeRule(rate=20.0))
    if rows.count("\n") < 2:
        refused(path, "at least 2", mapping=mapping)
    else:
        np.testing.assert_allclose(read_record(path, mapping=mapping).time, np.arange(3) / 20.0)
