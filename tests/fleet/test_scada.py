"""What SCADA says of the minutes of a record: each line counts by how long it overlaps."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from windsysid.fleet.scada import Scada

BEGIN = datetime(2026, 3, 1, tzinfo=UTC)


def during(after: float, seconds: float, **columns: list[float]) -> dict[str, float]:
    """Of lines of ten minutes from `BEGIN` on, what is said of so many seconds that begin `after` [s]."""
    arrays = {name: np.array(values) for name, values in columns.items()}
    lines = Scada(BEGIN, np.array([0.0, 600.0, 1200.0]), 600.0, arrays)
    return lines.during(BEGIN + timedelta(seconds=after), seconds)


def test_a_line_counts_by_its_overlap():
    assert during(540.0, 600.0, power=[1.0, 5.0, 9.0]) == {"power": pytest.approx(4.6)}
    assert during(600.0, 600.0, power=[1.0, 5.0, 9.0]) == {"power": pytest.approx(5.0)}


def test_the_mean_of_directions_about_north_is_north():
    mean = during(300.0, 600.0, yaw=[math.radians(350.0), math.radians(10.0), 0.0])["yaw"]
    assert math.sin(mean) == pytest.approx(0.0, abs=1e-9)
    assert math.cos(mean) > 0.9


def test_a_state_is_that_of_the_longest_overlap():
    assert during(540.0, 900.0, state=[1.0, 7.0, 2.0]) == {"state": 7.0}


def test_lines_of_less_than_half_a_record_say_nothing_of_it():
    assert during(1500.0, 900.0, power=[1.0, 5.0, 9.0]) == {}
    assert during(0.0, 1800.0, power=[1.0, math.nan, math.nan]) == {}
    assert during(0.0, 1200.0, power=[1.0, math.nan, math.nan]) == {"power": 1.0}
