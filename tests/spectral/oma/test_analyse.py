"""The front of operational modal analysis: lists of sensors, parts of a record."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.oma.analyse import _parts, _sensors_in, sensors_of_each


def test_parts_of_a_record_are_equal_and_follow_each_other():
    assert _parts(1003, 4) == [slice(0, 250), slice(250, 500), slice(500, 750), slice(750, 1000)]


def test_one_sensor_list_serves_all_records_and_lists_serve_one_each():
    assert sensors_of_each(["a", "b"], 2) == [["a", "b"]] * 2
    assert sensors_of_each([["a"], ["b"]], 2) == [["a"], ["b"]]
    assert sensors_of_each(None, 3) == [None] * 3
    with pytest.raises(ws.ConfigurationError, match="or 3, one for each, got 2"):
        sensors_of_each([["a"], ["b"]], 3)


def test_of_a_turbine_only_sensors_with_a_channel_are_used():
    turbine = ws.load_turbine("tower")
    channel = turbine.sensors[0].channel
    record = ws.Record(np.arange(30.0), np.ones((30, 1)), (channel,), ("m/s^2",))
    found = _sensors_in(record, turbine)
    assert found is not None
    assert [sensor.channel for sensor in found if not isinstance(sensor, str)] == [channel]
    assert _sensors_in(record, None) is None
