"""A file of covariates: columns, times and folders, or one line that says what is wrong."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.monitoring.covariates import lines_of, read_covariates
from windsysid.monitoring.dates import Span


def written(path: Path, *lines: str) -> Path:
    file = path / "covariates.csv"
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def spans(*hours: float) -> list[Span]:
    """Records of an hour that begin at these hours of a day."""
    begins = [datetime(2026, 3, 1, tzinfo=UTC) + timedelta(hours=hour) for hour in hours]
    return [Span(begin, begin + timedelta(hours=1), "r") for begin in begins]


def test_an_empty_cell_is_a_missing_value(tmp_path: Path):
    table = read_covariates(written(tmp_path, "wind,time", "9.5,0", ",600"), 2)
    np.testing.assert_array_equal(table.columns["wind"], [9.5, np.nan])
    assert table.time is not None
    assert table.time.tolist() == [0.0, 600.0]
    assert table.dates == []


def test_dates_are_seconds_from_the_first(tmp_path: Path):
    table = read_covariates(written(tmp_path, "time", "2026-03-01T00:00", "2026-03-01T01:30"), 2)
    assert table.time is not None
    assert table.time.tolist() == [0.0, 5400.0]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (("wind", "1"), "expected 2 lines"),
        (("wind", "1", "calm"), "expected numbers in column 'wind', got 'calm'"),
        (("time", "2026-03-01T00:00", "2026-03-01T01:00Z"), "expected times"),
        (("wind", "1,2", "3"), "more cells"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, lines: tuple[str, ...], expected: str):
    with pytest.raises(ConfigurationError, match=expected):
        read_covariates(written(tmp_path, *lines), 2)


def test_lines_belong_to_folders_by_name_then_by_date(tmp_path: Path):
    folders = [Path("b"), Path("a")]
    named = read_covariates(written(tmp_path, "folder,wind", "a,1", "b,2"), 2)
    assert lines_of(named, folders, None) == [1, 0]
    dated = read_covariates(written(tmp_path, "time,wind", "2026-03-01T05:00Z,1", "2026-03-01T00:00Z,2"), 2)
    assert lines_of(dated, folders, spans(0.0, 5.0)) == [1, 0]
    with pytest.raises(ConfigurationError, match="no line has the time of 'a'"):
        lines_of(dated, folders, spans(0.0, 9.0))
    twice = read_covariates(written(tmp_path, "folder,wind", "a,1", "a,2"), 2)
    with pytest.raises(ConfigurationError, match="expected one line of folder 'b', got 0"):
        lines_of(twice, folders, None)


def test_lines_against_the_order_of_the_records_are_refused(tmp_path: Path):
    plain = read_covariates(written(tmp_path, "wind", "1", "2"), 2)
    folders = [Path("b"), Path("a")]
    assert lines_of(plain, folders, spans(0.0, 5.0)) == [0, 1]
    with pytest.raises(ConfigurationError, match="contradicts when the records began"):
        lines_of(plain, folders, spans(5.0, 0.0))
