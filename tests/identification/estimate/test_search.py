"""The mode of the posterior of a first-order autoregression, whose likelihood is written on paper."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.identification.test_posterior_mode import autoregression
from windsysid._types import Array
from windsysid.checks.limits import OUTLIER_SIGMAS
from windsysid.errors import WindsysidError
from windsysid.identification.estimate import search
from windsysid.identification.estimate.outlier import Outliers
from windsysid.identification.estimate.search import solve
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.unknowns import Unknowns

SAMPLES, PHI, SIGMA = 400, 0.8, 1.7
PRIOR = np.array([0.0, 0.5]), np.diag([1.0, 0.04])


class Autoregression(NamedTuple):
    """θ = (ln σ, φ)."""

    unknowns: Unknowns = Unknowns(parameters=("level", "phi"))
    prior: tuple[Array, Array] = PRIOR
    wide_prior: tuple[Array, Array] = PRIOR
    clocks: tuple[Array, ...] = ()

    def build(self, unknowns: Array, /) -> StateSpace:
        return autoregression(unknowns)

    def start(self, inputs: Array, readings: Array) -> tuple[Array, Array]:
        return PRIOR

    def frequencies(self, unknowns: Array) -> tuple[float, ...]:
        return ()


def process() -> Array:
    e = np.random.default_rng(3).standard_normal(SAMPLES) * SIGMA * np.sqrt(1.0 - PHI**2)
    y = np.empty(SAMPLES)
    y[0] = SIGMA
    for k in range(1, SAMPLES):
        y[k] = PHI * y[k - 1] + e[k]
    return y


def cost(theta: Array, y: Array) -> float:
    """−log posterior, up to a constant."""
    sigma, phi = np.exp(theta[0]), theta[1]
    s = sigma * np.sqrt(1.0 - phi**2)
    log_likelihood = -np.log(sigma) - 0.5 * (y[0] / sigma) ** 2
    log_likelihood -= np.sum(np.log(s) + 0.5 * ((y[1:] - phi * y[:-1]) / s) ** 2)
    return float(-log_likelihood + 0.5 * np.sum((theta - PRIOR[0]) ** 2 / np.diag(PRIOR[1])))


def samples_of(y: Array) -> list[tuple[Array, Array]]:
    return [(np.zeros((len(y), 1)), y[:, None])]


def test_the_mode_is_the_one_that_scipy_finds_on_paper():
    y = process()
    found = solve(Autoregression(), samples_of(y), None, rate=1.0, start=PRIOR)
    best = minimize(cost, PRIOR[0], args=(y,), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    std = np.sqrt(np.diag(found.cov))
    assert np.all(np.abs(found.mean - best.x) < 0.05 * std)
    assert found.settled
    assert found.history is None
    assert (found.samples, found.read.tolist(), found.notes) == (SAMPLES, [SAMPLES], ())
    assert found.mean_inputs.tolist() == [0.0]


def test_a_reading_that_is_far_off_is_left_out_and_counted():
    y = process()
    whole = solve(Autoregression(), samples_of(y), None, rate=1.0, start=PRIOR)
    y[200] += 6.0 * SIGMA
    found = solve(Autoregression(), samples_of(y), None, rate=1.0, start=PRIOR)
    (note,) = found.notes
    assert (note.code, note.data["count"], note.data["sigmas"]) == ("outliers", 1, OUTLIER_SIGMAS)
    assert np.all(np.abs(found.mean - whole.mean) < np.sqrt(np.diag(whole.cov)))


def test_no_search_without_outliers_begins_where_the_first_was_too_expensive(monkeypatch: pytest.MonkeyPatch):
    """A transient under wind was searched 32 times and took more than a minute, for numbers of grade C."""
    y = process()
    y[200] += 6.0 * SIGMA
    monkeypatch.setattr(search, "MAX_REPEATED_ELEMENTS", 0.0)
    monkeypatch.setattr(search, "find_spikes", lambda samples: Outliers())
    found = solve(Autoregression(), samples_of(y), None, rate=1.0, start=PRIOR)
    assert (found.settled, found.exhausted) == (False, True)
    assert found.updated == 8 * SAMPLES * (found.iterations + 1)


def test_no_start_and_no_samples_are_refused():
    with pytest.raises(ValueError, match="a search begins where the recursion ends, or at a start"):
        solve(Autoregression(), samples_of(process()), None, rate=1.0)
    with pytest.raises(WindsysidError):
        solve(Autoregression(), [], None, rate=1.0, start=PRIOR)
