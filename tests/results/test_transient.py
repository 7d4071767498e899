"""Free decays are recognised by their readings, and no cause is named that tests of stationary loads suppose."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.findings import codes, notes, only, reasons, remarks
from tests.identification.fits import identify_without_effects
from windsysid._types import Array
from windsysid.checks.verdict import Diagnosis
from windsysid.identification.identify import identify
from windsysid.identification.verdict import conclude
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.transient import Transient, explain_by_transient, find_burst, find_transient
from windsysid.turbine.file import load_turbine

RATE = 4.0
CAUSES = ("machine", "waves", "spikes", "swell", "friction", "loads of another kind", "logger", "changed")


def decay(
    frequency: float, damping: float, duration: float, *, start: float = 0.0, noise: float = 0.01, seed: int = 0
) -> Array:
    """Readings (T,) of a mode that is let go at a time [s], with white noise."""
    time = np.arange(int(duration * RATE)) / RATE - start
    rng, omega = np.random.default_rng(seed), 2.0 * np.pi * frequency
    free = np.exp(-damping * omega * time.clip(0.0)) * np.cos(omega * np.sqrt(1.0 - damping**2) * time)
    return np.where(time >= 0.0, free, 0.0) + noise * rng.standard_normal(time.size)


def ambient(frequency: float, damping: float, duration: float, seed: int) -> Array:
    """Readings (T,) of a mode under white noise."""
    samples = int(duration * RATE)
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency / RATE)
    load = np.random.default_rng(seed).standard_normal(8 * samples)
    return np.asarray(lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], load)[-samples:])


@pytest.mark.parametrize(
    ("damping", "duration", "start"),
    [
        (0.012, 120.0, 0.0),
        (0.02, 60.0, 0.0),
        (0.005, 300.0, 0.0),
        (0.012, 300.0, 25.0),
        (0.05, 120.0, 25.0),
        (0.012, 120.0, 5.0),
    ],
)
def test_free_decays_are_found_also_where_they_begin_later(damping: float, duration: float, start: float):
    found = find_transient(decay(0.35, damping, duration, start=start)[:, None], ("x",))
    assert found is not None
    assert found.fall > 3.0
    assert found.channels == ("x",)


@pytest.mark.parametrize(("damping", "duration"), [(0.005, 120.0), (0.012, 180.0), (0.03, 270.0)])
def test_stationary_records_fall_so_by_chance_in_at_most_one_of_fifty(damping: float, duration: float):
    found = [find_transient(ambient(0.35, damping, duration, seed)[:, None], ("x",)) for seed in range(200)]
    assert sum(one is not None for one in found) <= 4


def test_a_decay_of_less_than_a_factor_of_three_is_found_where_all_channels_fall():
    x, z = decay(0.35, 0.006, 60.0), 0.3 * decay(0.352, 0.007, 60.0, noise=0.03, seed=1)
    assert find_transient(x[:, None], ("x",)) is None
    found = find_transient(np.column_stack([x, z]), ("x", "z"))
    assert found is not None
    assert set(found.channels) == {"x", "z"}
    assert 1.5 < found.fall < 3.0
    assert find_transient(np.column_stack([x, ambient(0.35, 0.01, 60.0, 2)]), ("x", "z")) is None


def test_a_channel_of_noise_or_gaps_is_no_transient():
    rng = np.random.default_rng(1)
    readings = np.column_stack([rng.standard_normal(480), decay(0.35, 0.012, 120.0), np.full(480, np.nan)])
    readings[100:130, 1] = np.nan
    found = find_transient(readings, ("noise", "decay", "dead"))
    assert found is not None
    assert found.channels == ("decay",)
    assert find_transient(readings[:, [0, 2]], ("noise", "dead")) is None


def test_only_causes_in_channels_that_fall_are_replaced():
    line, dead, short = (
        Finding("spectral_line", "reason", {"channel": "x", "frequency": 1.0, "rotor_frequency": 0.0}),
        Finding("dead_channel", "reason", {"channels": ["y"]}),
        Finding("too_short_for_stationarity", "reason"),
    )
    tails = Finding("heavy_tails", "remark", {"channel": "x", "kurtosis": 1.2})
    because = Finding("joint_as_spectra_are_doubtful", "note", {"because": line})
    diagnosis = Diagnosis((line, dead, short, tails, because), None, (), 0.0, 0, (0.0, 1.0))
    fall = Transient(("x",), 12.0)
    found = explain_by_transient(diagnosis, fall, ("x", "y"))
    assert reasons(found) == [fall.finding, dead, short]
    (remark,) = remarks(found)
    assert (remark.code, remark.data["cause"]) == ("heavy_tails", "transient")
    assert str(remark) == "the prediction errors of x have heavy tails (excess kurtosis 1.2)"
    (note,) = notes(found)
    assert note.data["because"]["data"]["cause"] == "transient"
    assert str(note).endswith("as spectra are in doubt (x has a sinusoid at 1 Hz, near a natural frequency)")
    unchanged = replace(diagnosis, findings=(dead, short))
    assert explain_by_transient(unchanged, fall, ("x", "y")) == unchanged


def test_a_free_decay_is_not_blamed_on_loads_of_a_machine():
    x, z = decay(0.35, 0.012, 120.0, noise=0.02, seed=3), 0.3 * decay(0.352, 0.015, 120.0, noise=0.06, seed=4)
    record = Record(
        np.arange(x.size) / RATE, 0.2 * np.column_stack([x, z]), ("tower_x_acceleration", "tower_z_acceleration"),
        ("m/s^2",) * 2,
    )  # fmt: skip
    found = identify(record, load_turbine("tower"), formulation="spectral")
    assert not found.diagnosis.trusted
    assert found.findings[0].code == "transient"
    said = " ".join([*found.diagnosis.reasons, *found.diagnosis.remarks, *found.notes])
    assert not any(cause in said for cause in CAUSES), said


@pytest.mark.parametrize("damping", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("duration", [150.0, 600.0])
def test_a_stationary_vibration_has_no_burst(damping, duration):
    for seed in range(50):
        readings = np.column_stack([ambient(0.33, damping, duration, 2 * seed + k) for k in (0, 1)])
        assert find_burst(readings, ("x", "z"), RATE) is None


@pytest.mark.parametrize(("start", "segment"), [(0.0, 0), (155.0, 6)])
def test_a_blow_in_ambient_vibration_is_found_with_its_time(start, segment):
    noise = ambient(0.33, 0.02, 400.0, 5)
    blow = decay(0.33, 0.02, 400.0, start=start, noise=0.0)
    found = find_burst((blow + 0.07 * noise / noise.std())[:, None], ("x",), RATE)
    assert found is not None
    assert found.segment == segment
    assert (found.data["start"], found.data["end"]) == (25 * segment, 25 * segment + 25)


def blow_at(start):
    """A record of the tower that something hits after `start` seconds."""
    parts = ((0.31, 0.02, 1), (0.39, 0.03, 2))
    noise = [ambient(f, z, 400.0, seed) for f, z, seed in parts]
    y = np.column_stack([
        decay(f, z, 400.0, start=start, noise=0.002, seed=seed) + 0.07 * one / one.std()
        for (f, z, seed), one in zip(parts, noise, strict=True)
    ])  # fmt: skip
    channels = "tower_x_acceleration", "tower_z_acceleration"
    return Record(np.arange(len(y)) / RATE, 0.5 * y, channels, ("m/s^2",) * 2, "blow")


@pytest.mark.parametrize(("start", "expected"), [(0.0, []), (155.0, ["late_burst"])])
def test_a_blow_after_the_beginning_is_a_reason_against_filters(start, expected):
    record = blow_at(start)
    read: Any = SimpleNamespace(channels=record.channels)
    assert [one.code for one in conclude._burst(read, record)] == expected


@pytest.mark.parametrize(
    ("start", "formulation"),
    [(0.0, "spectral"), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((0.0, "auto"), (155.0, "joint")))],
)
def test_a_blow_in_ambient_vibration_is_not_trusted(start, formulation):
    """The file damps side-side with 0.6 %, the record has 2 %: without this reason the bands lay 5 σ off."""
    result = identify_without_effects(blow_at(start), load_turbine("tower"), formulation=formulation)
    assert not result.diagnosis.trusted
    if start:
        assert "late_burst" in codes(reasons(result))
    elif formulation == "spectral":
        assert "burst" in codes(reasons(result))
    else:  # filters learn the state at the beginning
        assert only(result.findings, "joint_as_spectra_are_doubtful").data["because"]["code"] == "burst"
