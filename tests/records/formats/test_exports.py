"""Text as spreadsheets, SCADA and small loggers export it: no time, two columns of it, lines above, marks inside."""

import numpy as np
import pandas as pd
import pytest

from tests.records.formats.helpers import refused, table, text, write
from windsysid.errors import ConfigurationError
from windsysid.records.formats import iterate_record, load_mapping, read_record
from windsysid.records.formats.contents.mapping import CsvRule, Mapping, TimeRule

TIME, VALUES = table()


def rows(delimiter=",", first=lambda k: f"{TIME[k]:.2f}"):
    return "".join(f"{delimiter.join([first(k), *(f'{x:.3f}' for x in VALUES[k])])}\n" for k in range(TIME.size))


def same(record, start=None, within=1e-9):
    np.testing.assert_allclose(record.time, TIME, atol=within)
    np.testing.assert_array_equal(record.values, VALUES * [1.0, 1e3])
    assert record.start == start


# no time


def test_sixteen_channels_in_mg_without_time_and_header(tmp_path):
    values = np.round(np.random.default_rng(2).standard_normal((50, 16)), 3)
    path = tmp_path / "x.txt"
    pd.DataFrame(values).to_csv(path, sep=" ", header=False, index=False)
    toml = '[time]\nrate = 128.0\nstart = "2021-07-07T12:00:00Z"\n[channels."column_*"]\nunit = "mg"\n'
    (tmp_path / "m.toml").write_text(toml)
    record = read_record(path, mapping=tmp_path / "m.toml")
    assert record.channels == tuple(f"column_{k}" for k in range(1, 17))
    assert record.values.tobytes() == (values * (9.80665 * 1e-3)).tobytes()
    assert record.time.tobytes() == (np.arange(50) / 128.0).tobytes()
    assert record.start == "2021-07-07T12:00:00Z"
    pieces = list(iterate_record(path, 0.1, mapping=load_mapping(tmp_path / "m.toml")))
    assert np.concatenate([p.time for p in pieces]).tobytes() == record.time.tobytes()
    part = read_record(path, mapping=tmp_path / "m.toml", section=(0.2, 0.3))
    np.testing.assert_array_equal(part.values, record.section(0.2, 0.3).values)


def test_a_header_without_time_is_read_with_its_rate_and_refused_without(tmp_path):
    path = write(tmp_path, "a [m],b [kN]\n" + "".join(f"{x:.3f},{y:.3f}\n" for x, y in VALUES))
    same(read_record(path, mapping=Mapping(time=TimeRule(rate=20.0))))
    refused(path, "the first column is 'a")
    with pytest.raises(ValueError, match="rate is for files without a time"):
        TimeRule(rate=20.0, unit="ms")
    with pytest.raises(ValueError, match="not a number of samples per second"):
        TimeRule(rate=-1.0)


def test_a_long_file_without_time_counts_its_rows_over_blocks(tmp_path):
    count = 400_000
    path = write(tmp_path, "a [m],b [m]\n" + "".join(f"{k}.5,{k}.25\n" for k in range(count)))
    mapping = Mapping(time=TimeRule(rate=100.0))
    record = read_record(path, mapping=mapping, section=(3000.0, 3001.0))
    assert record.time[0] == 3000.0
    np.testing.assert_array_equal(record["a"], 300_000.5 + np.arange(100))


# date and time apart


def test_date_and_time_in_two_columns_are_found_by_their_names(tmp_path):
    moment = [pd.Timestamp("2021-07-07T23:59:59") + pd.Timedelta(seconds=t) for t in TIME]
    path = write(
        tmp_path, "Date,Time,a [m],b [kN]\n" + rows(first=lambda k: moment[k].strftime("%Y-%m-%d,%H:%M:%S.%f"))
    )
    same(read_record(path), "2021-07-07T23:59:59")
    part = read_record(path, section=(0.5, 1.0))
    np.testing.assert_array_equal(part.values, read_record(path).section(0.5, 1.0).values)


def test_date_and_time_are_named_in_the_mapping_where_they_are_written_otherwise(tmp_path):
    moment = [pd.Timestamp("2021-07-07T12:00:00") + pd.Timedelta(seconds=t) for t in TIME]
    lines = [f"{x:.3f};{m:%d.%m.%Y};{y:.3f};{m:%H:%M:%S.%f}" for (x, y), m in zip(VALUES, moment, strict=True)]
    path = write(tmp_path, "a [m];Tag;b [kN];Uhr\n" + "\n".join(lines) + "\n")
    rule = TimeRule(column=("Tag", "Uhr"), format="%d.%m.%Y %H:%M:%S.%f", zone="Europe/Stockholm")
    same(read_record(path, mapping=Mapping(time=rule)), "2021-07-07T12:00:00+02:00")
    toml = '[time]\ncolumn = ["Tag", "Uhr"]\nformat = "%d.%m.%Y %H:%M:%S.%f"\nzone = "Europe/Stockholm"\n'
    (tmp_path / "m.toml").write_text(toml)
    same(read_record(path, mapping=tmp_path / "m.toml"), "2021-07-07T12:00:00+02:00")
    with pytest.raises(ConfigurationError, match="0 columns 'Zeit'"):
        read_record(path, mapping=Mapping(time=TimeRule(column=("Tag", "Zeit"))))


def test_a_date_that_could_be_day_or_month_first_is_refused(tmp_path):
    path = write(tmp_path, "Date,Time,a [m],b [kN]\n" + rows(first=lambda k: f"07/08/2021,12:00:{TIME[k]:05.2f}"))
    refused(path, r"'07/08/2021 12:00:00.00' at line 2 is neither a number nor ISO")
    path = write(tmp_path, "Time,a [m],b [kN]\n" + rows(first=lambda k: f"12:00:{TIME[k]:05.2f}"))
    refused(path, r"has no date; .*column = \[\"Date\", \"Time\"\]")


# moments that count from 1970


@pytest.mark.parametrize(("count", "header"), [(1e3, "time"), (1e3, "timestamp [ms]"), (1e6, "t"), (1e9, "time")])
def test_milliseconds_and_less_since_1970_are_moments(tmp_path, count, header):
    zero = 1_625_659_200
    path = write(
        tmp_path, f"{header},a [m],b [kN]\n" + rows(first=lambda k: str(int(zero * count) + round(TIME[k] * count)))
    )
    # a number of 19 digits is a float64 to 256 ns
    same(read_record(path), "2021-07-07T12:00:00Z", 1e-9 if count < 1e9 else 2e-7)


def test_seconds_since_1970_stay_seconds(tmp_path):
    path = write(tmp_path, "time,a [m],b [kN]\n" + rows(first=lambda k: f"{1_625_659_200 + TIME[k]:.2f}"))
    record = read_record(path)
    assert record.time[0] == 1_625_659_200.0
    assert record.start is None


# lines above, and marks


@pytest.mark.parametrize(
    "above",
    [
        "Station: hill\n", "Logger report\nSite;hill\nRate;20 Hz\n\n", "sep=;\n", "SEP=;\r\n", '"sep=;"\n',
        "sep=;\nStation: hill\n", "# a comment\nreport\n", "Report of a spreadsheet;;\n;;\n",
    ],
)  # fmt: skip
def test_lines_above_the_names_are_kept_as_comments(tmp_path, above):
    path = write(tmp_path, above + text(";", ",", header="time [s]{d}a [m]{d}b [kN]".replace("{d}", ";")))
    record = read_record(path)
    same(record)
    shown = [line for line in above.splitlines() if line and "sep=" not in line.lower()]
    assert record.attributes.get("comments", "") == "\n".join(shown)


def test_the_separator_that_a_file_names_goes_before_its_look(tmp_path):
    path = write(tmp_path, "sep=;\ntime [s];a, top [m]\n0;1,5\n1;2,5\n2;3,5\n")
    record = read_record(path)
    assert record.channels == ("a, top",)
    np.testing.assert_array_equal(record["a, top"], [1.5, 2.5, 3.5])
    refused(path, "the first column is 'time .s.;a'", mapping=Mapping(csv=CsvRule(delimiter=",")))


def test_a_title_and_units_above_dates_are_read_as_a_spreadsheet_writes_them(tmp_path):
    rows_of_dates = "".join(f"2024-05-02T10:00:{k:02d}\t{k % 3}.5\t{k % 4}.5\n" for k in range(40))
    record = read_record(write(tmp_path, "Messung 7\t\t\nDatum\ta\tb\n\tg\tmm\n" + rows_of_dates))
    assert (record.channels, record.units) == (("a", "b"), ("m/s^2", "m"))
    refused(write(tmp_path, "time [s]\ta\tb\n\tgood\tmm\n" + rows_of_dates), ".")


def test_lines_above_that_look_like_rows_are_no_preamble(tmp_path):
    refused(write(tmp_path, "1;2\n" + text(";", ",")), ".")
    refused(write(tmp_path, "time [s];a [m]\n" + text(";", ",", header="0,0;1,5;2,5")), ".")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_mark_of_the_byte_order_is_no_part_of_a_text(tmp_path, encoding):
    whole = "# made here\n\ufefftime [s],\ufeffa [m],b [kN]\n" + rows()
    lines = whole.split("\n")
    lines[20] = "\ufeff" + lines[20]
    path = write(tmp_path, ("\ufeff" if encoding == "utf-8" else "") + "\n".join(lines), encoding=encoding)
    record = read_record(path)
    assert record.channels == ("a", "b")
    same(record)


def test_a_mark_inside_a_file_of_the_windows_code_page_is_none_either(tmp_path):
    whole = "time [s],a [m],b [kN],Wärme\n".encode("cp1252") + rows().replace("\n", ",1\n").encode()
    half = whole.find(b"\n", 300) + 1
    record = read_record(write(tmp_path, whole[:half] + b"\xef\xbb\xbf" + whole[half:]))
    np.testing.assert_array_equal(record.values[:, :2], VALUES * [1.0, 1e3])


# a column that counts rows


@pytest.mark.parametrize("columns", [{}, {"index_label": "index"}, {"sep": ";"}, {"sep": "\t"}])
def test_the_index_that_pandas_writes_is_left_out_and_said(tmp_path, columns):
    frame = pd.DataFrame({"time [s]": TIME, "a [m]": VALUES[:, 0], "b [kN]": VALUES[:, 1]})
    frame.to_csv(tmp_path / "x.csv", **columns)
    record = read_record(tmp_path / "x.csv")
    same(record)
    assert record.attributes["dropped"].endswith("counts the rows; it is left out")
    pd.read_csv(tmp_path / "x.csv", sep=columns.get("sep", ",")).to_csv(tmp_path / "x.csv", index=False)
    same(read_record(tmp_path / "x.csv"))  # which calls it Unnamed: 0
    frame.drop(index=[3, 4, 17]).to_csv(tmp_path / "x.csv", **columns)
    assert read_record(tmp_path / "x.csv").samples == 37


def test_an_index_beside_a_rate_is_left_out_and_one_that_the_mapping_names_is_not(tmp_path):
    pd.DataFrame({"a [m]": VALUES[:, 0], "b [kN]": VALUES[:, 1]}).to_csv(tmp_path / "x.csv")
    same(read_record(tmp_path / "x.csv", mapping=Mapping(time=TimeRule(rate=20.0))))
    refused(tmp_path / "x.csv", "the first column is 'a")
    record = read_record(tmp_path / "x.csv", mapping=Mapping(time=TimeRule(column="Unnamed: 0", unit="ms")))
    np.testing.assert_allclose(record.time, 1e-3 * np.arange(40))


def test_a_first_column_without_a_name_that_does_not_count_is_refused(tmp_path):
    pd.DataFrame({"a [m]": VALUES[:, 0]}, index=TIME).to_csv(tmp_path / "x.csv")
    refused(tmp_path / "x.csv", "column 1 has no name")
