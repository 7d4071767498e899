import numpy as np
import pytest

from tests.records.formats.helpers import refused, table, text, write
from windsysid.errors import ConfigurationError
from windsysid.records.formats import load_mapping, read_record, write_record
from windsysid.records.record import Record

RENAME = '[channels.a]\nname = "tower_x_acceleration"\nunit = "g"\nsign = -1\n'


def mapped(folder, path, toml):
    return read_record(path, mapping=write(folder, toml, "m.toml"))


@pytest.mark.parametrize("name", ["x.csv", "x.nc", "x.parquet"])
def test_names_units_and_signs_come_from_the_mapping_in_every_format(tmp_path, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow", reason="the extra windsysid[parquet] is not installed")
    time, values = table()
    write_record(Record(time, values, ("a", "b"), ("1", "N")), tmp_path / name)
    record = mapped(tmp_path, tmp_path / name, RENAME)
    assert record.channels == ("tower_x_acceleration", "b")
    assert record.units == ("m/s^2", "N")
    np.testing.assert_array_equal(record["tower_x_acceleration"], values[:, 0] * -9.80665)
    np.testing.assert_array_equal(record["b"], values[:, 1])
    only = mapped(
        tmp_path, tmp_path / name, "only_listed = true\n" + RENAME.replace('"g"', '"as written"') + "factor = 2.0\n"
    )
    assert only.channels == ("tower_x_acceleration",)
    assert only.units == ("as written: 1",)
    np.testing.assert_array_equal(only.values[:, 0], values[:, 0] * -2.0)


def test_openfast_channels_that_are_listed_keep_the_files_sign(tmp_path):
    from tests.records.formats.test_formats import outb

    path = write(tmp_path, outb(np.arange(18.0).reshape(2, 9)), "x.outb")
    plain = read_record(path)
    toml = '[channels.IPDefl2]\nname = "lag"\nunit = "m"\n[channels.Other]\nunit = "as written"\n'
    record = mapped(tmp_path, path, toml)
    np.testing.assert_array_equal(record["lag"], -plain["blade_2_tip_lag_deflection"])
    assert record.unit("Other") == "as written: mm"
    refused(path, "time of OpenFAST output is known", mapping=write(tmp_path, '[time]\nunit = "s"\n', "t.toml"))


def test_how_text_is_written_can_be_said(tmp_path):
    messy = "Logger 5\nexported: today\nZeit;a;b;status\ns;m;kN;-\n" + "".join(
        f"{t:.3f};{x:.3f};{y:.3f};ok\n".replace(".", ",") for t, (x, y) in zip(*table(), strict=True)
    )
    path = write(tmp_path, messy.replace("0,000;", "0,000;", 1), encoding="latin-1")
    refused(path, "first column is")
    toml = (
        'only_listed = true\n[csv]\ndelimiter = ";"\ndecimal = ","\nheader_row = 3\nencoding ='
        ' "latin-1"\n[channels.a]\n[channels.b]\n'
    )
    record = mapped(tmp_path, path, toml)
    np.testing.assert_array_equal(record.values, np.column_stack([table()[1][:, 0], table()[1][:, 1] * 1e3]))
    missing = mapped(tmp_path, write(tmp_path, "time [s],a\n0,-9999\n1,2\n"), '[csv]\nmissing = ["-9999"]\n')
    assert np.isnan(missing["a"][0])
    thousands = mapped(tmp_path, write(tmp_path, "time [s];a\n0;1,234\n1;2,345\n"), '[csv]\ndecimal = ","\n')
    assert thousands["a"].tolist() == [1.234, 2.345]


def test_text_columns_that_are_not_listed_may_hold_the_delimiter_in_quotes(tmp_path):
    path = write(tmp_path, 'time [s],a,note\n0,1,"ok, then"\n1,2,"a ""b"""\n')
    record = mapped(tmp_path, path, "only_listed = true\n[channels.a]\n")
    assert record["a"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ('[chanels.a]\nname = "x"', "unknown key 'chanels'"),
        ('[channels.a]\nnmae = "x"', "unknown key 'channels.a.nmae'"),
        ('[channels.a]\nunit = "furlong"', "channels.a.*unknown unit 'furlong'"),
        ("[channels.a]\nsign = 2", "channels.a.sign"),
        ("[channels.a]\nfactor = 0.0", "channels.a.*factor"),
        ('[csv]\ndelimiter = "|"', "csv.delimiter"),
        ('[csv]\ndelimiter = ","\ndecimal = ","', "csv.*the same"),
        ('[csv]\nencoding = "utf-99"', "csv.*unknown encoding 'utf-99'"),
        ("[csv]\nheader_row = -1", "csv.*counted from 1"),
        ('[time]\nunit = "m"', "time.*not a unit of time"),
        ('[time]\nformat = "euro"', "time.*neither a pattern"),
        ('[time]\nzone = "Mars/North"', "time.*unknown zone"),
        ('[time]\ncolumn = "when"', "time.column: the record has 0 columns 'when'"),
        ('[channels.aa]\nname = "x"', 'channels."aa": the record has no such column: did you mean a'),
        ("only_listed = 7", "only_listed"),
        ("only_listed = true", "lists no channel of the record"),
        ("place = 'x'", "unknown key 'place'"),
        ("[time", "is not a mapping"),
    ],
)  # fmt: skip
def test_a_wrong_mapping_is_refused_naming_the_key(tmp_path, toml, message):
    refused(write(tmp_path, text()), message, mapping=write(tmp_path, toml, "m.toml"))


def test_a_mapping_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="no such file, expected a mapping"):
        load_mapping(tmp_path / "none.toml")
