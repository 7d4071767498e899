"""Records in order of when they began."""

from typing import NamedTuple

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.monitoring.dates import MIN_BLOCKS, in_order, spans_of


class Told(NamedTuple):
    """A result that says when its record began."""

    record: str
    start: str | None
    section: tuple[float, float] | None = (0.0, 60.0)


HOURLY = [Told(f"r{i}", f"2026-03-01T{i:02d}:00:00Z") for i in range(MIN_BLOCKS)]


def test_results_and_covariates_are_put_in_order_of_time():
    wind = np.arange(float(MIN_BLOCKS))
    placed = in_order(HOURLY[::-1], None, {"wind": wind}, None)
    assert placed.order == list(range(MIN_BLOCKS))[::-1]
    np.testing.assert_array_equal(placed.time, 3600.0 * np.arange(MIN_BLOCKS))
    np.testing.assert_array_equal(placed.covariates[:, 0], wind[::-1])


def test_covariates_of_another_length_are_refused():
    for count in (MIN_BLOCKS - 1, MIN_BLOCKS + 1):
        with pytest.raises(ConfigurationError, match=f"expected {MIN_BLOCKS} values of wind"):
            in_order(HOURLY, None, {"wind": np.zeros(count)}, None)


def test_records_that_do_not_say_when_they_began_stay_as_given():
    placed = in_order([told._replace(start=None) for told in HOURLY], None, None, None)
    assert placed.order == list(range(MIN_BLOCKS))
    np.testing.assert_array_equal(placed.time, 600.0 * np.arange(MIN_BLOCKS))
    assert "do not say when they began" in placed.notes[0]


def test_records_with_a_zone_and_without_are_refused():
    with pytest.raises(ConfigurationError, match=r"with a zone \('r1'\) and without \('r0'\)"):
        spans_of([Told("r0", "2026-03-01T00:00:00"), *HOURLY[1:]])


def test_records_that_overlap_are_named():
    late = Told("late", "2026-03-01T00:00:40Z")
    assert "'r0' and 'late' overlap by 20 s" in in_order([late, *HOURLY], None, None, None).notes[0]
