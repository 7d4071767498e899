"""Campaigns of records with known parts."""

import pytest
from validation.damping import air_of_the_tower, campaign

from windsysid.units import RPM


@pytest.mark.slow  # tests/monitoring/test_damping.py has it of results made by hand
def test_parked_and_running_records_tell_both_parts():
    found = campaign("parked and running", 1)
    assert len(found) == 2 * 4
    held = [outcome.found and outcome.found.low < outcome.truth < outcome.found.high for outcome in found]
    assert sum(map(bool, held)) >= 7  # of eight at ±2σ


@pytest.mark.slow  # tests/monitoring/test_damping.py has it of results made by hand
def test_records_of_one_rotor_speed_do_not():
    assert all(outcome.found is None for outcome in campaign("one speed", 1))


def test_the_air_of_attached_flow_is_of_first_degree_in_both_speeds():
    once, twice = air_of_the_tower(0.6, 6.0), air_of_the_tower(1.2, 12.0)
    assert {name: 2.0 * c for name, c in once.items()} == pytest.approx(twice, rel=1e-9)
    assert air_of_the_tower(12.1 / RPM, 17.0)["c_side_side"] > air_of_the_tower(12.1 / RPM, 9.0)["c_side_side"]
