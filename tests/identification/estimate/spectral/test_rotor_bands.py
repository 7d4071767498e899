"""A rotor read in bands: what is refused, what is said, and what an estimate holds."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification.estimate.spectral import rotor_bands
from windsysid.identification.estimate.spectral.rotor_bands import read_in_bands
from windsysid.identification.model.prior import Prior
from windsysid.scoring import Evaluation, SearchResult
from windsysid.spectral.rotor_bands.limits import BLADE_STIFFNESS_DISCREPANCY
from windsysid.statespace.unknowns import Unknowns
from windsysid.turbine.file import load_turbine

QUESTION: Any = SimpleNamespace(parameters=(), turbine=SimpleNamespace(model=SimpleNamespace(freedoms=())))
NAMES = Unknowns(parameters=("k",), lag=("mean_lag",))
INFORMATION = np.diag([4.0, 25.0])


class Bands:
    """Bands whose likelihood is ½ (u − m)ᵀ I (u − m), with the mode of the posterior that a search would find."""

    unknowns, statistics, prior, bands = NAMES, (), (np.zeros(2), np.ones(2)), ()

    def __init__(self, *, fails: bool = False) -> None:
        self.fails = fails

    def places(self) -> tuple[np.ndarray, ...]:
        return ()

    def near(self, start: np.ndarray) -> np.ndarray:
        return start

    def fit(self, start: np.ndarray) -> Any:
        if self.fails:
            raise np.linalg.LinAlgError
        known = Evaluation(7.0, np.zeros(2), INFORMATION)
        return Fitted(self, SearchResult(np.array([0.3, 0.2]), known, 7.0, 0.0, 1, converged=True))


class Fitted:
    """A fit, as a named tuple would be."""

    def __init__(self, model: Bands, mode: Any) -> None:
        self.model, self.mode = model, mode

    def _replace(self, **of: Any) -> "Fitted":
        return self


def posed(**more: bool) -> Any:
    places = [
        SimpleNamespace(name="lag 1", frequency=2.5, shape=1),
        SimpleNamespace(name="x", frequency=0.4, shape=None),
    ]
    return SimpleNamespace(model=Bands(**more), start=np.zeros(2), places=places, spectra=SimpleNamespace(rotor_hz=0.2))


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Says what the search for bands finds."""
    monkeypatch.setattr(rotor_bands, "centre_bands", lambda question, bands, near: bands)
    monkeypatch.setattr(rotor_bands, "judge_bands", lambda *of: ([], ()))
    return lambda bands: monkeypatch.setattr(rotor_bands, "search_bands", lambda question: bands)


def test_an_estimate_is_the_mode_its_covariance_and_the_log_likelihood_without_the_prior(found: Any):
    found(posed())
    estimate = read_in_bands(QUESTION, "auto")
    assert estimate is not None
    np.testing.assert_allclose(estimate.cov, np.linalg.inv(INFORMATION))
    assert estimate.log_likelihood == pytest.approx(-(7.0 - 0.5 * (0.3**2 + 0.2**2)))
    notes = {one.code: one.data for one in estimate.notes}
    assert notes["lag_angle"] == {"angle": 0.2, "std": pytest.approx(0.2)}
    assert notes["bands_read"]["modes"] == {"lag 1": pytest.approx(2.3), "x": pytest.approx(0.4)}


def test_blades_have_the_discrepancy_of_an_equivalent_hinge():
    """The forward whirl of a bending blade was 2.8 standard deviations off."""
    rotor = load_turbine("nrel5mw_full")
    parameters = Prior().parameters(rotor, ("k_x", "c_beta_1", "k_beta_1", "k_beta_2", "k_beta_3"), linear=False)
    question: Any = SimpleNamespace(parameters=parameters, turbine=rotor)
    cov = 1e-6 * np.eye(len(parameters) + 2)
    blades = np.array([q.name.startswith("k_beta") for q in parameters] + [False] * 2)
    added = rotor_bands._with_discrepancy(question, cov) - cov
    np.testing.assert_allclose(added, BLADE_STIFFNESS_DISCREPANCY**2 * np.outer(blades, blades), atol=1e-15)
    assert np.all(cov == 1e-6 * np.eye(len(cov)))


def test_modes_that_cannot_be_told_apart_have_no_estimate(found: Any):
    found(None)
    assert read_in_bands(QUESTION, "auto") is None


def test_a_load_model_and_a_spectrum_that_is_not_positive_are_refused(found: Any):
    with pytest.raises(ConfigurationError, match=r"load model rotor-wind: bands .* leave loads= out"):
        read_in_bands(QUESTION, "rotor-wind")
    found(posed(fails=True))
    with pytest.raises(WindsysidError, match="no spectrum of this model is positive"):
        read_in_bands(QUESTION, "auto")
