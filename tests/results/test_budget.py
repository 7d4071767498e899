"""Holding a part of the unknowns, and the budget that follows, against plain linear algebra."""

import numpy as np
import pytest

from windsysid.checks.conditioning import hold
from windsysid.results.budget import Budget, budget_of
from windsysid.results.tolerance import Tolerance


def gaussian(n: int) -> np.ndarray:
    root = np.random.default_rng(5).standard_normal((n, n + 2))
    return root @ root.T


def test_holding_a_part_is_leaving_out_its_rows_of_the_information():
    cov, mean = gaussian(5), np.arange(5.0)
    found, left = hold(mean, cov, [1, 3], np.array([2.0, -1.0]))
    information = np.linalg.inv(cov)
    free = [0, 2, 4]
    inner = information[np.ix_(free, free)]
    assert left[np.ix_(free, free)] == pytest.approx(np.linalg.inv(inner))
    shift = np.linalg.solve(inner, information[np.ix_(free, [1, 3])] @ (np.array([2.0, -1.0]) - mean[[1, 3]]))
    assert found[free] == pytest.approx(mean[free] - shift)
    assert not left[[1, 3]].any()
    again, same = hold(found, left, [1, 3], np.array([2.0, -1.0]))  # what is held stays
    assert again == pytest.approx(found)
    assert same == pytest.approx(left)


def test_the_budget_of_a_sum_of_independent_causes_adds_up():
    # y = θ + 3 η + τ_gain + 2 τ_mass, all independent: the variances are 4, 9, 1 and 4 of 18 in all.
    slope = np.array([1.0, 3.0, 1.0, 2.0])
    cov = np.diag([4.0, 1.0, 1.0, 1.0])
    tolerances = (Tolerance("gain", "a", 0.01), Tolerance("masses", "hub", 0.02))
    found = budget_of([("y", slope)], cov, slice(1, 2), tolerances)
    assert found.causes == ("load statistics", "gain", "masses")
    (row,) = found.rows
    assert row.two_sigma == pytest.approx(2.0 * np.sqrt(18.0))
    assert row.alone == pytest.approx(4.0 / 18.0)
    assert row.causes == pytest.approx([9.0 / 18.0, 1.0 / 18.0, 4.0 / 18.0])
    assert row.alone + sum(row.causes) == pytest.approx(1.0)
    assert "22 %" in str(found.table().rows)
    (wide,) = found.widened({"y": (0.5, 0.25)}).rows  # of the variance of the model: 1.75 times in all
    assert wide.two_sigma == pytest.approx(2.0 * np.sqrt(1.75 * 18.0))
    assert wide.causes[-2:] == pytest.approx([0.5 / 1.75, 0.25 / 1.75])
    assert wide.alone + sum(wide.causes) == pytest.approx(1.0)


def test_shares_of_correlated_causes_add_up_whatever_their_order():
    """Each alone would lower the variance by more than its share, or less; two causes alike have one share."""
    slope, cov = np.array([1.0, 2.0, 1.0, 1.0]), gaussian(4)
    tolerances = (Tolerance("gain", "a", 0.01), Tolerance("masses", "hub", 0.02))
    (row,) = budget_of([("y", slope)], cov, slice(1, 2), tolerances).rows
    assert row.alone + sum(row.causes) == pytest.approx(1.0)
    alike = np.array([[2.0, 0.5, 0.5], [0.5, 1.0, 0.8], [0.5, 0.8, 1.0]])
    (row,) = budget_of([("y", np.ones(3))], alike, slice(0, 0), tolerances).rows
    assert row.causes[0] == pytest.approx(row.causes[1])


def test_a_budget_without_rows_is_an_empty_table():
    assert Budget(("gain",)).table().rows == []
