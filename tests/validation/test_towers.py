"""A tower that is as its file says is trusted; one that is not, is not, though spectra hardly show it."""

from typing import Literal

import numpy as np
import pytest
from validation.towers import record

from tests.findings import codes, notes, reasons
from windsysid.identification.identify import identify
from windsysid.results.identification import Identification
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine


def found(kind: str, seed: int = 501, formulation: Literal["auto", "spectral"] = "auto") -> Identification:
    return identify(record(kind, seed), "tower", prior=DrawnPrior(seed=seed), formulation=formulation)


@pytest.mark.slow
def test_a_tower_that_is_as_its_file_says_is_trusted():
    result, values = found("healthy"), load_turbine("tower").values
    assert result.formulation == "spectral"
    assert result.diagnosis.trusted
    assert "spectral_agrees" in codes(notes(result))
    assert max(np.abs([(e.estimate - values[e.name]) / e.std for e in result.estimates])) < 3.0


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("play of 0.3 σ", {"nonlinear_force"}),
        ("friction of 10 %", {"nonlinear_force", "amplitude_dependence"}),
    ],
)
@pytest.mark.slow
def test_what_spectra_hardly_show_is_seen_by_filters(kind: str, said: set[str]):
    result = found(kind)
    assert not result.diagnosis.trusted
    assert said.intersection(codes(reasons(result)))


@pytest.mark.slow
def test_a_hump_of_the_load_beside_a_mode_is_taken_into_account():
    result, values = found("hump fore-aft, 0.36 Hz", 760016, "spectral"), load_turbine("tower").values
    assert "narrow_band_load" in codes(result.findings)
    assert max(np.abs([(e.estimate - values[e.name]) / e.std for e in result.estimates])) < 3.0


@pytest.mark.slow
def test_a_hump_that_may_have_changed_places_with_the_mode_is_in_the_interval():
    """Both places explain the spectra, 0.5 of log evidence apart, and stiffness lies 9 σ elsewhere."""
    result = found("hump fore-aft, 0.36 Hz", formulation="spectral")
    stiffness, true = result["k_fore_aft"], load_turbine("tower").values["k_fore_aft"]
    assert stiffness.grade == "B"
    assert stiffness.low < 0.8 * stiffness.estimate, "the other place"
    assert stiffness.low < true < stiffness.high


@pytest.mark.slow
def test_a_load_is_found_where_the_prior_of_damping_is_as_low_as_its_width():
    """Damping was 37 σ off, and trusted: a prior drawn at 3 % of the truth began every search at the load's peak."""
    assert not found("all but a line, 0.31 Hz", 760023).diagnosis.trusted


@pytest.mark.slow
def test_what_spectra_doubt_stays_a_doubt_where_filters_end_there_too():
    """Damping was 29.6 σ off, and trusted: filters found the load's peak where spectra had, and were asked without the
    place from which the other explanation is found."""
    assert not found("all but a line, 0.31 Hz", 740011).diagnosis.trusted


@pytest.mark.slow
def test_a_spring_that_hardens_is_told_where_filters_and_spectra_disagree():
    """Filters saw it at 7.8 σ, but only their estimate was used: stiffness was 6.4 σ off with grade B."""
    result = found("hardening by 30 %", 950_000)
    assert {"amplitude_dependence", "nonlinear_force"}.intersection(codes(reasons(result)))
    assert {e.grade for e in result.estimates} == {"C"}
