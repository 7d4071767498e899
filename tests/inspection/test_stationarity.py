"""A stationary record of lightly damped modes is advised whole; one that changes is cut, and no part is too short."""

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.checks.limits import SCREENING_PROBABILITY
from windsysid.inspection.channels import kinds
from windsysid.inspection.sections import Proposal, propose_longest
from windsysid.inspection.stationarity import vibration_of
from windsysid.records.record import Record

RATE = 10.0
CHANNELS = ("tower_x_acceleration", "tower_z_acceleration")


def shaken(
    seed: int, damping: float, seconds: float, frequencies: tuple[float, ...] = (0.3, 0.31, 1.4),
    loads: tuple[float, float] | None = None,
) -> Record:  # fmt: skip
    """Accelerations of modes under white loads, which are `loads[1]` times as strong from the share `loads[0]` on."""
    rng = np.random.default_rng(seed)
    samples, before = int(seconds * RATE), int(min(1.0 / (damping * frequencies[0]), 2000.0) * RATE)
    strength = np.ones(samples + before)
    if loads is not None:
        strength[before + int(loads[0] * samples) :] = loads[1]
    values = np.zeros((samples, len(CHANNELS)))
    for i, frequency in enumerate(frequencies):
        pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency / RATE)
        force = strength * rng.standard_normal(samples + before)
        x = lfilter([1.0, -1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], force)[before:]
        values += np.outer(np.sqrt(damping * frequency) * x, rng.standard_normal(len(CHANNELS))) / (1.0 + i)
    values += 0.01 * values.std(axis=0) * rng.standard_normal(values.shape)
    return Record(np.arange(samples) / RATE, values, CHANNELS, ("m/s^2",) * 2, name="shaken")


def best(record: Record) -> Proposal:
    return propose_longest(record, kinds(record), None, [])[0]


def is_whole(record: Record) -> bool:
    found = best(record)
    return found.good and found.end - found.start >= record.duration


@pytest.mark.parametrize("damping", [0.005, *(pytest.param(ratio, marks=pytest.mark.slow) for ratio in (0.002, 0.05))])
@pytest.mark.parametrize("seconds", [300.0, pytest.param(900.0, marks=pytest.mark.slow)])
def test_a_stationary_record_is_advised_whole(damping: float, seconds: float):
    assert sum(not is_whole(shaken(seed, damping, seconds)) for seed in range(20)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.002, 0.005, 0.01, 0.05])
@pytest.mark.parametrize("seconds", [300.0, 900.0, 3600.0])
@pytest.mark.parametrize("frequencies", [(0.3,), (0.35, 2.8), (0.3, 0.31, 1.4)])
def test_false_alarms_are_as_rare_as_stated(damping: float, seconds: float, frequencies: tuple[float, ...]):
    alarms = sum(not is_whole(shaken(1000 + seed, damping, seconds, frequencies)) for seed in range(200))
    assert alarms <= 6  # 2 are expected at most; 7 of 200 have a chance of 0.5 %
    assert SCREENING_PROBABILITY <= 0.01


@pytest.mark.parametrize("damping", [0.01, *(pytest.param(ratio, marks=pytest.mark.slow) for ratio in (0.005, 0.05))])
@pytest.mark.parametrize("start", [0.33, 0.7, pytest.param(0.5, marks=pytest.mark.slow)])
def test_a_record_whose_loads_begin_within_it_is_cut(damping: float, start: float):
    found = [best(shaken(seed, damping, 1200.0, loads=(start, 3.0))) for seed in range(10)]
    assert sum(one.end - one.start > 1000.0 and one.good for one in found) <= 1


def test_a_step_of_the_amplitude_is_named():
    record = shaken(0, 0.01, 600.0)
    louder = np.where(record.time < 300.0, 1.0, 3.0)[:, None]
    record = Record(record.time, record.values * louder, record.channels, record.units, name="step")
    found = best(record)
    assert found.end - found.start <= 300.1
    (whole,) = [p for p in propose_whole(record) if p.end - p.start > 500.0]
    assert "the vibration grows by" in whole.against[0]
    assert "between its" in whole.against[0]


def propose_whole(record: Record) -> tuple[Proposal, ...]:
    from windsysid.inspection.sections import propose

    return propose(record, kinds(record), None, [], 1e9)


def test_no_part_is_proposed_that_is_too_short_to_identify_from():
    """Half of 400 s at 0.15 Hz is 30 periods."""
    for seed in range(10):
        record = shaken(seed, 0.01, 400.0, (0.15,), loads=(0.5, 5.0))
        assert best(record).end - best(record).start > 0.95 * 40.0 / 0.15


def test_degrees_of_freedom_are_those_of_the_resonance():
    """ν = 2 B_e T, B_e = 2πζf."""
    found = [vibration_of(shaken(seed, 0.01, 3600.0, (0.3,)), CHANNELS[0]) for seed in range(5)]
    degrees = np.mean([one.degrees[0] for one in found if one is not None])
    assert degrees == pytest.approx(2.0 * 2.0 * np.pi * 0.01 * 0.3 * 3600.0, rel=0.15)
    assert np.mean([one.cycles for one in found if one is not None]) == pytest.approx(0.3 * 3600.0, rel=0.02)


def test_what_does_not_move_or_is_missing_is_not_judged():
    record = shaken(0, 0.01, 300.0)
    still = record.with_channels({"flat_acceleration": (np.zeros(record.samples), "m/s^2")})
    assert vibration_of(still, "flat_acceleration") is None
    values = record.values.copy()
    values[500:900, 0] = np.nan
    gap = Record(record.time, values, record.channels, record.units, name="gap")
    found = vibration_of(gap, CHANNELS[0])
    assert found is not None
    assert found.weight.sum() < record.samples - 390


def test_a_long_record_is_looked_at_in_steps(monkeypatch: pytest.MonkeyPatch):
    record = shaken(0, 0.01, 600.0)
    monkeypatch.setattr("windsysid.inspection.stationarity.MAX_SAMPLES", 2500)
    found = vibration_of(record, CHANNELS[0])
    assert found is not None
    assert len(found.weight) == 2000
    assert is_whole(record)


def test_a_change_that_is_certain_but_small_is_said():
    record = shaken(0, 0.02, 1200.0)
    louder = np.linspace(1.0, 2.2, record.samples)[:, None]
    found = best(Record(record.time, record.values * louder, record.channels, record.units, name="ramp"))
    assert found.good
    assert "it grows by 1." in found.reasons[-1]
    assert "stationary" in best(record).reasons[-1]
