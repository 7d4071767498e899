"""Differences of estimates against their covariance."""

import numpy as np
import pytest
from scipy.stats import chi2

from windsysid.spectral.rotor_bands.check import _differ
from windsysid.spectral.rotor_bands.limits import DISAGREEMENT_PROBABILITY

NAMES, CODE = ["k_x", "k_y"], "halves_disagree_in_bands"


def test_a_step_is_a_doubt_where_chance_makes_one_in_a_thousand_as_long():
    cov, direction = np.diag([0.01, 0.04]) ** 2, np.array([0.01, 0.0])
    bound = np.sqrt(chi2.isf(DISAGREEMENT_PROBABILITY, 2))
    assert _differ(CODE, 0.99 * bound * direction, cov, NAMES) == []
    (found,) = _differ(CODE, 1.01 * bound * direction, cov, NAMES)
    assert (found.code, found.quantities) == (CODE, ("k_x",))
    assert found.data["change"] == pytest.approx(1.01 * bound * 0.01)


def test_a_direction_without_variance_counts_as_a_thousandth_of_the_widest():
    step, cov = np.array([0.0, 1e-3]), np.diag([1.0, 0.0])
    assert _differ(CODE, step, cov, NAMES) == []
