"""Faults of sensors are told within seconds, and healthy channels are left alone."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import windsysid as ws
from tests.live.streaming import NOON, blocks_of, record
from windsysid.fleet.rows import empty_row
from windsysid.live.windows.streams import Drift, StreamHealth, Verdict, drifts, sensor_alarm
from windsysid.live.windows.timeline import SECOND
from windsysid.records.record import Record

RATE = 50.0
FAULT = 300.0
"""When the fault begins [s]."""


def watched(given: Record, size: int = 50) -> list[Verdict]:
    health = StreamHealth()
    return [verdict for block in blocks_of(given, RATE, size) for verdict in health.take(block)]


def faulty(spoil: Callable[[np.ndarray, np.random.Generator], None], until: float = 900.0) -> list[Verdict]:
    """What is told of a channel that is spoilt from `FAULT` to `until` [s], of a quarter of an hour."""
    given = record(45_000, RATE, seed=5)
    values = given.values.copy()
    spoil(values[round(FAULT * RATE) : round(until * RATE), 0], np.random.default_rng(1))
    return watched(replace(given, values=values))


def stick(x: np.ndarray, _: np.random.Generator) -> None:
    x[:] = x[0]


def die(x: np.ndarray, _: np.random.Generator) -> None:
    x[:] = np.nan


def drop(x: np.ndarray, rng: np.random.Generator) -> None:
    x[rng.random(len(x)) < 0.5] = np.nan


def clip(x: np.ndarray, _: np.random.Generator) -> None:
    np.clip(x, -1.0, 1.0, out=x)


def spike(x: np.ndarray, rng: np.random.Generator) -> None:
    x[rng.integers(0, len(x), len(x) // 300)] += 40.0


SPOILERS = {"stuck": stick, "dead": die, "missing": drop, "clipping": clip, "spikes": spike}
SECONDS = {"stuck": 20.0, "dead": 20.0, "missing": 60.0, "clipping": 130.0, "spikes": 90.0}
"""Within which each fault is told."""


@pytest.mark.parametrize("fault", SPOILERS)
def test_a_fault_is_told_in_time_of_its_channel_only_and_once(fault):
    told = faulty(SPOILERS[fault])
    assert [(verdict.channel, verdict.state) for verdict in told] == [("tower_x_acceleration", fault)]
    begun = (told[0].at - NOON) / SECOND - FAULT
    assert 0.0 < begun <= SECONDS[fault]
    if fault in ("stuck", "dead"):
        assert abs((told[0].since - NOON) / SECOND - FAULT) < 0.1
    assert "check" in told[0].text or "gain" in told[0].text


@pytest.mark.parametrize("fault", SPOILERS)
def test_a_fault_ends_when_the_channel_has_been_good_for_a_while(fault):
    told = faulty(SPOILERS[fault], until=450.0)
    assert [verdict.state for verdict in told] == [fault, "good"]
    assert (told[1].at - NOON) / SECOND > 450.0 + 100.0


@pytest.mark.parametrize(("turbine", "rate", "duration"), [("tower", 50.0, 600.0), ("verne555", 50.0, 200.0)])
def test_healthy_records_raise_nothing(turbine, rate, duration):
    assert watched(ws.simulate(turbine, duration=duration, rate=rate, seed=11)) == []


def test_a_coarse_converter_is_healthy():
    given = record(45_000, RATE, seed=3)
    assert watched(replace(given, values=np.round(given.values * 4.0) / 4.0)) == []


def test_a_slow_channel_is_healthy():
    given = record(45_000, RATE, seed=3)
    values = given.values.copy()
    values[np.arange(45_000) % 50 != 0, 1] = np.nan
    assert watched(replace(given, values=values)) == []


def test_a_channel_of_few_samples_is_not_dead_between_them():
    given = record(45_000, RATE, seed=3)
    values = given.values.copy()
    values[np.arange(45_000) % 750 != 0, 1] = np.nan  # one in 15 s
    assert watched(replace(given, values=values)) == []


def test_a_level_that_jumps_and_stays_is_no_spike():
    given = record(45_000, RATE, seed=3)
    jumping = given.values + 40.0 * (np.arange(45_000) // 330 % 2)[:, None]
    assert watched(replace(given, values=jumping)) == []


def test_a_rotor_that_stops_and_starts_again_is_healthy():
    given = record(45_000, RATE, seed=3)
    speed = np.interp(np.arange(45_000) / RATE, [0, 200, 260, 600, 700], [1.2, 1.2, 0.0, 0.0, 1.2])
    speed += np.where(speed > 0.0, 0.01 * given.values[:, 1], 0.0)
    turning = given.values * np.maximum(speed, 0.05)[:, None]
    assert watched(
        replace(
            given, values=np.column_stack([turning, speed]), channels=(*given.channels, "rotor_speed"),
            units=(*given.units, "rad/s"),
        )
    ) == []  # fmt: skip


def test_size_of_blocks_hardly_matters():
    given = record(45_000, RATE, seed=5)
    values = given.values.copy()
    values[15_000:, 0] = values[15_000, 0]
    for size in (10, 3000):
        told = watched(replace(given, values=values), size)
        assert [(verdict.channel, verdict.state) for verdict in told] == [("tower_x_acceleration", "stuck")]


def test_a_sensor_alarm_says_what_since_when_and_what_to_do():
    verdict = faulty(die)[0]
    alarm = sensor_alarm("T01", verdict)
    assert alarm.kind == "sensor"
    assert (alarm.about, alarm.earliest, alarm.opened) == ("tower_x_acceleration", verdict.since, verdict.at)
    assert "check sensor, cable and logger" in alarm.text
    assert alarm.key == sensor_alarm("T01", verdict).key


def drifted(means: list[float]) -> list[tuple[int, str]]:
    known: Drift = {}
    told = []
    for i, mean in enumerate(means):
        channel = {"name": "tower_x_acceleration", "unit": "m/s^2", "mean": mean, "std": 0.01}
        row = empty_row("x", 1, "s") | {"channels": [channel]}
        known, verdicts = drifts(known, row, i * 600 * SECOND, (i + 1) * 600 * SECOND)
        told += [(i, verdict.state) for verdict in verdicts]
    assert len(known["tower_x_acceleration"]) == 5
    return told


def test_a_drift_is_told_after_three_windows_and_ends_when_it_is_back():
    rng = np.random.default_rng(2)
    usual = 0.02 * rng.standard_normal(300)
    gone = np.linspace(0.0, 2.0, 100)
    told = drifted([*usual, *gone, *usual[:50]])
    assert [state for _, state in told] == ["drift", "good"]
    assert 300 < told[0][0] < 340
    assert 400 <= told[1][0] < 405


def test_one_or_two_odd_windows_are_no_drift():
    usual = list(0.02 * np.random.default_rng(4).standard_normal(300))
    assert drifted([*usual, 5.0, *usual[:20], 5.0, 5.0, *usual[:20]]) == []


def test_means_that_wander_as_they_always_did_are_no_drift():
    rng = np.random.default_rng(3)
    for _ in range(5):
        day = np.sin(np.arange(2000) / 144.0 * 2.0 * np.pi)
        assert drifted(list(0.1 * day + 0.02 * rng.standard_normal(2000))) == []
