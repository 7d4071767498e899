"""A narrow-band load weighed by its evidence and by what it changes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.fits import TOWER
from windsysid.checks.limits import STRONG_LOG_ODDS
from windsysid.checks.widening import mixture_factor
from windsysid.identification.estimate.spectral.narrow_band import (
    NarrowBandFit,
    Rival,
    _widths,
    doubts_of_narrow_band,
    fit_narrow_band,
    note_narrow_band,
)
from windsysid.identification.limits import NEGLIGIBLE_SHIFT_SIGMAS
from windsysid.loads.narrow_band import FREQUENCY, WIDTH, narrow_band_statistics
from windsysid.loads.statistics import coordinates_of
from windsysid.statespace.unknowns import Unknowns

STATISTICS = narrow_band_statistics(TOWER, TOWER.loads)
VALUES = {one.name: one.given for one in STATISTICS} | {FREQUENCY: 0.4, WIDTH: 0.02, STATISTICS[-1].name: 9e3}
QUESTION: Any = SimpleNamespace(parameters=[SimpleNamespace(name="k_x"), SimpleNamespace(name="c_x")])


def narrow(
    gain: float = 2.0 * STRONG_LOG_ODDS,
    moved: float = 2.0 * NEGLIGIBLE_SHIFT_SIGMAS,
    rivals: tuple[Rival, ...] = (),
) -> Any:
    """A fit with such a load of `VALUES`."""
    eta = coordinates_of(STATISTICS, VALUES)
    fit: Any = SimpleNamespace(unknowns=None, model=SimpleNamespace(split_statistics=lambda unknowns: (eta, None)))
    posed: Any = SimpleNamespace(model=SimpleNamespace(sources=SimpleNamespace(statistics=STATISTICS)))
    return NarrowBandFit(posed, fit, gain, {"k_x": 0.1, "c_x": -moved}, {"k_x": 0.01, "c_x": -0.1 * moved}, rivals)


def end(*theta: float, log_evidence: float = 0.0) -> Any:
    """Where a search ended, with standard deviations of 0.1."""
    model = SimpleNamespace(unknowns=Unknowns(parameters=("k_x", "c_x")))
    return SimpleNamespace(unknowns=np.array(theta), cov=0.01 * np.eye(2), model=model, log_evidence=log_evidence)


def test_it_is_needed_where_its_evidence_is_clear_and_a_coefficient_changes():
    assert narrow().is_needed
    assert not narrow(gain=0.9 * STRONG_LOG_ODDS).is_needed
    assert not narrow(moved=0.9 * NEGLIGIBLE_SHIFT_SIGMAS).is_needed


def test_it_speaks_against_given_loads_and_where_another_explanation_is_as_good():
    assert doubts_of_narrow_band(None, asked="broadband") == ()
    assert doubts_of_narrow_band(narrow(), asked="auto") == ()
    (found,) = doubts_of_narrow_band(narrow(), asked="broadband")
    assert (found.code, found.data["frequency"]) == ("narrow_band_load_preferred", pytest.approx(0.4))
    rival = Rival(0.35, {"k_x": 1.0, "c_x": -4.0}, {"k_x": 0.1, "c_x": -0.4}, {"k_x": 1.0, "c_x": 2.0}, 0.2)
    for gain, code in ((0.0, "narrow_band_load_possible"), (2.0 * STRONG_LOG_ODDS, "narrow_band_load_ambiguous")):
        requested, _ = doubts_of_narrow_band(narrow(gain, rivals=(rival, rival)), asked="narrow-band")
        assert requested.code == "narrow_band_load_ambiguous"  # rivals are those of a result with the load
        found, _ = doubts_of_narrow_band(narrow(gain, rivals=(rival, rival)), asked="auto")
        assert (found.code, found.quantities, found.data["sigmas"]) == (code, ("c_x",), 4.0)
        assert (found.data["shifts"], found.data["widths"]) == (rival.shifts, rival.widths)
        assert (found.data["frequency"], found.data["chance"]) == (0.35, 0.2)


def test_its_note_has_the_strongest_level():
    data = note_narrow_band(narrow()).data
    assert data["load"] == STATISTICS[-1].of
    assert data["rms"] == pytest.approx(9e3)
    assert data["width"] == pytest.approx(0.02)


def test_a_rival_widens_by_its_chance_its_shift_and_its_own_uncertainty():
    """A rival two standard deviations away, three times as uncertain and half as likely, was not seen at all."""
    assert _widths(QUESTION, end(0.0, 0.0), end(0.0, 0.1)) == pytest.approx({"k_x": 1.0, "c_x": 1.0})

    def factor(shift: float, width: float, chance: float) -> float:
        return mixture_factor([Rival(0.4, {"c_x": shift}, {}, {"c_x": width}, chance).part("c_x")])

    rng, n = np.random.default_rng(2), 400_000
    drawn = np.where(rng.random(n) < 1.0 / 3.0, 2.0 + 3.0 * rng.standard_normal(n), rng.standard_normal(n))
    assert factor(2.0, 3.0, 1.0 / 3.0) == pytest.approx(np.quantile(np.abs(drawn), 0.9545) / 2.0, rel=0.02)
    assert factor(2.0, 3.0, 0.2) > max(factor(1.0, 3.0, 0.2), factor(2.0, 1.0, 0.2), factor(2.0, 3.0, 0.1)) > 1.1
    assert factor(0.0, 1.0, 0.5) == pytest.approx(1.0)


def test_a_support_whose_loads_are_measured_has_none():
    question: Any = SimpleNamespace(turbine=TOWER, loads=())
    nothing: Any = None
    assert fit_narrow_band(question, nothing, nothing) is None
