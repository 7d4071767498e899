"""Sources: blocks, sections and pieces of a file give the same samples."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.formats.contents.columns import Column
from windsysid.records.formats.contents.source import (
    FileBlock,
    FileSource,
    gather,
    gather_section,
    indexed_source,
    pieces,
)
from windsysid.records.formats.contents.source import without_repeats as kept_once

TIME, VALUES = np.linspace(0.0, 4.9, 50), np.random.default_rng(1).standard_normal((50, 2))


def source():
    columns = [Column(0, "a", "m"), Column(1, "b", "rad")]
    return indexed_source("x", columns, TIME, lambda low, high: VALUES[low:high], values_at_once=14)


def test_blocks_of_any_size_give_the_whole():
    found = gather(source())
    assert (found.channels, found.units) == (("a", "b"), ("m", "rad"))
    np.testing.assert_array_equal(found.values, VALUES)


def test_a_section_has_the_samples_of_the_whole():
    np.testing.assert_array_equal(gather_section(source(), 1.0, 2.0).values, VALUES[10:20])


def test_every_sample_is_in_one_piece():
    np.testing.assert_array_equal(np.concatenate([one.values for one in pieces(source(), 1.3)]), VALUES)


def twice(change=0.0):
    values = np.column_stack([VALUES[:, 0], VALUES[:, 0] + change])
    blocks = [FileBlock(TIME, values, "row {}".format, 1.0)]
    return FileSource("x", ("a", "a"), ("m", "m"), lambda start, end: iter(blocks))


def test_a_channel_that_is_listed_twice_is_kept_once():
    assert gather(kept_once(twice())).channels == ("a",)
    with pytest.raises(RecordError, match=r"listed twice with different values \(row 0\)"):
        gather(kept_once(twice(1.0)))
