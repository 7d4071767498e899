"""Differences of estimates against their covariance."""

import numpy as np
from scipy.stats import chi2

from windsysid.spectral.rotor_bands.check import CHANCE, _differ

NAMES, TEXT = ["k_x", "k_y"], "they do not agree on {}"


def test_a_step_is_a_doubt_where_chance_makes_one_in_a_thousand_as_long():
    cov, direction = np.diag([0.01, 0.04]) ** 2, np.array([0.01, 0.0])
    bound = np.sqrt(chi2.isf(CHANCE, 2))
    assert _differ(0.99 * bound * direction, cov, NAMES, TEXT) == []
    assert _differ(1.01 * bound * direction, cov, NAMES, TEXT) == ["they do not agree on k_x (+3.8 %)"]


def test_a_direction_without_variance_counts_as_a_thousandth_of_the_widest():
    step, cov = np.array([0.0, 1e-3]), np.diag([1.0, 0.0])
    assert _differ(step, cov, NAMES, TEXT) == []
