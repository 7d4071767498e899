"""Numbers, names and settings that no instrument writes end in one line: nothing crashes on them."""

import json

import numpy as np
import pytest
from validation.format_samples import SAMPLES, files_of, truth

from tests.records.formats.helpers import refused, write
from windsysid.errors import ConfigurationError
from windsysid.records.formats import load_mapping, read_record

TABLE = b"time [s],sway [m]\n0,1\n1,2\n2,4\n"


def sample(folder, name):
    """A sound file of a format: its path and what is written about it."""
    one = SAMPLES[name]
    if one.package:
        pytest.importorskip(one.package)
    path = folder / f"x{one.ending}"
    one.write(path, *truth(one))
    return path, files_of(one, path)[-1]


def changed(target, old, new):
    content = target.read_bytes()
    assert old in content
    target.write_bytes(content.replace(old, new, 1))


@pytest.mark.parametrize("count", [b"inf", b"nan", b"-inf", b"1e300", b"1e11", b"-400"])
@pytest.mark.parametrize("name", ["UFF 58", "UFF 58b"])
def test_a_uff_header_whose_count_is_no_count_is_refused(tmp_path, name, count):
    path, _ = sample(tmp_path, name)
    changed(path, b"       400", count.rjust(10))
    refused(path, "a set 58")


def test_a_uff_header_that_says_more_lines_than_the_file_has_is_refused_at_once(tmp_path):
    path, _ = sample(tmp_path, "UFF 58b")
    changed(path, b"          11", b"100000000000")
    refused(path, "header lines, expected 11")
    changed(path, b"100000000000", b"         900")
    refused(path, "cut off|damaged")


def test_places_that_no_file_has_are_not_looked_for(tmp_path):
    path, _ = sample(tmp_path, "UFF 58b")
    changed(path, b"       400", b"     1e300")
    changed(path, b"        3200", b"        3111")
    refused(path, "cut off or damaged")
    path, _ = sample(tmp_path, "MDF 4")
    content = bytearray(path.read_bytes())
    content[64 + 24 : 64 + 32] = b"\xff" * 8
    path.write_bytes(content)
    refused(path, "damaged|holds no channel")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (b"DIMENS\t2", b"DIMENS\t\xb2", "DIMENS"),
        (b"DIMENS\t2", b"DIMENS\t" + b"9" * 5000, "DIMENS"),
        (b"MIN \t0.0000000E+000", b"MIN \tnan", "MIN and STEP"),
        (b"MIN \t0.0000000E+000", b"MIN \tinf", "MIN and STEP"),
        (b"STEP\t", b"STEP\tnan ", "MIN and STEP"),
        (b"E-02\nNVARS", b"E+290\nNVARS", "expected at most 1e"),
    ],
)
def test_a_bladed_header_whose_numbers_are_none_is_refused(tmp_path, old, new, told):
    path, header = sample(tmp_path, "Bladed text")
    changed(header, old, new)
    refused(path, told)


@pytest.mark.parametrize("key", ["wf_increment", "wf_start_offset"])
@pytest.mark.parametrize("value", [1e300, -1e300, 5e-324, np.nan, np.inf])
def test_a_tdms_clock_that_no_instrument_has_is_refused_or_read_as_it_stands(tmp_path, key, value):
    nptdms = pytest.importorskip("nptdms")
    about = {"wf_increment": 0.02, "wf_start_offset": 0.0, "unit_string": "g"} | {key: value}
    path = tmp_path / "x.tdms"
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("daq", "a", np.arange(10.0), about)])
    if key == "wf_start_offset" and value == 5e-324:
        assert read_record(path).rate == pytest.approx(50.0)
    else:
        refused(path, "expected|is known to be the time")


@pytest.mark.parametrize(
    "notes",
    ["[" * 50_000, '{"index_columns": [' + "[" * 50_000, '{"index_columns": [{}]}', '{"index_columns": 7}', "7", "{"],
)
def test_notes_of_pandas_that_are_none_are_left_out(tmp_path, notes):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pa.table({"time [s]": [0.0, 1.0, 2.0], "sway [m]": [1.0, 2.0, 4.0]})
    pq.write_table(table.replace_schema_metadata({"pandas": notes}), tmp_path / "x.parquet")
    assert read_record(tmp_path / "x.parquet").samples == 3
    pq.write_table(table.replace_schema_metadata({"windsysid_attributes": notes}), tmp_path / "x.parquet")
    if not notes.startswith('{"index_columns": [{') and notes != '{"index_columns": 7}':
        refused(tmp_path / "x.parquet", "is damaged")


@pytest.mark.parametrize("pattern", ["%Y%Y%Y%", "%", "%Q", "%d%d", "%s", "%G-%V", "%U %Y", "%Y-%m-%d%z%z"])
def test_a_pattern_of_dates_that_is_none_is_refused_in_the_mapping(tmp_path, pattern):
    mapping = tmp_path / "m.toml"
    mapping.write_text(f"[time]\nformat = {json.dumps(pattern)}\n")
    with pytest.raises(ConfigurationError, match=rf"m\.toml: time: .*format '{pattern}' is no pattern"):
        load_mapping(mapping)


@pytest.mark.parametrize(
    "encoding", ["idna", "punycode", "undefined", "rot13", "base64", "hex", "unicode_escape", "raw_unicode_escape", "x"]
)
def test_an_encoding_that_is_none_of_files_is_refused_in_the_mapping(tmp_path, encoding):
    mapping = tmp_path / "m.toml"
    mapping.write_text(f'[csv]\nencoding = "{encoding}"\n')
    with pytest.raises(ConfigurationError, match=rf"m\.toml: csv: unknown encoding '{encoding}'"):
        load_mapping(mapping)


@pytest.mark.parametrize("encoding", ["utf_16", "UTF-16", "utf-32", "cp1252", "utf-8", "shift_jis", "utf-7"])
def test_encodings_of_files_are_read_by_any_of_their_names(tmp_path, encoding):
    mapping = tmp_path / "m.toml"
    mapping.write_text(f'[csv]\nencoding = "{encoding}"\n')
    path = write(tmp_path, TABLE.decode().encode(encoding))
    assert read_record(path, mapping=mapping).samples == 3


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0,1\n1,2\n1e308,3\n", r"the time at line 4 is 1e\+308 s: expected at most 1e\+13 s"),
        ("-1.7e308,1\n0,2\n1.7e308,3\n", r"the time at line 2 is -1.7e\+308 s"),
        ("0,1\n1e-320,2\n2e-320,3\n", "3 samples from line 2 on last"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_times_that_no_clock_shows_are_refused_with_their_place(tmp_path, rows, told):
    refused(write(tmp_path, b"time [s],sway [m]\n" + rows.encode()), told)
