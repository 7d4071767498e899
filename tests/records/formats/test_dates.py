"""Dates in many styles: what the reader proposes for them, and what `inspect --write-mapping` writes, is accepted."""

import re

import numpy as np
import pandas as pd
import pytest

from tests.records.formats.helpers import write
from windsysid.errors import RecordError
from windsysid.inspection.proposal import propose_mapping
from windsysid.records.formats import read_record
from windsysid.records.formats.text.dates import fitting_formats

TIME = np.arange(80) * 0.125
MOMENTS = [pd.Timestamp("2024-01-13T11:59:55") + pd.Timedelta(seconds=t) for t in TIME]
ZERO = 1_705_147_195  # s since 1970, UTC


def lines(style):
    return [
        style(moment) if callable(style) else moment.strftime(style)[: -3 if "%f" in style else None]
        for moment in MOMENTS
    ]


def quoted(cell):
    return f'"{cell}"' if "," in cell else cell


STYLES = {
    "ISO, T": ("%Y-%m-%dT%H:%M:%S.%f", ""),
    "ISO, blank, comma": ("%Y-%m-%d %H:%M:%S,%f", ""),
    "ISO, comma at some": (lambda m: m.isoformat(" ", "milliseconds").replace(".", ",").removesuffix(",000"), ""),
    "ISO, Z": (lambda m: m.isoformat(timespec="milliseconds") + "Z", "Z"),
    "ISO, offset": (lambda m: m.isoformat(timespec="milliseconds") + "+02:00", "+02:00"),
    "day first, points": ("%d.%m.%Y %H:%M:%S.%f", ""),
    "day first, comma": ("%d.%m.%Y %H:%M:%S,%f", ""),
    "day first, two digits": ("%d.%m.%y %H:%M:%S,%f", ""),
    "day first, slashes": ("%d/%m/%Y %H:%M:%S.%f", ""),
    "day first, fraction at some": (
        lambda m: f"{m:%d.%m.%Y %H:%M:%S}" + f",{m.microsecond // 1000:03d}" * bool(m.microsecond), ""
    ),
    "US": ("%m/%d/%Y %H:%M:%S.%f", ""),
    "US, AM and PM": (lambda m: f"{m:%m/%d/%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}", ""),
    "AM and PM, day first": (lambda m: f"{m:%d.%m.%Y %I:%M:%S}.{m.microsecond // 1000:03d} {m:%p}", ""),
    "year first, slashes": ("%Y/%m/%d %H:%M:%S.%f", ""),
    "month in words": ("%d-%b-%Y %H:%M:%S.%f", ""),
    "zone at the end": (lambda m: f"{m:%d.%m.%Y %H:%M:%S}.{m.microsecond // 1000:03d} +0100", "Z"),
}  # fmt: skip


def moment(record):
    return pd.Timestamp(record.start).tz_localize(None) + pd.Timedelta(seconds=record.time[0])


@pytest.mark.parametrize("delimiter", [",", ";"])
@pytest.mark.parametrize("style", STYLES)
def test_what_is_proposed_for_dates_is_accepted(tmp_path, style, delimiter):
    cells, zone = lines(STYLES[style][0]), STYLES[style][1]
    rows = [f"{quoted(cell) if delimiter == ',' else cell}{delimiter}{k % 7}" for k, cell in enumerate(cells)]
    path = write(tmp_path, f"time{delimiter}a [m]\n" + "\n".join(rows) + "\n")
    if style.startswith("ISO"):
        record = read_record(path)
    else:
        with pytest.raises(RecordError) as caught:
            read_record(path)
        found = re.search(r'\[time\] (format = "[^"]*")$', str(caught.value))
        assert found is not None
        record = read_record(path, mapping=write(tmp_path, f"[time]\n{found[1]}\n", "m.toml"))
    np.testing.assert_array_equal(record.time, TIME)
    assert moment(record) in (MOMENTS[0], MOMENTS[0] - pd.Timedelta(hours=1 if "+0100" in cells[0] else 0))
    assert record.start is not None
    assert record.start.endswith(zone)
    mapping = write(tmp_path, propose_mapping(path).to_toml() + '[channels."a"]\nunit = "m"\n', "p.toml")
    mapping.write_text(propose_mapping(path).to_toml())
    np.testing.assert_array_equal(read_record(path, mapping=mapping).time, TIME)


@pytest.mark.parametrize(
    ("header", "cell"),
    [
        ("Date,Time", lambda m: f"{m:%Y-%m-%d,%H:%M:%S.%f}"),
        ("Date,Time", lambda m: f"{m:%d.%m.%Y,%H:%M:%S.%f}"),
        ("Datum;Uhrzeit", lambda m: f"{m:%d.%m.%Y;%H:%M:%S},{m.microsecond // 1000:03d}"),
        ("Datum/Uhrzeit", lambda m: f"{m:%d.%m.%Y %H:%M:%S},{m.microsecond // 1000:03d}"),
        ("Fecha y hora", lambda m: f"{m:%Y-%m-%d %H:%M:%S.%f}"),
        ("Date,Time", lambda m: f"{m:%m/%d/%Y,%I:%M:%S.%f %p}"),
        ("time", lambda m: f"{45_304 + ((m - pd.Timestamp('2024-01-13')) / pd.Timedelta(days=1)):.12f}"),
        ("time [d]", lambda m: f"{45_304 + ((m - pd.Timestamp('2024-01-13')) / pd.Timedelta(days=1)):.12f}"),
        ("time", lambda m: f"{m.value / 1e9:.3f}"),
        ("time", lambda m: f"{m.value // 1_000_000}"),
        ("time", lambda m: f"{m.value // 1000}"),
        ("time", lambda m: f"{m.value}"),
    ],
)
def test_what_is_proposed_for_columns_and_counts_of_dates_is_accepted(tmp_path, header, cell):
    mark = ";" if header.startswith("Datum") else ","
    path = write(
        tmp_path, f"{header}{mark}a [m]\n" + "".join(f"{cell(m)}{mark}{k % 7}\n" for k, m in enumerate(MOMENTS))
    )
    mapping = write(tmp_path, propose_mapping(path).to_toml(), "p.toml")
    record = read_record(path, mapping=mapping)
    np.testing.assert_allclose(record.time - record.time[0], TIME, atol=2e-6)
    if record.start is not None:
        assert abs(moment(record) - MOMENTS[0]) < pd.Timedelta(microseconds=2)


def test_day_and_month_that_cannot_be_told_apart_are_refused_with_both_formats(tmp_path):
    rows = "".join(f"03/04/2024 12:00:{k:02d},125;{k}\n" for k in range(9))
    path = write(tmp_path, "time;a [m]\n" + rows)
    for read in (read_record, propose_mapping):
        with pytest.raises(RecordError, match=r'format = "%d/%m/%Y %H:%M:%S,%f" or "%m/%d/%Y %H:%M:%S,%f"'):
            read(path)
    assert read_record(path, mapping=write(tmp_path, '[time]\nformat = "%m/%d/%Y %H:%M:%S"', "m.toml")).time[8] == 8.0


@pytest.mark.parametrize("pattern", ["%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S,%f"])
def test_a_fraction_of_a_second_is_read_whatever_mark_the_pattern_has(tmp_path, pattern):
    cells = ["13.01.2024 12:00:00", "13.01.2024 12:00:00,5", "13.01.2024 12:00:01.000000001"]
    path = write(tmp_path, "time;a [m]\n" + "".join(f"{cell};1\n" for cell in cells))
    record = read_record(path, mapping=write(tmp_path, f'[time]\nformat = "{pattern}"\n', "m.toml"))
    assert record.time.tolist() == [0.0, 0.5, 1.000000001]


def test_the_whole_beginning_decides_between_day_and_month(tmp_path):
    days = pd.date_range("2024-01-11T23:59:00", periods=240, freq="min")
    assert fitting_formats([f"{day:%d/%m/%Y %H:%M:%S}" for day in days]) == ("%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S")
    days = pd.date_range("2024-01-12T23:00:00", periods=240, freq="min")
    assert fitting_formats([f"{day:%m/%d/%Y %H:%M:%S}" for day in days]) == ("%m/%d/%Y %H:%M:%S",)
    path = write(tmp_path, "time,a [m]\n" + "".join(f"{day:%m/%d/%Y %H:%M:%S},1\n" for day in days))
    assert propose_mapping(path).given.time.format == "%m/%d/%Y %H:%M:%S"


@pytest.mark.parametrize(
    "cell", ["", "noon", "13.01.2024", "2024-13-13 12:00:00", "31.02.2024 12:00:00", "1.2.3.4 12:00"]
)
def test_nothing_is_proposed_for_what_is_no_date(cell):
    assert fitting_formats([cell]) == ()
    assert fitting_formats([]) == ()
