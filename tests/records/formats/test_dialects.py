import numpy as np
import pytest

from tests.records.formats.helpers import refused, table, text, write
from windsysid.records.formats import read_record


def is_the_table(record, rows=40):
    time, values = table(rows)
    assert record.units == ("m", "N")
    assert record.channels == ("a", "b")
    np.testing.assert_array_equal(record.time, time.round(3))
    np.testing.assert_array_equal(record.values, np.column_stack([values[:, 0], values[:, 1] * 1e3]))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_every_delimiter_decimal_mark_and_line_end_is_found(tmp_path, delimiter, decimal, end):
    is_the_table(read_record(write(tmp_path, text(delimiter, decimal, end))))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252"])
def test_every_encoding_is_found(tmp_path, encoding):
    content = text(header="time [s];Überwachung [m/s²];Grad [°]", delimiter=";", decimal=",")
    record = read_record(write(tmp_path, content, encoding=encoding))
    assert record.channels == ("Überwachung", "Grad")
    assert record.units == ("m/s^2", "rad")
    np.testing.assert_array_equal(record["Überwachung"], table()[1][:, 0])


def test_blanks_separate_in_runs_and_stand_around_delimiters(tmp_path):
    rows = text("   ", header="time{d}a_m{d}b").replace("\n", " \n  ")
    record = read_record(write(tmp_path, rows))
    assert record.channels == ("a_m", "b")
    np.testing.assert_array_equal(record.values, table()[1])
    is_the_table(read_record(write(tmp_path, text(" ; ", ","))))
    is_the_table(read_record(write(tmp_path, text("\t").replace("\t", " \t  "))))


def test_mixed_line_ends_and_blank_lines_change_nothing(tmp_path):
    lines = text().split("\n")
    ends = ["\n", "\r\n", "\r", "\n\n", "\r\n \t\r\n"]
    mixed = "".join(line + ends[i % 5] for i, line in enumerate(lines[:-1]))
    is_the_table(read_record(write(tmp_path, mixed)))


@pytest.mark.parametrize("row", ["[s];[m];[kN]", "s;m;kN", "(s);(m);(kN)", "sec;m;kN"])
def test_units_may_stand_below_the_names(tmp_path, row):
    is_the_table(read_record(write(tmp_path, text(";", ",", header=f"Zeit;a;b\n{row}"))))


def test_units_below_the_names_that_contradict_them_are_refused(tmp_path):
    refused(write(tmp_path, text(header="time [s],a [mm],b\ns,m,kN")), r"column 'a \[mm\]' is in 'm' after line 2")


def test_comments_above_the_header_are_kept(tmp_path):
    record = read_record(write(tmp_path, "# site: hill\n% second\n\n" + text()))
    assert record.attributes["comments"] == "# site: hill\n% second"
    is_the_table(record)
    is_the_table(read_record(write(tmp_path, "# " + text())))  # as numpy.savetxt writes it


def test_a_table_without_header_gets_numbered_columns(tmp_path):
    bare = text().split("\n", 1)[1]
    record = read_record(write(tmp_path, bare.replace(",", "  "), "x.dat"))
    assert record.channels == ("column_2", "column_3")
    assert record.units == ("as written: unknown",) * 2
    np.testing.assert_array_equal(record.values, table()[1])
    swapped = "\n".join(",".join(line.split(",")[::-1]) for line in bare.strip().split("\n")) + "\n"
    refused(write(tmp_path, swapped), "first column does not increase.*rate")


TOA5 = (
    '"TOA5","mast","CR1000X","1234","CR1000X.Std.04","CPU:p.CR1X","999","fast"\r\n'
    '"TIMESTAMP","RECORD","acc_x","T_air","note"\r\n'
    '"TS","RN","m/s^2","Deg C",""\r\n'
    '"","","Smp","Avg","Smp"\r\n'
    '"2021-07-07 12:00:00",7,0.5,"NAN",1\r\n'
    '"2021-07-07 12:00:00.05",8,"INF",20.5,2\r\n'
    '"2021-07-07 12:00:00.1",9,-0.5,20.6,3\r\n'
)


def test_a_campbell_file_is_read_with_its_four_header_lines(tmp_path):
    record = read_record(write(tmp_path, TOA5, "x.dat"))
    assert record.channels == ("RECORD", "acc_x", "T_air", "note")
    assert record.units == ("1", "m/s^2", "degC", "as written: unknown")
    np.testing.assert_array_equal(record.time, [0.0, 0.05, 0.1])
    np.testing.assert_array_equal(record["acc_x"], [0.5, np.nan, -0.5])
    np.testing.assert_array_equal(record["T_air"], [np.nan, 20.5, 20.6])
    assert record.attributes["station"] == "mast"
    assert record.attributes["processing T_air"] == "Avg"
    assert record.start == "2021-07-07T12:00:00"
    refused(write(tmp_path, TOA5.replace('"m/s^2",', "")), "has 5 names, 4 units")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "time [s];a\n0;1,234\n1;2,345\n",
            "'1,234' could be a number with a decimal comma or one in thousands.*decimal",
        ),
        ("time [s];a\n0;1,234.5\n1;2,345.5\n", "'1,234.5' is not a number.*thousands"),
        ("time [s];a\n0,5;1.234,5\n1,5;2.345,5\n", "'1.234,5' is not a number.*thousands"),
        ("time [s];a\n0.5;1,5\n1.5;2,5\n", "'1,5' as well as '0.5'"),
        ("0,5 1,5\n1,5 2,5\n", "between blanks"),
        ("time [s];a\n0;1\n1;2\n2;3,5\n" + "3;1\n" * 0, "3,5|decimal"),
        ('time [s],a\n0,"1,5"\n1,2\n', "'1,5' is not a number"),
        ('time [s],a\n0,"1\n1,2\n', "quote that is not closed"),
        ("time [s],a\n0,1\n1,1_000\n", "'1_000' is not a number"),
        ("time [s],a\n0,1\n1,0x1F\n", "'0x1F' is not a number"),
        ("time [s],a\n0,1\n1,True\n", "'True' is not a number"),
        ("time [s],a\n0,True\n1,true\n", "'True' is not a number"),
        ("time [s],a\n0,1\n1,\x002\n", "NUL|binary"),
        ("time [s],a,b\n0,1,2\n1,2\n2,3,4\n", "line 3 has 2 cells, expected 3"),
        ("# only\n# comments\n", "only comments"),
        ("date;a\nfoo;1\nbar;2\n", "the time 'foo' at line 2 is neither a number nor ISO"),
    ],
)
def test_what_could_be_read_in_two_ways_or_none_is_refused(tmp_path, content, message):
    if "3,5" in message:
        record = read_record(write(tmp_path, content))  # 3,5 shows that the comma is the decimal mark
        assert record["a"][2] == 3.5
    else:
        refused(write(tmp_path, content), message)


def test_a_delimiter_at_the_end_of_every_line_is_no_column(tmp_path):
    is_the_table(read_record(write(tmp_path, text(";").replace("\n", ";\n"))))


def test_a_last_line_without_end_is_kept_only_if_it_is_whole(tmp_path):
    whole = text()[:-1]
    is_the_table(read_record(write(tmp_path, whole)))
    for cut in range(1, 20):
        record = read_record(write(tmp_path, whole[:-cut]))
        is_the_table(record, 39) if "cut_off" in record.attributes else is_the_table(record, 38)
    short = read_record(write(tmp_path, "time [s],a [m]\n0,10\n1,20\n2,3"))
    assert short.samples == 2
    assert "cut_off" in short.attributes


def test_a_channel_that_is_missing_throughout_does_not_shift_the_others(tmp_path):
    record = read_record(
        write(tmp_path, "time [s],a [m],b [m],c [m]\n" + "".join(f"{k},{k}.5,,{k}.25\n" for k in range(5)))
    )
    assert np.isnan(record["b"]).all()
    np.testing.assert_array_equal(record["c"], np.arange(5) + 0.25)
