"""A format is one entry of a list, found by ending and content; a package that it lacks is asked for in one line."""

import sys

import pytest

from tests.records.formats.helpers import refused, write
from windsysid.errors import RecordError
from windsysid.records.formats import FORMATS, read_record
from windsysid.records.formats.contents.format import package


def test_endings_are_written_in_small_letters_and_every_format_has_some():
    assert all(one.endings and all(end == end.lower() for end in one.endings) for one in FORMATS)


def test_formats_that_share_an_ending_tell_by_the_content():
    endings = [end for one in FORMATS for end in one.endings]
    for shared in {end for end in endings if endings.count(end) > 1}:
        owners = [one for one in FORMATS if shared in one.endings]
        assert all(one.begins or one.claims for one in owners[:-1])


def test_a_missing_package_is_named_with_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "nosuchpackage", None)
    with pytest.raises(RecordError) as caught:
        package("nosuchpackage.reader", "Strange files", "formats")
    assert str(caught.value) == ('Strange files need nosuchpackage; install it with: pip install "windsysid[formats]"')


def test_an_unknown_ending_says_what_the_content_is(tmp_path):
    refused(write(tmp_path, b"PAR1....", "x.bin"), r"unknown ending '\.bin', but it holds Parquet.*'\.parquet'")
    refused(write(tmp_path, b"\x89HDF\r\n\x1a\n....", "x"), "unknown ending '', but it holds HDF5")
    refused(write(tmp_path, b"nothing", "x.bin"), r"unknown ending '\.bin', expected one of \.nc")


def test_the_case_of_an_ending_does_not_matter(tmp_path):
    assert read_record(write(tmp_path, "time [s],a [m]\n0,1\n1,2\n", "X.CSV")).samples == 2
