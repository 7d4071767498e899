"""Sensors that fail are told by weeks: stretches, their records, and whether sisters have it too."""

import numpy as np

from windsysid.fleet.sensors import MIN_WEEKLY_RECORDS, Weeks, failing_sensors

CHANNEL = "tower_x_acceleration"


def weeks(bad: dict[int, int], records: int = MIN_WEEKLY_RECORDS) -> Weeks:
    """Weeks 100 … 119 of so many records, of which some have spikes: how many of which week."""
    number = np.arange(100, 120)
    counted = np.array([bad.get(int(week), 0) for week in number])
    return Weeks(number, np.full(20, records), {CHANNEL: {"spikes": counted, "": counted}})


def test_a_week_between_does_not_end_a_failure_and_many_weeks_do():
    found = failing_sensors({"T1": weeks(dict.fromkeys((102, 104, 112), MIN_WEEKLY_RECORDS))})
    assert [(one.turbine, one.channel, one.kind) for one in found] == [("T1", CHANNEL, "spikes")] * 2
    first, second = ((one.first, one.last) for one in found)
    assert first[1] < second[0]


def test_a_week_of_too_few_records_condemns_no_sensor():
    few = MIN_WEEKLY_RECORDS - 1
    assert failing_sensors({"T1": weeks({102: few}, few)}) == []
    assert len(failing_sensors({"T1": weeks({102: MIN_WEEKLY_RECORDS})})) == 1


def test_what_sisters_have_too_is_the_sites():
    ill, well = weeks({102: MIN_WEEKLY_RECORDS}), weeks({})
    assert [one.shared for one in failing_sensors({"T1": ill, "T2": well, "T3": well})] == [False]
    assert {one.shared for one in failing_sensors({"T1": ill, "T2": ill, "T3": ill})} == {True}
