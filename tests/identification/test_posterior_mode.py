"""The Fisher information of a process whose likelihood is written on paper, and where a search begins anew."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from windsysid.identification.estimate import scoring
from windsysid.identification.estimate.scoring import find_innovation_mode, information
from windsysid.identification.fit_equations import Reading
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov

SAMPLES, PHI, SIGMA = 400, 0.8, 1.7


def autoregression(theta: np.ndarray) -> StateSpace:
    """y_k = φ y_{k−1} + e_k of stationary standard deviation σ, θ = (ln σ, φ): a first-order load that is read all but
    exactly."""
    w = sp.Symbol("w", real=True)
    load = GaussMarkov("w", float(np.exp(theta[0])), float(-1.0 / np.log(theta[1])))
    cell = Equations("cell", (), (), (), (w,), ())
    return compose(cell, rate=1.0, values={}, loads=[load], sensors=[Reading("cell", w, 1e-5)])


def test_information_and_gradient_are_those_of_a_first_order_autoregression():
    # With s² = σ² (1 − φ²) the density of the readings is −T ln σ − (T − 1)/2 ln(1 − φ²) − y₁²/2σ² − Σ (y_k − φ
    # y_{k−1})²/2s². Of an innovation with mean φ y_{k−1} and variance s² the information is (∂mean)²/s² + 2 (∂ ln s)²:
    # in ln σ exactly 2 for each reading.
    rng = np.random.default_rng(3)
    y = np.empty(SAMPLES)
    y[0] = SIGMA * rng.standard_normal()
    for k in range(1, SAMPLES):
        y[k] = PHI * y[k - 1] + SIGMA * np.sqrt(1.0 - PHI**2) * rng.standard_normal()
    gradient, fisher = information(
        autoregression, np.zeros((SAMPLES, 1)), y[:, None], np.array([np.log(SIGMA), PHI]), np.array([1e-7, 1e-7])
    )
    rest, variance = 1.0 - PHI**2, SIGMA**2 * (1.0 - PHI**2)
    slope = -PHI / rest  # ∂ ln s / ∂φ
    expected = np.array(
        [
            [2.0 * SAMPLES, 2.0 * (SAMPLES - 1) * slope],
            [2.0 * (SAMPLES - 1) * slope, np.sum(y[:-1] ** 2) / variance + 2.0 * (SAMPLES - 1) * slope**2],
        ]
    )
    np.testing.assert_allclose(fisher, expected, rtol=1e-5)
    e = y[1:] - PHI * y[:-1]
    to_sigma = -SAMPLES + y[0] ** 2 / SIGMA**2 + np.sum(e**2) / variance
    to_phi = (SAMPLES - 1) * PHI / rest + np.sum(e * y[:-1]) / variance - np.sum(e**2) * PHI / (variance * rest)
    assert gradient == pytest.approx([to_sigma, to_phi], rel=1e-5, abs=1e-4)


def test_a_search_that_would_be_too_expensive_ends_with_what_it_knows(monkeypatch: pytest.MonkeyPatch):
    y = np.random.default_rng(4).standard_normal((SAMPLES, 1))
    mean, cov = np.array([0.0, 0.5]), np.diag([4.0, 0.01])

    def search():
        start = np.array([3.0, 0.5]), cov
        return find_innovation_mode(autoregression, [(np.zeros((SAMPLES, 1)), y)], prior=(mean, cov), start=start)

    whole = search()
    assert whole.settled
    monkeypatch.setattr(scoring, "MAX_UPDATED_ELEMENTS", 1.0)
    monkeypatch.setattr(scoring, "MIN_STEPS", 1)
    short = search()
    assert (short.settled, short.ended, short.iterations) == (False, True, 1)
    assert np.isfinite(short.cov).all()


def test_a_search_whose_start_has_no_likelihood_begins_at_the_prior():
    # as a recursion that lost its way among pulses left one

    def build(theta: np.ndarray) -> StateSpace:
        model, far = autoregression(theta), theta[0] > 5.0
        noise = model.blocks.load_noise
        return replace(model, blocks=model.blocks._replace(load_noise=np.nan * noise if far else noise))

    y = np.random.default_rng(4).standard_normal((SAMPLES, 1))
    mean, cov = np.array([0.0, 0.5]), np.diag([0.25, 0.01])
    lost, sound = (
        find_innovation_mode(
            build, [(np.zeros((SAMPLES, 1)), y)],
            prior=(mean, cov), start=(np.array([at, 0.5]), cov),
        )
        for at in (6.0, 0.0)
    )  # fmt: skip
    np.testing.assert_array_equal(lost.mean, sound.mean)
