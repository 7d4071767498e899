"""Likelihood of free decays against a general least-squares search, closed forms and differences."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from windsysid.modal.decays.likelihood import Decay, fit_decays, misfit, part_scores, project

RATE, MODES = 25.0, ((1.0, 0.02), (1.08, 0.015))


def decay(seed: int = 0, noise: float = 0.05, channels: int = 3) -> Decay:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    values = 0.3 + noise * rng.normal(size=(len(t), channels))
    for f, z in MODES:
        omega = 2.0 * np.pi * f
        wave = np.exp(omega * (-z + 1j * np.sqrt(1.0 - z**2)) * t)
        values += (wave[:, None] * (rng.normal(size=channels) + 1j * rng.normal(size=channels))).real
    return Decay(values, RATE)


START = np.log([0.99, 1.1, 0.01, 0.01])


def test_the_fit_is_that_of_a_general_least_squares_search():
    one = decay(channels=1)

    def residuals(p: np.ndarray) -> np.ndarray:
        t, y = one.time, p[8] + p[9] * one.time
        for j in range(2):
            omega, z, a, b = 2.0 * np.pi * np.exp(p[j]), np.exp(p[2 + j]), p[4 + 2 * j], p[5 + 2 * j]
            damped = omega * np.sqrt(1.0 - z**2)
            y = y + np.exp(-z * omega * t) * (a * np.cos(damped * t) + b * np.sin(damped * t))
        return np.asarray(y - one.values[:, 0])

    found = least_squares(
        residuals,
        np.concatenate([np.log([f for f, _ in MODES]), np.log([z for _, z in MODES]), 0.5 * np.ones(4), np.zeros(2)]),
        xtol=1e-14,
        ftol=1e-14,
    )
    scatter = 2.0 * found.cost / (len(one.values) - 10)
    slopes = np.asarray(found.jac)
    cov = np.linalg.inv(slopes.T @ slopes)[:4, :4] * scatter
    fit = fit_decays(START, [one])
    shift = (fit.theta - found.x[:4]) / np.sqrt(np.diag(cov))
    assert np.abs(shift).max() < 0.05, shift  # the prior of damping
    np.testing.assert_allclose(np.sqrt(np.diag(fit.cov)), np.sqrt(np.diag(cov)), rtol=0.02)


def test_scores_are_slopes_of_the_profile_likelihood():
    one, theta, step = decay(), np.log([1.003, 1.078, 0.018, 0.016]), 1e-5
    at = project(theta, one)
    scores, _ = at.information(at.slopes.T @ at.slopes, at.slopes.T @ at.residual)
    for k in range(4):
        low, high = (misfit(project(theta + sign * step * np.eye(4)[k], one)) for sign in (-1.0, 1.0))
        assert scores[k] == pytest.approx(-0.5 * (high - low) / (2.0 * step), rel=1e-2)


def test_one_mode_reaches_the_bound_of_cramer_and_rao_in_closed_form():
    """Long decay of one channel: σ of ln f is 4 ζ^1.5 √(ω/rate) σ/a, that of ln ζ is larger by 1/ζ."""
    f, z, noise, rate = 1.0, 0.01, 0.1, 50.0
    t = np.arange(0.0, 120.0, 1.0 / rate)
    swing = np.exp(-z * 2.0 * np.pi * f * t) * np.cos(2.0 * np.pi * f * np.sqrt(1.0 - z**2) * t)
    values = swing[:, None] + noise * np.random.default_rng(1).normal(size=(len(t), 1))
    std = np.sqrt(np.diag(fit_decays(np.log([f, z]), [Decay(values, rate)]).cov))
    expected = 4.0 * z**1.5 * np.sqrt(2.0 * np.pi * f / rate) * noise
    np.testing.assert_allclose(std, [expected, expected / z], rtol=0.1)


def test_parts_add_up_to_the_whole():
    one = decay()
    fit = fit_decays(START, [one])
    for part in part_scores(fit, [one]):
        total = part.information.sum(axis=0) + part.precision
        np.testing.assert_allclose(np.linalg.inv(total), fit.cov, rtol=1e-3)
        moved = np.linalg.solve(total, part.gradients.sum(axis=0) + part.pull)
        assert np.max(np.abs(moved) / np.sqrt(np.diag(fit.cov))) < 1e-3


def test_two_records_have_half_the_variance():
    one = fit_decays(START, [decay(0)])
    both = fit_decays(START, [decay(0), decay(0)])
    np.testing.assert_allclose(both.theta, one.theta, atol=1e-3)
    np.testing.assert_allclose(np.diag(both.cov), 0.5 * np.diag(one.cov), rtol=0.05)
