"""A start never has negative damping."""

import numpy as np

from windsysid.spectral.rotor.problem import Question
from windsysid.spectral.rotor.start import LEAST_DAMPING, damped_start


def test_damping_below_zero_starts_a_little_above_and_all_else_at_the_mean(question: Question):
    std = np.array([q.prior[1] for q in question.parameters])
    mean = np.full(len(std), -2.0)
    start = damped_start(question.turbine, question.parameters, mean, std)
    linear = np.array([not q.logarithmic for q in question.parameters])
    assert linear.any()
    np.testing.assert_allclose(start[linear], LEAST_DAMPING * std[linear])
    np.testing.assert_array_equal(start[~linear], -2.0)
