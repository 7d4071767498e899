"""Series of one file as one table."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.formats.contents.columns import Cell
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, source_of_series
from windsysid.records.formats.contents.source import gather


def series(name, values, step, first=0.0):
    values = np.asarray(values, dtype=np.float64)
    return FileSeries(Cell(name, name, "m"), len(values), lambda a, b: values[a:b], TimeGrid(first, step))


def record(*several):
    return gather(source_of_series("x", several, Mapping(), {}, how="{}"))


def test_a_slower_series_stands_where_its_times_do():
    found = record(series("fast", range(9), 0.5), series("slow", [10.0, 20.0, 30.0], 2.0))
    np.testing.assert_array_equal(found.time, 0.5 * np.arange(9))
    np.testing.assert_array_equal(found["slow"][::4], [10.0, 20.0, 30.0])
    assert np.isnan(found["slow"]).sum() == 6


def test_series_between_the_rows_of_another_are_refused():
    with pytest.raises(RecordError, match="are not sampled together"):
        record(series("fast", range(9), 0.5), series("slow", [10.0, 20.0, 30.0], 2.0, first=0.1))


def test_a_series_called_time_is_the_clock():
    time, x = np.array([0.0, 0.1, 0.3]), np.array([1.0, 2.0, 3.0])
    clock = FileSeries(Cell("time", "time", "s"), 3, lambda a, b: time[a:b])
    found = record(clock, FileSeries(Cell("x", "x", "mm"), 3, lambda a, b: x[a:b]))
    np.testing.assert_array_equal(found.time, time)
    np.testing.assert_allclose(found["x"], 1e-3 * x, rtol=1e-15)
