"""Readings that were pasted, lost or copied, and converters that ran over, are found; what looks like them is not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import windsysid as ws
from tests.findings import reasons
from windsysid.inspection.faults.continuity import copies_among
from windsysid.inspection.screening import doubted, examine, noted, screen
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record

pytestmark = pytest.mark.usefixtures("without_effects")


RATE = 50.0
NAMES = ("a_acceleration", "b_acceleration", "c_acceleration")


def vibration(
    seed: int, seconds: float = 600.0, heavy: float | None = None, blows: np.ndarray | tuple[int, ...] = ()
) -> np.ndarray:
    """Three channels (T, 3) [m/s²] of two modes at 0.8 and 2.1 Hz under noise or blows, and noise of their own."""
    random = np.random.default_rng(seed)
    count = int(seconds * RATE)
    shapes = np.array([[1.0, 0.6, -0.4], [0.5, -1.0, 0.8]])
    readings = 0.01 * random.standard_normal((count, 3))
    for frequency, damping, shape in zip((0.8, 2.1), (0.01, 0.015), shapes, strict=True):
        omega, step = 2.0 * np.pi * frequency, 1.0 / RATE
        radius = np.exp(-damping * omega * step)
        push = random.standard_normal(count) if heavy is None else random.standard_t(heavy, count)
        push[list(blows)] += 15.0
        pole = [1.0, -2.0 * radius * np.cos(omega * step), radius**2]
        readings += np.outer(lfilter([1.0, -2.0, 1.0], pole, lfilter([1.0], [1.0, -0.8], push)), shape)
    return readings


def record_of(values: np.ndarray) -> Record:
    return Record(np.arange(len(values)) / RATE, values, NAMES[: values.shape[1]], units=("m/s^2",) * values.shape[1])


def kinds_of(values: np.ndarray) -> set[str]:
    return {finding.kind for finding in examine(record_of(values), None)[0] if finding.severity != "note"}


@pytest.mark.parametrize("seed", range(6))
def test_healthy_vibration_goes_on(seed):
    assert kinds_of(vibration(seed)) == set()


@pytest.mark.parametrize("heavy", [2.0, *(pytest.param(tails, marks=pytest.mark.slow) for tails in (3.0, 5.0))])
def test_blows_are_not_lost_samples(heavy):
    for seed in range(4):
        assert "lost samples" not in kinds_of(vibration(seed, heavy=heavy))


@pytest.mark.parametrize("scale", [0.7, 1e-3, 1e4])
def test_a_record_pasted_behind_itself_is_found(scale):
    values = scale * vibration(1, 300.0)
    findings, _, _ = examine(record_of(np.vstack([values, values])), None)
    (found,) = [f for f in findings if f.kind == "copied passage"]
    assert found.count == len(values)
    assert np.allclose(found.spans, [[300.0, 599.98]])


def test_a_short_passage_in_the_place_of_another_is_found_where_it_is():
    values = vibration(2)
    values[10_000:10_050] = values[4_000:4_050]
    (found,) = [f for f in examine(record_of(values), None)[0] if f.kind == "copied passage"]
    assert found.count == 50
    assert np.allclose(found.spans, [[200.0, 200.98]])
    assert "as from 80 s on" in found.text


def test_a_coarse_converter_and_a_held_channel_repeat_nothing():
    values = vibration(3)
    steps = values.std(axis=0) / 3.0
    assert "copied passage" not in kinds_of(np.round(values / steps) * steps)
    assert "copied passage" not in kinds_of(np.repeat(values[::10], 10, axis=0))


@pytest.mark.parametrize(("every", "lost"), [(10.0, 0.5), (5.0, 0.1), (60.0, 2.0)])
def test_buffers_that_were_lost_without_a_gap_in_time_are_found(every, lost):
    values = vibration(4)
    kept = np.mod(np.arange(len(values)), int(every * RATE)) >= int(lost * RATE)
    (found,) = [f for f in examine(record_of(values[kept]), None)[0] if f.kind == "lost samples"]
    assert f"multiples of {every - lost:g} s" in found.text
    assert found.count >= 6


def test_lost_buffers_are_found_among_blows():
    """Breaks at multiples were expected to be four fifths of all: blows hid them."""
    values = vibration(8115, 600.0, heavy=3.0)
    kept = np.mod(np.arange(len(values)), 750) >= 50
    (found,) = [f for f in examine(record_of(values[kept]), None)[0] if f.kind == "lost samples"]
    assert "multiples of 14 s" in found.text


@pytest.mark.parametrize(("turn", "of"), [(8.38, 1), (8.38, 3), (5.0, 2)])
def test_blows_in_step_with_the_rotor_are_no_lost_samples(turn, of):
    """A blade that passes the tower excites every sensor once a turn, as lost buffers would."""
    passages = np.arange(1.0, 599.0, turn / of)
    struck = np.random.default_rng(11).permutation(passages)[: len(passages) * 3 // 4]
    values = vibration(11, blows=np.round(struck * RATE).astype(int))
    assert "lost samples" in kinds_of(values)
    speed = np.full((len(values), 1), 2.0 * np.pi / turn)
    record = Record(
        record_of(values).time, np.hstack([values, speed]), (*NAMES, "rotor_speed"), (*("m/s^2",) * 3, "rad/s")
    )
    assert "lost samples" not in {finding.kind for finding in examine(record, None)[0]}


def test_lost_buffers_are_found_where_a_rotor_turns():
    values = vibration(4)
    values = values[np.mod(np.arange(len(values)), 500) >= 25]
    speed = np.full((len(values), 1), 2.0 * np.pi / 8.38)
    record = Record(
        record_of(values).time, np.hstack([values, speed]), (*NAMES, "rotor_speed"), (*("m/s^2",) * 3, "rad/s")
    )
    assert "lost samples" in {finding.kind for finding in examine(record, None)[0]}


@pytest.mark.parametrize("times", [2.0, 3.0])
def test_a_converter_that_ran_over_is_found(times):
    values = vibration(5)
    end = times * values.std(axis=0)
    assert "overrun" in kinds_of(np.mod(values + end, 2.0 * end) - end)


def test_spikes_clipping_and_white_noise_are_no_overrun():
    random = np.random.default_rng(6)
    values = vibration(6)
    spiked = values.copy()
    spiked[500::500] += 20.0 * values.std(axis=0)
    up_and_down = values.copy()
    up_and_down[500::500] += 30.0 * values.std(axis=0) * random.choice([-1.0, 1.0], (59, 1))
    end = 1.5 * values.std(axis=0)
    for each in (spiked, up_and_down, np.clip(values, -end, end), random.standard_normal((30_000, 2))):
        assert "overrun" not in kinds_of(each)


@pytest.mark.parametrize("every", [10, 16, 20, 25])
def test_few_readings_a_period_are_no_overrun(every):
    for seed in range(5):
        values = vibration(seed)[::every]
        slow = Record(np.arange(len(values)) * every / RATE, values, NAMES, units=("m/s^2",) * 3)
        assert "overrun" not in {finding.kind for finding in examine(slow, None)[0]}


def test_a_copy_may_have_another_scale_offset_and_sign():
    first, second = vibration(1, 60.0)[:, 0], vibration(2, 60.0)[:, 0]
    assert copies_among(np.column_stack([first, second, 3.0 - 2.0 * first, 0.5 * second])) == [(0, 2), (1, 3)]


def test_a_copy_of_a_sensor_is_a_doubt_and_two_sensors_close_by_are_not():
    values = vibration(7)
    copied = record_of(np.column_stack([values[:, 0], 0.5 * values[:, 0] + 3.0, values[:, 1]]))
    findings = screen(copied, None, NAMES)
    assert [f.channel for f in findings if f.kind == "copy"] == ["b_acceleration"]
    (reason,) = doubted(findings)
    assert (reason.code, reason.severity, reason.channels) == ("copy", "reason", ("b_acceleration",))
    assert reason.data["of"] == "a_acceleration"
    assert not noted(findings)
    near = values[:, 0] + 0.01 * np.random.default_rng(7).standard_normal(len(values))
    assert not screen(record_of(np.column_stack([values[:, 0], near, values[:, 1]])), None, NAMES)


@pytest.mark.parametrize(
    "formulation", ["spectral", *(pytest.param(one, marks=pytest.mark.slow) for one in ("auto", "joint"))]
)
def test_no_identification_from_a_pasted_record_is_trusted(formulation):
    tower = ws.load_turbine("tower")
    once = simulate_record(tower, duration=600.0, rate=20.0, seed=11)
    steps = np.arange(2 * once.samples) / 20.0
    twice = replace(once, time=steps, values=np.vstack([once.values, once.values]))
    assert ws.identify(once, tower, formulation=formulation).diagnosis.trusted
    found = ws.identify(twice, tower, formulation=formulation).diagnosis
    assert not found.trusted
    assert reasons(found)[0].code == "copied_passage"


def test_no_modes_from_a_pasted_record_are_trusted():
    values = vibration(8, 150.0)
    assert "repeat earlier rows" in ws.oma(record_of(np.vstack([values, values]))).reasons[0]


@pytest.mark.parametrize("lost", ["rows", "buffers", "readings"])
def test_the_verdict_and_the_findings_give_the_same_advice(lost):
    """A section was to be chosen, and all of the record to be used."""
    values = vibration(4)
    record = record_of(values)
    if lost == "rows":
        kept = np.r_[: len(values) // 3, len(values) // 3 + 200 : len(values)]
        record = Record(record.time[kept], values[kept], NAMES, ("m/s^2",) * 3)
    elif lost == "buffers":
        record = record_of(values[np.mod(np.arange(len(values)), 1500) >= 25])
    else:
        values[4000:4200, 1] = np.nan
        record = record_of(values)
    found = ws.inspect(record)
    asked = any("choose a section" in finding.text for finding in found.findings)
    assert asked == (lost == "buffers")
    assert ("use all of it" in found.verdict) != asked, found.verdict
