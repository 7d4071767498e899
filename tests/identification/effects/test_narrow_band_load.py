"""When a narrow-band load is included, preferred, or denied by filters."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from tests.identification.fits import TOWER, fitted, job_of, noise, record_of
from windsysid.identification.effects import narrow_band_load as module
from windsysid.identification.effects.narrow_band_load import NarrowBandIncluded, NarrowBandLoad
from windsysid.identification.job import FittedJob
from windsysid.identification.model.effect import Detection
from windsysid.loads.narrow_band import FREQUENCY, NarrowBand
from windsysid.results.finding import Finding

RECORD = record_of(noise())


def alternative(*, is_needed: bool = True) -> Any:
    moved = {"k_side_side": 3.0}
    values = {FREQUENCY: 0.4}
    return SimpleNamespace(is_needed=is_needed, gain=23.0, rivals=(), moved=moved, shifts=moved, values=values)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Says what the spectra find."""
    return lambda one: monkeypatch.setattr(module, "narrow_band_beside", lambda *of: one)


def test_its_evidence_is_the_log_odds_of_spectra_and_the_search_begins_at_the_fit(found: Any):
    found(alternative())
    fit = fitted(RECORD)
    seen = NarrowBandLoad().detect(job_of(RECORD, formulation="spectral"), fit)
    assert isinstance(seen.inclusion, NarrowBandIncluded)
    assert seen.log10_odds == pytest.approx(23.0 / math.log(10.0))
    assert seen.start is fit
    assert not seen.fit.outcome.doubts


def test_it_speaks_against_a_fit_whose_loads_were_given(found: Any):
    found(alternative())
    seen = NarrowBandLoad().detect(job_of(RECORD, formulation="spectral", loads="broadband"), fitted(RECORD))
    assert seen.inclusion is None
    assert [one.code for one in seen.fit.outcome.doubts] == ["narrow_band_load_preferred"]


def test_nothing_is_said_where_spectra_do_not_apply_or_it_is_included(found: Any):
    found(None)
    job, fit = job_of(RECORD, formulation="spectral"), fitted(RECORD)
    assert NarrowBandLoad().detect(job, fit) == (fit, None, 0.0, None)
    found(alternative())
    included = NarrowBandIncluded(alternative())
    job = job.including(included)
    assert job.inclusion(NarrowBandIncluded) is included
    assert NarrowBandLoad().detect(job, fit) == (fit, None, 0.0, None)
    assert included.correct(RECORD, TOWER, TOWER.sensors, filtered=True) == (RECORD, TOWER.sensors)
    assert included.notes(fit.outcome, filtered=True) == ()


def test_filters_that_do_without_it_are_held_against_spectra():
    job, fit = job_of(RECORD), fitted(RECORD, "joint")
    included = Detection(fit, NarrowBandIncluded(alternative()), 10.0, fit)
    after = NarrowBandLoad().confirm(job, included, fitted(RECORD, "joint", hypothesis="broadband"))
    assert after is not None
    assert [one.code for one in after.outcome.doubts] == ["narrow_band_load_preferred"]
    spectral = fitted(RECORD)
    assert NarrowBandLoad().confirm(job, included, spectral) is spectral


def test_spectra_with_findings_against_them_are_no_evidence_against_filters(monkeypatch: pytest.MonkeyPatch):
    """Spectra that had taken the blade-passing frequency for the mode, and said so, condemned filters that had not."""
    monkeypatch.setattr(module, "doubts_of_narrow_band", lambda *found, asked: ())
    monkeypatch.setattr(module, "note_narrow_band", lambda found: Finding("spectral_with_filters", "note"))
    job, after = job_of(RECORD), fitted(RECORD, "joint", hypothesis=NarrowBand.name)
    start = fitted(RECORD, theta=after.outcome.theta + 0.1)

    def doubts(start: FittedJob) -> list[str]:
        found = NarrowBandLoad().confirm(job, Detection(after, NarrowBandIncluded(alternative()), 10.0, start), after)
        assert found is not None
        return [one.code for one in found.outcome.doubts]

    shown = {"frequency": 0.4, "sigmas": 1.0, "shifts": {}, "chance": 0.1}
    rival = Finding("narrow_band_load_ambiguous", "reason", shown, ("k_side_side",))
    assert doubts(start) == doubts(start.doubted(rival)) == ["formulations_disagree"]
    assert doubts(start.doubted(Finding("too_short_for_stationarity", "reason"))) == []
