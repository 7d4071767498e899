"""What a question knows of its structure."""

import numpy as np
import pytest

from windsysid.spectral.rotor.problem import MIN_START_DAMPING, RotorQuestion, damped_start


def test_the_narrowest_resonance_is_half_the_half_power_width(question: RotorQuestion):
    v = question.turbine.values
    widths = [v[f"c_{name}"] / (4.0 * np.pi * v[f"mass_{name}"]) for name in ("side_side", "fore_aft")]
    assert question.narrowest == pytest.approx(min(widths), rel=0.02)


def test_frequencies_are_those_of_the_priors_centres(question: RotorQuestion):
    v = question.turbine.values
    expected = np.sqrt(v["k_side_side"] / v["mass_side_side"]) / (2.0 * np.pi)
    assert question.frequency("side_side") == pytest.approx(expected, rel=0.02)
    assert not question.has_lag


def test_white_noise_has_one_density_at_all_frequencies(question: RotorQuestion):
    statistics, given = question.noise(np.array([[0.2], [0.4]]), np.arange(len(question.sensors)))
    assert given.shape == (len(statistics), 2, len(question.sensors))
    densities = [s.noise**2 / question.rate for s in question.sensors]
    steady = [i for i, s in enumerate(question.sensors) if not s.drift]
    np.testing.assert_allclose(given.sum(axis=0)[:, steady], np.tile(densities, (2, 1))[:, steady])


def test_damping_below_zero_starts_a_little_above_and_all_else_at_the_mean(question: RotorQuestion):
    std = np.array([q.prior[1] for q in question.parameters])
    mean = np.full(len(std), -2.0)
    start = damped_start(question.turbine, question.parameters, mean, std)
    linear = np.array([not q.logarithmic for q in question.parameters])
    assert linear.any()
    np.testing.assert_allclose(start[linear], MIN_START_DAMPING * std[linear])
    np.testing.assert_array_equal(start[~linear], -2.0)
