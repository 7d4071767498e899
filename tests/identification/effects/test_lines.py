"""Sinusoids that a fit lacks."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.identification.fits import CHANNELS, RATE, TOWER, fitted, job_of, noise, record_of
from windsysid.checks.lines import may_be_no_line
from windsysid.identification.effects import lines
from windsysid.identification.effects.lines import RotorHarmonic, Sinusoid
from windsysid.identification.effects.regression import MAX_REVISIONS
from windsysid.identification.effects.sinusoid import Sine
from windsysid.identification.effects.sinusoidal_force import SineForce, Sinusoids
from windsysid.records.record import Record

HZ = 0.36
TOWER_HZ = TOWER.natural_frequency("side_side") / (2.0 * np.pi)
TOWER_DAMPING = TOWER.damping("side_side") / TOWER.critical_damping("side_side")


@pytest.fixture
def no_refits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spectra are not fitted again: no coefficient depends on a frequency, and a line may do harm."""
    monkeypatch.setattr(lines, "doubt_line", lambda job, fit: None)
    monkeypatch.setattr(lines, "doubt_standing_out", lambda *of: None)


def with_tone(amplitude: float):
    readings = noise()
    readings[:, 0] += amplitude * np.sin(2.0 * np.pi * HZ * np.arange(len(readings)) / RATE)
    return record_of(readings)


@pytest.mark.usefixtures("no_refits")
def test_a_sinusoid_beside_a_mode_is_found_at_its_frequency():
    record = with_tone(1.0)
    found = Sinusoid().detect(job_of(record), fitted(record))
    assert isinstance(found.inclusion, Sinusoids)
    (sine,) = found.inclusion.sines
    assert sine.frequency == pytest.approx(HZ, abs=1e-3)
    assert not sine.on_blades
    assert found.fit.line is not None
    assert found.fit.line.channel == CHANNELS[0]


@pytest.mark.usefixtures("no_refits")
def test_noise_has_no_sinusoid_and_one_that_is_included_is_not_found_again():
    record = with_tone(0.0)
    assert Sinusoid().detect(job_of(record), fitted(record)).inclusion is None
    record = with_tone(1.0)
    job = job_of(record).including(Sinusoids((Sine(HZ, on_blades=False),)))
    assert job.inclusion(Sinusoids) is job.effects[0]
    assert Sinusoid().detect(job, fitted(record)._replace(unmodelled=())).inclusion is None


@pytest.mark.usefixtures("no_refits")
def test_a_resonance_that_is_narrower_than_the_record_resolves_is_no_sinusoid():
    """Damping was 4.3 σ off with grade A: in 30 s the support's own resonance was taken for a machine's sinusoid."""
    pole = np.exp((-TOWER_DAMPING + 1j) * 2.0 * np.pi * TOWER_HZ / RATE)

    def resonance(seed: int) -> Record:
        shocks = noise(seed)
        shocks[:, 0] = lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], shocks[:, 0])
        return record_of(shocks)

    found = [Sinusoid().detect(job_of(one), fitted(one)).inclusion for one in map(resonance, range(25, 33))]
    assert found == [None] * 8


def test_rotor_harmonics_are_not_tested_on_spectra():
    record = with_tone(0.0)
    job, fit = job_of(record, formulation="spectral"), fitted(record)
    assert job.inclusion(Sinusoids) is None
    assert RotorHarmonic().detect(job, fit) == (fit, None, 0.0, None)


@pytest.mark.parametrize(("hz", "turns"), [(0.6, True), (0.61, True), (0.63, False), (0.1, False)])
def test_frequencies_within_two_percent_of_a_harmonic_turn_with_the_rotor(hz: float, turns: bool):
    assert may_be_no_line(np.array([hz]), [], 0.2, 1e-3) == [turns]
    assert not may_be_no_line(np.array([hz]), [], 0.0, 1e-3)


@pytest.mark.parametrize(("revisions", "again"), [(0, 1), (MAX_REVISIONS - 1, 1), (MAX_REVISIONS, 0)])
def test_forces_are_estimated_again_so_many_times(monkeypatch: pytest.MonkeyPatch, revisions: int, again: int):
    record, sine, calls = with_tone(0.0), Sine(HZ, on_blades=False), []
    monkeypatch.setattr(lines, "linearise", lambda *of: calls.append(of))
    forces = (SineForce(sine, "load_side_side", "N", 1.0, 0.0, 0.1),)
    job = job_of(record).including(Sinusoids((sine,), forces, revisions=revisions))
    assert RotorHarmonic().detect(job, fitted(record)).inclusion is None
    assert len(calls) == again


@pytest.mark.parametrize("measured", [False, True], ids=["a wave that is no force yet", "all loads measured"])
def test_a_new_harmonic_does_not_displace_a_wave_and_needs_a_load(monkeypatch: pytest.MonkeyPatch, measured: bool):
    """A known wave was lost, and where all loads are measured the estimate ended in an IndexError."""
    record, wave, new = with_tone(0.0), Sine(2.0, on_blades=False), Sine(HZ, on_blades=False)
    if measured:
        loads = ("load_side_side", "load_fore_aft")
        record = record.with_channels(dict.fromkeys(loads, (0.0 * record.time, "N")))
    monkeypatch.setattr(lines, "_unknown", lambda *_: [new])
    asked = []
    monkeypatch.setattr(lines, "_as_forces", lambda _job, _fit, _judged, sines: asked.extend(sines))
    job = job_of(record)
    job = job if measured else job.including(Sinusoids((wave,)))
    RotorHarmonic().detect(job, fitted(record))
    assert asked == ([new] if measured else [wave, new])
