"""Clocks: a shift of readings, and what a record says of it, against dense Gaussian arithmetic."""

import numpy as np
import pytest
import sympy as sp

from windsysid.identification.estimate.clock_lag import Lateness, Shifted, advance, clock_information, derivative
from windsysid.identification.estimate.scoring import look
from windsysid.identification.fit_equations import Reading
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov

SAMPLES, NOISE, EDGE = 120, 0.3, 1.2
TRUTH = np.array([0.0, np.log(6.0)])


def twice_read(theta: np.ndarray) -> StateSpace:
    """One first-order load of rms e^θ₁ and time constant e^θ₂, read by two noisy sensors, once a second."""
    w = sp.Symbol("w", real=True)
    load = GaussMarkov("w", float(np.exp(theta[0])), float(np.exp(theta[1])))
    cell = Equations("cell", (), (), (), (w,), ())
    sensors = [Reading("one", w, NOISE), Reading("two", w, NOISE)]
    return compose(cell, rate=1.0, values={}, loads=[load], sensors=sensors)


def covariance(theta: np.ndarray) -> np.ndarray:
    """Of all readings, those of the first sensor before those of the second."""
    k = np.arange(SAMPLES, dtype=np.float64)
    one = np.exp(2.0 * theta[0] - np.abs(np.subtract.outer(k, k)) / np.exp(theta[1]))
    return np.block([[one, one], [one, one]]) + NOISE**2 * np.eye(2 * SAMPLES)


def test_a_band_limited_shift_moves_what_is_slow_and_leaves_noise_as_loud():
    time = np.linspace(0.0, 30.0, 3001)
    edge = 2.0 * np.pi * 8.0
    inside = slice(300, -300)
    for hz in (0.5, 2.0, 5.0):
        values = np.sin(2.0 * np.pi * hz * time)
        moved = advance(time, values, 0.003, edge)
        assert moved[inside] == pytest.approx(np.sin(2.0 * np.pi * hz * (time + 0.003))[inside], abs=2e-4)
    noise = np.random.default_rng(1).standard_normal(20_000)
    time = np.linspace(0.0, 200.0, len(noise))
    assert np.std(advance(time, noise, 0.004, edge)) == pytest.approx(np.std(noise), rel=1e-3)
    assert abs(np.mean(noise * derivative(time, noise, edge))) < 2e-3 * np.std(derivative(time, noise, edge))


def test_a_shift_knows_gaps_and_unequal_times():
    rng = np.random.default_rng(2)
    time = np.cumsum(0.01 * (1.0 + 0.1 * rng.standard_normal(3000)))
    values = np.sin(2.0 * np.pi * time)
    lost = rng.random(3000) < 0.1
    moved = advance(time, np.where(lost, np.nan, values), 0.004, 2.0 * np.pi * 5.0)
    assert np.array_equal(np.isnan(moved), lost)
    kept = ~lost & (np.abs(np.arange(3000) - 1500) < 1200)
    assert np.max(np.abs(moved - np.sin(2.0 * np.pi * (time + 0.004)))[kept]) < 3e-3


def test_information_on_a_clock_is_that_of_a_dense_gaussian():
    # y ~ N(0, C) has the information ½ tr(C⁻¹ ∂C C⁻¹ ∂C). A clock that is late by κ turns C into D C Dᵀ, D = e^{−κG}:
    # ∂C = −(G C + C Gᵀ). Squared slopes of innovations would say more than that: they count noise.
    time = np.arange(SAMPLES, dtype=np.float64)
    G = np.zeros((2 * SAMPLES, 2 * SAMPLES))
    G[SAMPLES:, SAMPLES:] = np.column_stack([derivative(time, unit, EDGE) for unit in np.eye(SAMPLES)])
    C, step = covariance(TRUTH), 1e-5
    slopes = [
        (covariance(TRUTH + step * unit) - covariance(TRUTH - step * unit)) / (2.0 * step) for unit in np.eye(2)
    ] + [-(G @ C + C @ G.T)]
    whitened = [np.linalg.solve(C, slope) for slope in slopes]
    dense = np.array([[0.5 * np.sum(a * b.T) for a in whitened] for b in whitened])
    root, rng = np.linalg.cholesky(C), np.random.default_rng(3)
    clock = [np.array([0.0, 1.0])]
    found = []
    for _ in range(150):
        y = (root @ rng.standard_normal(2 * SAMPLES)).reshape(2, SAMPLES).T.copy()
        samples = Shifted([(np.zeros((SAMPLES, 1)), y)], np.zeros(2), np.array([1.0]), EDGE)
        seen = look(twice_read, samples, TRUTH, np.array([1e-4, 1e-4]), changes=Lateness(samples, clock))
        said = clock_information(twice_read(TRUTH), samples, seen.found, clock)
        found.append([*said.gradient, *said.curvature.ravel(), *said.mixed.ravel()])
    mean, error = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(len(found))
    expected = np.array([0.0, dense[2, 2], dense[0, 2], dense[1, 2]])
    assert np.all(np.abs(mean - expected) < 4.0 * error + 0.02 * dense[2, 2] * np.array([0.0, 1.0, 1.0, 1.0]))
    assert np.var([row[0] for row in found]) == pytest.approx(dense[2, 2], rel=0.4)  # the score scatters as much
    assert error[1] < 0.03 * dense[2, 2]
