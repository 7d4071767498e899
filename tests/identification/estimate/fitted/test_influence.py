"""Influence of one frequency of a record on the coefficients of a fit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.identification.fits import CHANNELS, RATE, SAMPLES, fitted, job_of, noise, record_of
from windsysid.checks.lines import Line
from windsysid.checks.widening import SIGMAS
from windsysid.errors import RecordError
from windsysid.identification.estimate.fitted import influence
from windsysid.identification.estimate.fitted.influence import (
    doubt_line,
    doubt_sine,
    doubt_standing_out,
)
from windsysid.identification.model.fit import Outcome
from windsysid.records.record import Record

HZ = 75.0 * RATE / SAMPLES
TIME = np.arange(SAMPLES) / RATE
STD = 0.01


def tone(amplitude: float, seed: int = 1) -> Record:
    return record_of(noise(seed) + amplitude * np.sin(2.0 * np.pi * HZ * TIME)[:, None])


@pytest.fixture
def refits(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Says by how many standard deviations the first coefficient changes in a fit of another record than the first."""

    def change(sigmas: float | Exception) -> list[Record]:
        read: list[Record] = []

        def identify(record: Record, *of: Any, loads: str) -> Outcome:
            assert loads == "broadband"
            read.append(record)
            if isinstance(sigmas, Exception):
                raise sigmas
            outcome = fitted(record, std=STD).outcome
            shift = sigmas * STD * np.eye(len(outcome.theta))[0]
            return outcome._replace(theta=outcome.theta + shift)

        monkeypatch.setattr(influence, "identify_by_spectrum", identify)
        return read

    return change


def power_at(record: Record, hz: float) -> np.ndarray:
    wave = np.exp(-2j * np.pi * hz * TIME)
    return np.asarray(np.abs(wave @ (record.values[:, :2] - record.values[:, :2].mean(axis=0))) / SAMPLES)


def test_a_coefficient_that_changes_without_a_line_is_named(refits: Any):
    read = refits(5.0)
    record = tone(1.5)
    found = doubt_line(job_of(record), fitted(record, std=STD))
    assert found is not None
    assert found.frequency == found.doubt.data["frequency"] == pytest.approx(HZ, rel=1e-9)
    assert (found.doubt.code, found.doubt.data["sigmas"]) == ("line_influence", pytest.approx(5.0))
    assert found.doubt.quantities == (fitted(record).outcome.model.parameters[0].name,)
    (without,) = read
    assert np.all(power_at(without, HZ) < 0.1 * power_at(record, HZ))


def test_a_line_on_which_nothing_depends_is_no_reason(refits: Any):
    refits(0.9 * SIGMAS)
    record = tone(1.5)
    job, fit = job_of(record), fitted(record, std=STD)
    assert doubt_line(job, fit) is None
    assert doubt_sine(HZ, job, fit) == ()
    (found,) = doubt_standing_out(Line(CHANNELS[0], HZ, 11.0, 10.0), job, fit, 0.2) or ()
    assert (found.code, found.data["rotor_frequency"], found.data["chance"]) == ("spectral_line", 0.2, 1.0)


def test_a_line_is_not_harmless_where_something_depends_on_it_or_spectra_do_not_apply(refits: Any):
    record = tone(1.5)
    job, fit = job_of(record), fitted(record, std=STD)
    line = Line(CHANNELS[0], HZ, 10.0, 10.0)
    refits(RecordError("too short"))
    assert doubt_standing_out(line, job, fit, 0.2) is None
    refits(1.1 * SIGMAS)
    record = tone(1.5)
    job, fit = job_of(record), fitted(record, std=STD)
    (found,) = doubt_standing_out(line, job, fit, 0.2) or ()
    name = fit.outcome.model.parameters[0].name
    assert (found.code, found.quantities) == ("line_influence", (name,))
    assert abs(found.data["shifts"][name]) == pytest.approx(1.1 * SIGMAS * STD)


def test_filters_are_compared_by_spectra_of_the_record_as_it_is(refits: Any):
    read = refits(5.0)
    record = tone(1.5)
    assert doubt_sine(HZ, job_of(record), fitted(record, "joint", std=STD)) == ()  # both spectra changed alike
    assert len(read) == 2
    assert read[1] is record


def test_filters_and_spectra_that_read_the_same_have_one_influence(refits: Any):
    read = refits(5.0)
    record, other = tone(1.5), tone(1.5, seed=2)
    job, fits = job_of(record), [fitted(record, by, std=STD) for by in ("spectral", "joint")]
    line = Line(CHANNELS[0], HZ, 10.0, 10.0)
    first, again = (doubt_standing_out(line, job, fit, 0.2) for fit in fits)
    assert first == again != ()
    assert len(read) == 1
    influence._influence(job, fits[0], 1.1 * HZ)
    influence._influence(job, fitted(other, std=STD), HZ)
    influence._influence(replace(job, turbine=replace(job.turbine)), fits[0], HZ)
    assert len(read) == 4


def test_power_beside_a_sine_is_left_as_strong_as_its_surroundings():
    record = tone(3.0)
    left = influence._without(record, CHANNELS, HZ, 3)
    assert np.all(power_at(left, HZ) < 0.3 * power_at(record, HZ))
    far = HZ + 40.0 * RATE / SAMPLES
    np.testing.assert_allclose(power_at(left, far), power_at(record, far), rtol=0.05)
