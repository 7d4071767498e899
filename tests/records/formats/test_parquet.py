import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.records.formats.helpers import refused, write
from windsysid.errors import OutputError, RecordError
from windsysid.records.formats import read_record, write_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule, load_mapping
from windsysid.records.record import Record

pa = pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")


@pytest.fixture
def record():
    time = np.arange(500.0, 1500.0) * 0.01
    values = np.column_stack([np.sin(time), np.where(time > 6, np.nan, time)])
    return Record(time, values, ("a", "b [x]"), ("m", "as written: foo"), "made up", {"site": "hill"})


def test_parquet_keeps_everything(tmp_path, record):
    write_record(record, tmp_path / "x.parquet")
    again = read_record(tmp_path / "x.parquet")
    assert (again.channels, again.units, again.name) == (record.channels, record.units, record.name)
    assert again.attributes == record.attributes
    assert again.time.tobytes() == record.time.tobytes()
    np.testing.assert_array_equal(again.values, record.values)
    field = pa.parquet.read_schema(tmp_path / "x.parquet").field("a") if hasattr(pa, "parquet") else None
    assert field is None or field.metadata[b"units"] == b"m"


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Stockholm"])
def test_a_frame_that_pandas_wrote_is_read(tmp_path, unit, zone):
    index = pd.date_range("2021-07-07 12:00", periods=5, freq="2s", tz=zone).as_unit(unit)
    frame = pd.DataFrame(
        {"a [mm]": range(5), "speed_rpm": np.array([60, 60, np.nan, 60, 60], dtype=np.float32)}, index=index
    )
    frame.to_parquet(tmp_path / "index.parquet")
    frame.rename_axis("time").reset_index().to_parquet(tmp_path / "column.parquet")
    for name in ("index", "column"):
        record = read_record(tmp_path / f"{name}.parquet")
        assert record.time.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
        assert record.channels == ("a", "speed")
        assert record["a"].tolist() == [0.0, 1e-3, 2e-3, 3e-3, 4e-3]
        assert np.isnan(record["speed"][2])
        assert record.start == ("2021-07-07T12:00:00+02:00" if zone else "2021-07-07T12:00:00")


def test_a_time_as_numbers_or_text_is_read_or_refused(tmp_path):
    pd.DataFrame({"time [ms]": [0, 500], "a": [1, None]}).to_parquet(tmp_path / "x.parquet", index=False)
    assert read_record(tmp_path / "x.parquet").time.tolist() == [0.0, 0.5]
    pd.DataFrame({"time": [0.0, 1.0], "a": ["x", "y"]}).to_parquet(tmp_path / "y.parquet", index=False)
    refused(tmp_path / "y.parquet", "column 'a' holds .*string, expected numbers")
    pd.DataFrame({"b": [0.0, 1.0], "a": [1, 2]}).to_parquet(tmp_path / "z.parquet", index=False)
    refused(tmp_path / "z.parquet", "first column is 'b'")
    pd.DataFrame({"time": [], "a": []}, dtype=float).to_parquet(tmp_path / "e.parquet", index=False)
    refused(tmp_path / "e.parquet", "at least 2 samples")


def test_a_changed_byte_is_found(tmp_path, record):
    write_record(record, tmp_path / "x.parquet")
    data = bytearray((tmp_path / "x.parquet").read_bytes())
    data[2000] ^= 4
    refused(write(tmp_path, bytes(data), "y.parquet"), "damaged")
    refused(write(tmp_path, bytes(data[:-9]), "y.parquet"), "damaged")
    refused(write(tmp_path, "time [s],a\n0,1\n1,2\n", "y.parquet"), "is not Parquet")


def test_no_changed_bit_changes_a_file_of_windsysid(tmp_path, record):
    record = replace(record, start="2026-03-01T00:00:00Z")
    write_record(record, tmp_path / "x.parquet")
    whole = (tmp_path / "x.parquet").read_bytes()
    footer = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    assert pa.parquet.read_table(tmp_path / "x.parquet").num_rows == record.samples  # the seal is in nobody's way
    good, rng = read_record(tmp_path / "x.parquet"), np.random.default_rng(40)
    read = 0
    for at in [*rng.integers(footer, len(whole), 400), *range(footer - 30, footer)]:
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(0, 8))
        found = read_or_refused(write(tmp_path, bytes(data), "y.parquet"))
        if found is not None:
            read += 1
            assert (found.channels, found.units, found.start) == (good.channels, good.units, good.start)
            assert found.attributes == good.attributes
            assert (found.time.tobytes(), found.values.tobytes()) == (good.time.tobytes(), good.values.tobytes())
    assert read < 30  # where the seal itself was hit, and all else is as it was


@pytest.mark.parametrize("count", [150, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("schema", [True, False])
def test_a_changed_bit_changes_no_name_and_no_value_beyond_what_the_footer_says(tmp_path, schema, count):
    rng = np.random.default_rng(41)
    values = rng.standard_normal((500, 2))
    columns = {"time [s]": 0.01 * np.arange(500), "tower_x [m]": values[:, 0], "b": values[:, 1]}
    pa.parquet.write_table(pa.table(columns), tmp_path / "x.parquet", store_schema=schema)
    whole = (tmp_path / "x.parquet").read_bytes()
    good, read = read_record(tmp_path / "x.parquet"), 0
    for at in rng.integers(4, len(whole), count):
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(0, 8))
        found = read_or_refused(write(tmp_path, bytes(data), "y.parquet"))
        if found is not None:
            read += 1
            assert (found.channels, found.units) == (good.channels, good.units)
            assert np.nanmax(np.abs(found.values)) <= np.abs(good.values).max()
    assert read > 0.3 * count  # values that such a file has no checksum for


def read_or_refused(path):
    try:
        return read_record(path)
    except RecordError:
        return None


def test_without_pyarrow_the_line_says_how_to_get_it(tmp_path, record, monkeypatch):
    write_record(record, tmp_path / "x.parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    refused(tmp_path / "x.parquet", r'pip install "windsysid\[parquet\]"')
    with pytest.raises(OutputError, match=r'pip install "windsysid\[parquet\]"'):
        write_record(record, tmp_path / "z.parquet")


def test_parquet_without_a_time_is_counted_by_its_rate(tmp_path):
    values = np.random.default_rng(1).standard_normal((70_000, 2))
    pd.DataFrame(values, columns=["a [m]", "b [m]"]).to_parquet(tmp_path / "x.parquet", index=False)
    mapping = Mapping(time=TimeRule(rate=100.0))
    record = read_record(tmp_path / "x.parquet", mapping=mapping)
    assert record.time.tobytes() == (np.arange(70_000) / 100.0).tobytes()
    assert record.values.tobytes() == values.tobytes()
    part = read_record(tmp_path / "x.parquet", mapping=mapping, section=(690.0, 691.0))
    np.testing.assert_array_equal(part.values, values[69_000:69_100])


def test_the_index_of_a_filtered_frame_is_not_its_time(tmp_path):
    frame = pd.DataFrame({"time [s]": 0.05 * np.arange(200), "a [m]": np.arange(200.0)}).drop(index=[3, 17])
    frame.to_parquet(tmp_path / "x.parquet")
    record = read_record(tmp_path / "x.parquet")
    assert record.channels == ("a",)
    assert record.rate == pytest.approx(20.0)
    assert record.attributes["dropped"] == "pandas' index counts the rows; it is left out"


def twice(path, again):
    """A file with a column `again` of the name of an earlier one."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = [0.1 * np.arange(50), np.arange(50.0), np.arange(50.0) + 1.0, again]
    names = ["time [s]", "a [m]", "b [m]", "a [m]"]
    pq.write_table(pa.table([pa.array(column) for column in columns], names=names), path)
    return path


def test_a_column_that_occurs_twice_with_equal_values_is_kept_once(tmp_path):
    record = read_record(twice(tmp_path / "x.parquet", np.arange(50.0)))
    assert record.channels == ("a", "b")
    np.testing.assert_array_equal(record["a"], np.arange(50.0))
    assert record.attributes["repeated"] == "listed several times with the same values, one kept: a"


def test_a_column_that_occurs_twice_with_other_values_is_refused_unless_it_is_renamed(tmp_path):
    path = twice(tmp_path / "x.parquet", np.arange(50.0) + 7.0)
    refused(path, r"channel 'a' is listed twice with different values \(sample 0\); rename one")
    toml = '[channels."a#2"]\nname = "a_2"\n'
    record = read_record(path, mapping=load_mapping(write(tmp_path, toml, "m.toml")))
    assert record.channels == ("a", "b", "a_2")
    np.testing.assert_array_equal(record["a_2"], np.arange(50.0) + 7.0)
    np.testing.assert_array_equal(record["b"], np.arange(50.0) + 1.0)
