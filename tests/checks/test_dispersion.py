"""Dispersion of parts of a record: against drawn scores of a linear model, a closed form, and noise of other size."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from windsysid._types import Array
from windsysid.checks.dispersion import (
    MAX_STORED_PARTS,
    PRIOR_SCALE,
    PRIOR_SHAPE,
    Dispersion,
    Part,
    PartScores,
    expected_factor,
    join_parts,
)
from windsysid.checks.limits import PRIOR_ODDS_OF_MISFIT

SLOPES = np.array([1.0, 0.3, 2.0])
SPREAD = 0.7
FIRST = np.array([1.0, 0.0, 0.0])


def scores_of(rng: np.random.Generator, theta: Array, *, parts: int = 16, size: float = 1.0) -> PartScores:
    """Scores at zero of parts of y = X θ + e; θ is a row for each part (parts, 3), or one for all (3,)."""
    gradients, information = [], []
    for own in theta if theta.ndim == 2 else [theta] * parts:
        X = rng.standard_normal((40, 3)) * SLOPES
        y = X @ own + size * rng.standard_normal(40)
        gradients.append(X.T @ y)
        information.append(X.T @ X)
    prior = np.asarray(np.eye(3) / SPREAD**2)
    return PartScores(
        "time", np.arange(0.5, len(gradients)), np.array(gradients), np.array(information), prior, np.zeros(3)
    )


def dispersion_of(scores: PartScores, quantity: Array = FIRST) -> Dispersion:
    found = scores.dispersion(quantity)
    assert found is not None
    return found


def test_two_halves_have_one_degree_of_freedom():
    """The second half contradicts the first as much as that one contradicts it."""
    rng = np.random.default_rng(20261127)
    found = [dispersion_of(scores_of(rng, SPREAD * rng.standard_normal(3), parts=2)) for _ in range(1500)]
    assert np.mean([one.freedom for one in found]) == pytest.approx(1.0, abs=0.1)
    chance = [stats.chi2.sf(one.ratio * one.freedom, one.freedom) for one in found]
    assert np.mean(np.array(chance) < 0.05) == pytest.approx(0.05, abs=0.015)


@pytest.mark.slow
def test_parts_of_a_true_model_scatter_as_fisher_information_tells():
    rng = np.random.default_rng(20261126)
    found = [dispersion_of(scores_of(rng, SPREAD * rng.standard_normal(3))) for _ in range(1500)]
    ratio, freedom = (np.array([getattr(one, name) for one in found]) for name in ("ratio", "freedom"))
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.04)
    chance = stats.chi2.sf(ratio * freedom, freedom)
    assert np.mean(chance < 0.05) == pytest.approx(0.05, abs=0.015)
    assert np.mean([expected_factor(one) ** 0.5 > 1.2 for one in found]) < 0.1


@pytest.mark.parametrize("size", [0.5, 2.0, 4.0])
def test_noise_of_another_size_than_the_model_has_widens_by_that_size_and_never_narrows(size: float):
    rng = np.random.default_rng(3)
    found = [expected_factor(dispersion_of(scores_of(rng, np.zeros(3), size=size))) ** 0.5 for _ in range(200)]
    assert np.mean(found) == pytest.approx(max(size, 1.0), rel=0.15)


def test_a_parameter_that_changes_widens_its_own_interval_only():
    rng = np.random.default_rng(1)
    theta = np.zeros((16, 3))
    theta[8:, 1] = 2.5
    scores = scores_of(rng, theta)
    own, other = (expected_factor(dispersion_of(scores, axis)) for axis in (np.eye(3)[1], np.eye(3)[0]))
    assert own > 4.0 > 2.0 > other
    assert 0.0 <= dispersion_of(scores, np.eye(3)[1]).place <= 16.0


def test_masses_that_are_known_are_no_unknowns():
    scores = scores_of(np.random.default_rng(2), np.array([0.1, 0.2, 0.3]))
    held = scores._replace(given=(2,)).dispersion(FIRST + np.eye(3)[2])
    two = scores._replace(
        gradients=scores.gradients[:, :2], information=scores.information[:, :2, :2], pull=np.zeros(2),
        precision=scores.precision[:2, :2],
    )  # fmt: skip
    assert held == two.dispersion(FIRST[:2])


def test_one_part_says_nothing_against_itself():
    rng = np.random.default_rng(4)
    assert scores_of(rng, np.zeros(3), parts=1).dispersion(FIRST) is None


def test_the_share_of_the_data_is_what_widens():
    """A prior that is as narrow as the data leaves half of a variance as it is."""
    wide, narrow = (expected_factor(Dispersion(16.0, 8.0, share, 0.0)) for share in (1.0, 0.5))
    assert narrow - 1.0 == pytest.approx(0.5 * (wide - 1.0))


@pytest.mark.parametrize(("ratio", "freedom"), [(0.6, 3.0), (1.0, 8.0), (2.5, 6.0), (9.0, 2.0)])
def test_the_expected_factor_is_the_integral_over_both_explanations(ratio: float, freedom: float):
    """Independently: numerical integration of Bayes' rule with SciPy's distributions."""
    prior = stats.invgamma(PRIOR_SHAPE, scale=PRIOR_SCALE)

    def likelihood(s2: float) -> float:
        return float(stats.chi2.pdf(ratio * freedom / s2, freedom) / s2)

    evidence, moment = (
        integrate.quad(lambda s2, k=k: s2**k * likelihood(s2) * prior.pdf(s2), 0.0, np.inf)[0] for k in (0, 1)
    )
    odds = PRIOR_ODDS_OF_MISFIT * evidence / likelihood(1.0)
    chance = odds / (1.0 + odds)
    expected = 1.0 + chance * max(moment / evidence - 1.0, 0.0)
    assert expected_factor(Dispersion(ratio, freedom, 1.0, 0.0)) == pytest.approx(expected, rel=1e-4)


def test_memory_is_bounded_and_nothing_is_lost():
    rng = np.random.default_rng(5)
    parts = [Part(10, rng.standard_normal(2), np.eye(2)) for _ in range(1000)]
    joined = join_parts(parts)
    assert len(joined) <= MAX_STORED_PARTS
    assert sum(one.samples for one in joined) == 10000
    assert math.isclose(sum(one.gradient[0] for one in joined), sum(one.gradient[0] for one in parts), rel_tol=1e-9)
