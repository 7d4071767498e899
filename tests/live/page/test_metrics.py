"""Metrics as Prometheus reads them, and verdicts as the page shows them."""

import math

import numpy as np
import pytest

from windsysid.live.engine_state import EngineState, TurbineState
from windsysid.live.page.metrics import metrics_text
from windsysid.live.page.models import AlarmSeen, ChannelHealth, PageOverview, TurbineSummary
from windsysid.live.page.results import _covariance
from windsysid.live.page.views import _verdict_of_alarms, _verdict_of_result


def summary(name: str) -> TurbineSummary:
    return TurbineSummary(
        name=name, verdict="steady", answer="", state="running", rotor_speed=None, stream=2000.0, received=None,
        window=None, until=None, trusted=None, reasons=[], windows_waiting=3, behind=None, alarms=[], faults=[],
    )  # fmt: skip


def overview(*names: str) -> PageOverview:
    return PageOverview(
        at=0.0, event=0, role="reader", login=False, version="1", turbines=[summary(name) for name in names],
        service=None,
    )  # fmt: skip


def alarm(kind: str, text: str) -> AlarmSeen:
    return AlarmSeen(
        key="k", turbine="T", kind=kind, severity="alarm", about="", title="", opened=0.0, earliest=0.0, latest=0.0,
        ended=None, text=text, acknowledged=None, by="", remark="",
    )  # fmt: skip


def test_what_is_not_known_has_no_metric_and_names_are_escaped():
    text = metrics_text(overview('T"1'), {'T"1': None}, {"results": 2, "bytes": 10}, 1)
    assert 'windsysid_sample_timestamp_seconds{turbine="T\\"1"} 2\n' in text
    assert "windsysid_windows_waiting" in text
    assert "block_timestamp" not in text
    assert "blocks_per_second" not in text
    assert text.endswith("windsysid_event_streams 1\n")


def test_structure_comes_before_sensor_and_sensor_before_data():
    alarms = [alarm("data", "d"), alarm("sensor", "s1"), alarm("sensor", "s2"), alarm("structure", "m")]
    assert _verdict_of_alarms(alarms, [], None) == ("moved", "m")
    assert _verdict_of_alarms(alarms[:-1], [], None) == ("sensor", "s1")
    fault = ChannelHealth(channel="ax", state="dead", since=0.0, text="")
    assert _verdict_of_alarms(alarms[:1], [fault], None) == ("sensor", "ax: dead")
    assert _verdict_of_alarms([], [], None) is None
    assert _verdict_of_result(None, 0, None)[0] == "waiting"


def test_a_triangle_is_a_covariance_and_anything_else_is_none():
    full = np.array([[4.0, 1.0], [1.0, 2.0]])
    np.testing.assert_array_equal(_covariance({"covariance": [4.0, 1.0, 2.0]}), full)
    for wrong in (None, [1.0, 2.0], [1.0, math.nan, 2.0]):
        assert _covariance({"covariance": wrong}).size == 0


def test_an_engine_state_says_by_how_much_a_turbine_is_behind():
    state = EngineState({"T01": TurbineState(3, 40.0)}, 0, 0, 0, 0.0, 0, {}, 1)
    assert state.turbines["T01"].behind == pytest.approx(40.0)
