"""The layout of a text table, from its first lines."""

import pytest

from windsysid.errors import RecordError
from windsysid.records.formats.contents.mapping import CsvRule
from windsysid.records.formats.text.dialect import find_layout


def layout_of(text, rule=None):
    return find_layout(list(enumerate(text.split("\n"), 1)), rule or CsvRule())


def test_comments_and_wide_headings_stand_above_the_names():
    found = layout_of("# site A\nLogger 7\nTime;x;y\n[s];[mm];[mm]\n0,0;1,5;1,5\n0,1;2,5;2,5")
    assert (found.delimiter, found.decimal, found.first_row) == (";", ",", 5)
    assert [(cell.name, cell.unit) for cell in found.cells] == [("Time", "s"), ("x", "mm"), ("y", "mm")]
    assert found.attributes == {"comments": "# site A\nLogger 7"}


def test_a_delimiter_that_ends_every_line_is_no_column():
    found = layout_of("t [s],x [m],\n0,1,\n1,2,")
    assert found.closed
    assert [cell.name for cell in found.cells] == ["t", "x"]


def test_a_table_without_names_begins_with_the_time():
    found = layout_of("0 1\n1 2\n2 3")
    assert not found.headed
    assert [cell.name for cell in found.cells] == ["time", "column_2"]


def test_a_header_row_that_is_blank_is_refused_with_its_number():
    with pytest.raises(RecordError, match="line 2 should be the header"):
        find_layout([(1, "t,x"), (3, "0,1")], CsvRule(header_row=2))
