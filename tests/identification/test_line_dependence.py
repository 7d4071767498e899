"""A line that was taken for a mode's peak is found by what the result is without it."""

import pytest
from validation.adversary.loads import plus_line
from validation.adversary.machine import Machine
from validation.adversary.scenarios import SCENARIOS, Scenario, record

from tests.findings import only, reasons
from windsysid.identification import pipeline
from windsysid.identification.identify import identify
from windsysid.results.identification import Identification
from windsysid.study.drawn_prior import DrawnPrior


def identified(name: str, seed: int) -> Identification:
    return identify(
        record(name, seed), "verne555", prior=DrawnPrior(seed=seed), formulation="spectral", loads="broadband"
    )


@pytest.mark.slow
def test_a_line_that_does_not_stand_out_is_found(monkeypatch: pytest.MonkeyPatch):
    """Stiffness came out five standard deviations too small, and trusted."""
    monkeypatch.setattr(pipeline, "MAX_EXTENSIONS", 0)
    said = reasons(identified("line 5 % from a mode", 8000))
    assert only(said, "line_influence").quantities[0] == "k_x"
    for code in ("line_influence", "narrow_band_load_preferred"):
        assert only(said, code).data["frequency"] == pytest.approx(1.64, abs=0.005)


@pytest.mark.slow
def test_a_line_that_does_not_stand_out_is_left_out():
    found = identified("line 5 % from a mode", 8000)
    assert not [one for one in reasons(found) if one.data.get("frequency") == pytest.approx(1.64, abs=0.005)]
    assert only(found.findings, "tone_removed").data["frequency"] == pytest.approx(1.64, abs=0.005)
    errors = [(e.estimate - Machine().truth[e.name]) / e.std for e in found.estimates]
    assert max(abs(z) for z in errors) < 3.0


@pytest.mark.slow
def test_a_fainter_line_is_found(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(SCENARIOS, "faint", Scenario("line", plus_line(1.64, 0.02, (0,))))
    found = identified("faint", 208)
    said = [one for one in found.findings if one.code in ("line_influence", "tone_removed")]
    assert any(one.data["frequency"] == pytest.approx(1.64, abs=0.005) for one in said)


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.slow) for seed in (6003, 6012, 6033)])
def test_a_loud_frequency_that_says_little_by_itself_is_no_line(seed: int):
    """One of chance, 9 times as loud as its surroundings."""
    assert identified("reference", seed).diagnosis.trusted


@pytest.mark.slow
def test_a_line_that_chance_may_show_and_nothing_depends_on_is_no_reason():
    """It is 1.12 times its bound, in one blade; the record has none."""
    found = identify(record("one blade 2 % more", 120004), "verne555", prior=DrawnPrior(seed=120004))
    assert found.diagnosis.trusted
    assert found.diagnosis.line is None
