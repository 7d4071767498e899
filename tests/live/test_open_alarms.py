"""Alarms that the engine opens and ends itself: one a cause, and each cause by itself."""

from windsysid.live.watch.open_alarms import QUIET_NS, OpenAlarms
from windsysid.live.windows.streams import Verdict


def verdict(state: str, at: int) -> Verdict:
    return Verdict("tower_x_acceleration", state, at, at, state)


def test_a_drift_goes_on_while_a_spike_comes_and_goes():
    """Drift is found in windows, all else in blocks."""
    alarms = OpenAlarms("T1")
    (drift,) = alarms.sensor(verdict("drift", 10))
    (spikes,) = alarms.sensor(verdict("spikes", 20))
    assert (drift.ended, spikes.ended) == (None, None)
    ended, dead = alarms.sensor(verdict("dead", 30))
    assert (ended.key, ended.ended, dead.ended) == (spikes.key, 30, None)
    assert {one.key for one in alarms.sensor(verdict("good", 40))} == {dead.key, drift.key}


def test_an_alarm_of_the_stream_ends_when_it_was_quiet_for_a_while():
    alarms = OpenAlarms("T1")
    (alarm,) = alarms.data("refused", "warning", "blocks were refused", 5)
    assert alarms.data("refused", "warning", "blocks were refused", QUIET_NS) == []
    assert alarms.quiet(2 * QUIET_NS) == []
    (ended,) = alarms.quiet(2 * QUIET_NS + 1)
    assert (ended.key, ended.ended) == (alarm.key, 2 * QUIET_NS + 1)
