"""Changes between two records, against Gaussian algebra, closed forms and integrals done by SciPy."""

import json
import math
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import multivariate_normal, norm

from windsysid import cli
from windsysid.errors import ConfigurationError
from windsysid.identification import identify as front
from windsysid.identification.model.prior import Prior
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import modes
from windsysid.monitoring.change import MIN_CHANGE_ODDS, Comparison, QuantityChange
from windsysid.monitoring.comparison import compare
from windsysid.monitoring.damping import separate_damping
from windsysid.monitoring.own_information import own_information, without_prior
from windsysid.monitoring.series import MIN_BLOCKS, gather
from windsysid.output.console import render
from windsysid.results.identification import Identification
from windsysid.results.posterior import Conditions, Posterior, load_posterior
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

pytestmark = pytest.mark.usefixtures("without_effects")


identify = partial(front.identify, formulation="joint")
"""Filters: what is tested here."""


SPREAD = 0.3
NAMES = ["k_x", "c_x", "k_y", "c_y"]


@pytest.fixture(scope="module")
def verne555() -> Turbine:
    return load_turbine("verne555")


@pytest.fixture(scope="module")
def tower() -> Turbine:
    """The packaged tower without its blade-passing lines, which are quick to identify without."""
    turbine = load_turbine("tower")
    return replace(turbine, loads=tuple(load for load in turbine.loads if not load.harmonic))


def posterior(
    turbine: Turbine, names: list[str], said: np.ndarray, cov: np.ndarray, spread: float = SPREAD
) -> Posterior:
    """What a prior on the references and a likelihood N(said, cov) in ln k leave together."""
    parameters = tuple(Parameter(name, turbine.values[name], spread) for name in names)
    return bayes(turbine, parameters, said, np.linalg.inv(cov))


def bayes(turbine: Turbine, parameters: tuple[Parameter, ...], said, information, record: str = "") -> Posterior:
    """What the parameters' priors and a likelihood of this mean and information leave together."""
    centre, spread = np.array([q.prior for q in parameters]).T
    precision = information + np.diag(spread**-2.0)
    theta = np.linalg.solve(precision, information @ said + centre / spread**2)
    values = {q.name: float(q.physical(t)) for q, t in zip(parameters, theta, strict=True)}
    return Posterior(
        turbine.with_values(values), parameters, theta, np.linalg.inv(precision), record or f"record {said}", True
    )


def support(turbine: Turbine, k: float = 1.0, c: float = 1.0, critical: float = 200.0) -> tuple[Parameter, ...]:
    """Priors of the support's coefficients, moved by factors and as wide as they are moved."""
    v = turbine.values
    return tuple(
        (
            Parameter(name, k * v[name], max(0.3, abs(math.log(k))))
            if name.startswith("k")
            else Parameter(name, c * v[name], max(0.3 * c, abs(c - 1.0)) * v[name], False, critical)
        )
        for name in NAMES
    )


def said_in(
    parameters: tuple[Parameter, ...], values: np.ndarray, relative: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A likelihood of SI values [ln k, c] with covariance `relative` of (ln k, c / c_file), in filter coordinates."""
    gain = np.array([1.0 if q.logarithmic else TRUE[q.name] / q.scale for q in parameters])
    mean = np.array([q.coordinate(value) for q, value in zip(parameters, values, strict=True)])
    return mean, np.linalg.inv(relative * np.outer(gain, gain))


TRUE = {"k_x": 1800.0, "c_x": 12.0, "k_y": 1650.0, "c_y": 11.0}
SIGMA = np.array([0.01, 0.2, 0.02, 0.15])


def correlated(rng: np.random.Generator, sigma: np.ndarray = SIGMA) -> np.ndarray:
    """A covariance with standard deviations `sigma` and strong correlations."""
    root = rng.standard_normal((len(sigma), 2 * len(sigma)))
    cov = root @ root.T
    return cov * np.outer(sigma / np.sqrt(np.diag(cov)), sigma / np.sqrt(np.diag(cov)))


def drawn(rng: np.random.Generator, cov: np.ndarray, factor: np.ndarray | float = 1.0) -> np.ndarray:
    """What a record with this covariance of (ln k, c / c_file) says in SI; the truth is `factor` times the file."""
    error = np.linalg.cholesky(cov) @ rng.standard_normal(4)
    truth = np.array(list(TRUE.values())) * factor
    return np.where(
        [name.startswith("k") for name in NAMES], truth * np.exp(error), truth + error * list(TRUE.values())
    )


def growth(percent: float) -> float:
    return math.log1p(percent / 100.0) if percent > -100.0 else -math.inf


def everything(comparison: Comparison) -> tuple[QuantityChange, ...]:
    return (*comparison.coefficients, *comparison.modes, *comparison.statistics)


def assert_nothing_moved(comparison: Comparison, within: float = 1e-6) -> None:
    """No change beyond `within` %, odds against one, and nothing said."""
    for change in everything(comparison):
        assert math.isnan(change.percent) or abs(change.percent) < within, change
        assert change.chance == pytest.approx(1.0, abs=1e-3)
        assert not change.log_odds > 0.01
    assert comparison.moved == ()
    assert comparison.sentence.startswith("no change")


# What records say


@pytest.mark.parametrize(("k", "c", "critical"), [(1.0, 1.0, 200.0), (1.5, 0.4, 150.0), (0.5, 3.0, 900.0)])
def test_what_a_record_says_does_not_depend_on_prior_and_scale_of_its_result(verne555, k, c, critical):
    rng = np.random.default_rng(1)
    cov, frame = correlated(rng), support(verne555)
    values = drawn(rng, cov)
    own = support(verne555, k, c, critical)
    found, vector = own_information(bayes(verne555, own, *said_in(own, values, cov)), frame)
    mean, expected = said_in(frame, values, cov)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(vector, expected @ mean, rtol=1e-7)


def test_a_coefficient_that_is_linear_in_one_result_is_taken_along_its_tangent(verne555):
    logarithmic = (Parameter("k_x", 2000.0, 0.3),)
    linear = bayes(verne555, (Parameter("k_x", 1500.0, 600.0, False, 1500.0),), np.array([1.2]), np.array([[1e8]]))
    mean, cov = without_prior(linear, logarithmic)
    assert mean[0] == pytest.approx(math.log(1800.0 / 2000.0), abs=1e-8)
    assert math.sqrt(cov[0, 0]) == pytest.approx(1e-4 / 1.2, rel=1e-6)


def test_a_result_that_is_its_prior_says_nothing(verne555):
    prior = support(verne555)
    blind = bayes(verne555, prior, np.zeros(4), np.zeros((4, 4)))
    information, vector = own_information(blind, prior)
    assert not information.any()
    assert not vector.any()
    mean, cov = without_prior(blind, prior)
    np.testing.assert_allclose(mean, [q.prior[0] for q in prior], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(cov)), [1000.0 * q.prior[1] for q in prior])


def widened(result: Posterior, *factors: float) -> Posterior:
    """A result whose intervals are wider by these factors, about the same estimates."""
    names = [q.name for q in result.parameters]
    wide = result.cov * np.outer(factors, factors)
    return result._replace(cov=wide, widening=dict(zip(names, factors, strict=True)))


@pytest.mark.parametrize("factor", [1.0, 1.6, 4.0])
def test_a_wider_interval_leaves_what_a_record_says_where_it_is(verne555, factor):
    """Found: damping of 10 ± 2.8 % with a prior of 6 ± 3 % and an interval widened 1.6 times became 47 ± 9 %."""
    rng = np.random.default_rng(7)
    cov, frame = correlated(rng, np.array([0.01, 0.4, 0.02, 0.3])), support(verne555)
    said, information = said_in(frame, drawn(rng, cov), cov)
    result = bayes(verne555, frame, said, information)
    mean, own = without_prior(widened(result, *(factor,) * 4), frame)
    np.testing.assert_allclose(mean, said, rtol=1e-4, atol=1e-6)
    # Data's share of a variance is multiplied, and divided by itself: at least the factor, and more where it is small.
    ratio = np.sqrt(np.diag(own) / np.diag(np.linalg.inv(information)))
    assert (ratio >= 0.99 * factor).all()
    assert ratio[0] == pytest.approx(factor, rel=0.2)


@pytest.mark.slow
def test_a_record_that_scatters_more_than_its_model_says_raises_no_false_alarms(verne555):
    """Scores of one record of each pair disperse 2.5² times, which its intervals include; the prior is one σ off."""
    rng, prior = np.random.default_rng(11), support(verne555, 1.0, 0.6)
    cov = np.diag(np.array([0.01, 0.3, 0.02, 0.3]) ** 2)
    chances = []
    for _ in range(150):
        results = []
        for dispersion in (1.0, 2.5**2):
            result = bayes(verne555, prior, *said_in(prior, drawn(rng, dispersion * cov), cov))
            share = 1.0 - np.diag(result.cov) / np.array([q.prior[1] ** 2 for q in prior])
            results.append(widened(result, *np.sqrt(1.0 + (dispersion - 1.0) * share)))
        chances += [change.chance for change in compare(*results).coefficients]
    assert np.mean(np.array(chances) < 0.01) < 0.02
    assert 0.02 < np.mean(np.array(chances) < 0.05) < 0.08


def test_blocks_do_not_depend_on_the_priors_of_their_results(verne555):
    rng, sets = np.random.default_rng(3), [support(verne555), support(verne555, 1.4, 0.5, 300.0)]
    said = [(drawn(rng, cov), cov) for cov in (correlated(rng) for _ in range(MIN_BLOCKS))]
    alike, mixed = (
        gather([bayes(verne555, q, *said_in(q, *s)) for q, s in zip(priors, said, strict=True)])
        for priors in ([sets[0]] * MIN_BLOCKS, [sets[i % 2] for i in range(MIN_BLOCKS)])
    )
    np.testing.assert_allclose(mixed.theta, alike.theta, atol=1e-6)
    np.testing.assert_allclose(mixed.std, alike.std, rtol=1e-5)
    np.testing.assert_allclose(alike.std, [said_std(sets[0], cov) for _, cov in said], rtol=1e-5)


def said_std(parameters: tuple[Parameter, ...], relative: np.ndarray) -> np.ndarray:
    information = said_in(parameters, np.array(list(TRUE.values())), relative)[1]
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def test_separated_damping_does_not_depend_on_the_priors_of_its_results(verne555):
    rng, sets = np.random.default_rng(4), [support(verne555), support(verne555, 0.7, 2.0, 500.0)]
    said = [(drawn(rng, cov), cov) for cov in (correlated(rng) for _ in range(2))]
    conditions = [Conditions(0.0, None), Conditions(7.0, None)]
    alike, mixed = (
        separate_damping([
            bayes(verne555, q, *said_in(q, *s))._replace(conditions=state)
            for q, s, state in zip(priors, said, conditions, strict=True)
        ]).splits
        for priors in ([sets[0]] * 2, sets)
    )  # fmt: skip
    for one, other, i in zip(alike, mixed, (1, 3), strict=True):
        np.testing.assert_allclose(other.measured, one.measured, rtol=1e-5)
        for band, (values, cov) in zip(one.measured, said, strict=True):
            assert band.value == pytest.approx(values[i], rel=1e-5)
            assert 0.25 * (band.high - band.low) == pytest.approx(math.sqrt(cov[i, i]) * TRUE[NAMES[i]], rel=1e-5)


# Nothing moved


def test_one_result_twice_has_not_moved(verne555):
    rng = np.random.default_rng(5)
    cov, prior = correlated(rng, np.array([0.01, 5.0, 0.3, 0.2])), support(verne555)  # c_x and k_y hardly informed
    result = bayes(verne555, prior, *said_in(prior, drawn(rng, correlated(rng)), cov))
    assert_nothing_moved(compare(result, result))
    assert compare(result, result).same


@pytest.mark.parametrize("seed", range(5))
def test_one_record_under_two_priors_has_not_moved_in_either_order(verne555, seed):
    rng = np.random.default_rng(seed)
    cov = correlated(rng, rng.choice([0.02, 0.3, 3.0], 4))
    values = drawn(rng, correlated(rng))
    k, c = rng.choice([0.6, 1.8], 2)
    sets = [support(verne555), support(verne555, k, c, 317.0)]
    a, b = (bayes(verne555, q, *said_in(q, values, cov), record=f"result {q[0].centre}") for q in sets)
    assert_nothing_moved(compare(a, b), within=1e-3)
    assert_nothing_moved(compare(b, a), within=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_the_way_back_is_the_change_backwards(verne555, seed):
    rng = np.random.default_rng(10 + seed)
    results = []
    for q in (support(verne555), support(verne555, 1.3, 0.5, 333.0)):
        cov = correlated(rng, rng.choice([0.02, 0.2, 2.0], 4))
        results.append(bayes(verne555, q, *said_in(q, drawn(rng, correlated(rng), rng.uniform(0.5, 2.0, 4)), cov)))
    results[1] = results[1]._replace(turbine=replace(results[1].turbine, rotor_speed=5.0))
    there, back = compare(*results), compare(*results[::-1])
    assert {c.name for c in there.modes} == {c.name for c in back.modes}
    for one in everything(there):
        other = next(c for c in everything(back) if c.name == one.name)
        assert min(one.low, other.low) >= -100.0
        if one.is_bounded:
            assert growth(one.percent) == pytest.approx(-growth(other.percent), abs=1e-9)
        assert other.is_bounded == one.is_bounded
        assert growth(one.low) == pytest.approx(-growth(other.high), rel=1e-9)
        assert one.chance == pytest.approx(other.chance)
        assert one.log_odds == pytest.approx(other.log_odds, nan_ok=True)
        assert one.before == pytest.approx(other.after)


# By how much, and how sure


def test_the_change_is_that_of_the_likelihoods_alone(verne555):
    names, rng = ["k_x", "k_y"], np.random.default_rng(1)
    covs = [a @ a.T for a in 0.02 * rng.standard_normal((2, 2, 3))]
    said = 0.1 * rng.standard_normal((2, 2))
    found = compare(*(posterior(verne555, names, m, c) for m, c in zip(said, covs, strict=True)))
    for i, change in enumerate(found.coefficients):
        sigma = math.sqrt(covs[0][i, i] + covs[1][i, i])
        delta = said[1, i] - said[0, i]
        assert growth(change.percent) == pytest.approx(delta, abs=2e-3 * sigma)
        assert growth(change.high) - growth(change.low) == pytest.approx(4.0 * sigma, rel=2e-3)
        assert change.chance == pytest.approx(2.0 * norm.sf(abs(delta) / sigma), rel=2e-2)


@pytest.mark.parametrize("seed", range(4))
def test_odds_of_many_coefficients_are_ratios_of_evidences(verne555, seed):
    """Of an unknown level only d = y_B − y_A is known: N(0, C_A + C_B + T), with or without the coefficient's T."""
    rng = np.random.default_rng(20 + seed)
    covs = [correlated(rng) for _ in range(2)]
    said = [drawn(rng, cov, rng.uniform(0.9, 1.1, 4)) for cov in covs]
    sets = support(verne555), support(verne555, 1.2, 0.6, 270.0)
    a, b = (bayes(verne555, q, *said_in(q, *s)) for q, s in zip(sets, zip(said, covs, strict=True), strict=True))
    found = compare(a, b).coefficients
    # in ln k and in c over the mean of the two estimates
    size = np.array([0.5 * (a.turbine.values[name] + b.turbine.values[name]) for name in NAMES])
    is_k = np.array([name.startswith("k") for name in NAMES])
    d = np.where(is_k, np.log(said[1] / said[0]), (said[1] - said[0]) / size)
    unit = np.where(is_k, 1.0, np.array(list(TRUE.values())) / size)
    noise = (covs[0] + covs[1]) * np.outer(unit, unit)
    typical = np.where(is_k, 0.1, 0.5) ** 2
    for i, change in enumerate(found):
        without = np.where(np.arange(4) == i, 0.0, typical)
        evidence = [multivariate_normal.logpdf(d, cov=noise + np.diag(t)) for t in (typical, without)]
        assert change.log_odds == pytest.approx(evidence[0] - evidence[1], abs=1e-5)
        assert change.chance == pytest.approx(2.0 * norm.sf(abs(d[i]) / math.sqrt(noise[i, i])), rel=1e-3)


@pytest.mark.parametrize("moved", [0.0, 0.03, 0.1])
def test_the_odds_of_one_coefficient_are_integrals_over_its_level(verne555, moved):
    sigma_a, sigma_b, tau = 0.015, 0.02, 0.1
    a, b = (
        posterior(verne555, ["k_x"], np.array([at]), np.array([[sigma**2]]))
        for at, sigma in ((0.01, sigma_a), (0.01 + moved, sigma_b))
    )

    level = np.linspace(-0.3, 0.3, 401)

    def evidence(change: float) -> float:
        """∫ N(y_A | θ) N(y_B | θ + δ) dθ"""
        return float(trapezoid(norm.pdf(0.01, level, sigma_a) * norm.pdf(0.01 + moved, level + change, sigma_b), level))

    changes = np.linspace(-0.6, 0.6, 401)
    with_change = trapezoid([evidence(d) for d in changes] * norm.pdf(changes, 0.0, tau), changes)
    (change,) = compare(a, b).coefficients
    assert math.exp(change.log_odds) == pytest.approx(with_change / evidence(0.0), rel=1e-4)


def test_a_coefficient_that_is_expected_about_zero_is_as_large_as_its_priors_are_wide(verne555):
    """So that the damping between hub and blades moves by half of what it may be, and not by half of nothing."""
    sigma = 0.5
    a, b = (
        bayes(verne555, (Parameter("c_x", 0.0, wide, False, 200.0),), np.array([said / 200.0]),
        np.eye(1) * (200.0 / sigma) ** 2)
        for said, wide in ((-1.0, 4.0), (1.5, 9.0))
    )  # fmt: skip
    (change,) = compare(a, b).coefficients
    evidence = [norm.logpdf(2.5, 0.0, math.sqrt(2.0 * sigma**2 + tau**2)) for tau in (0.5 * 6.0, 0.0)]
    assert change.log_odds == pytest.approx(evidence[0] - evidence[1], abs=1e-5)


def damped(turbine: Turbine, value: float, std: float, spread: float = 3.0) -> Posterior:
    """A result that says c_x = value ± std [N·s/m]."""
    q = (Parameter("c_x", 12.0, spread, False, 200.0),)
    return bayes(turbine, q, np.array([value / 200.0]), np.array([[(200.0 / std) ** 2]]))


@pytest.mark.parametrize(("a", "b"), [((12.0, 1.0), (6.0, 1.5)), ((5.0, 2.0), (20.0, 2.0)), ((10.0, 0.1), (10.1, 0.2))])
def test_limits_of_a_ratio_of_damping_are_where_the_difference_is_two_sigma(verne555, a, b):
    (change,) = compare(damped(verne555, *a), damped(verne555, *b)).coefficients
    assert 1.0 + change.percent / 100.0 == pytest.approx(b[0] / a[0], rel=1e-5)
    for limit in (change.low, change.high):
        ratio = 1.0 + limit / 100.0
        assert abs(b[0] - ratio * a[0]) == pytest.approx(2.0 * math.hypot(b[1], ratio * a[1]), rel=1e-4)
    assert change.low < change.percent < change.high


def test_damping_that_may_be_nothing_has_a_band_without_an_end(verne555):
    firm, faint, negative = damped(verne555, 12.0, 1.0), damped(verne555, 5.0, 4.0), damped(verne555, -8.0, 1.0, 30.0)
    (fell,) = compare(firm, faint).coefficients
    (rose,) = compare(faint, firm).coefficients
    assert fell.low == -100.0
    assert -100.0 < fell.percent < fell.high < math.inf
    assert rose.high == math.inf
    assert -100.0 < rose.low < rose.percent < math.inf
    (gone,) = compare(firm, negative).coefficients
    assert (gone.percent, gone.low, gone.high) == (-100.0, -100.0, -100.0)
    assert gone.moved
    assert "c_x rose from about zero" in compare(negative, firm).sentence
    (neither,) = compare(faint, faint._replace(record="another")).coefficients
    assert (neither.low, neither.high, neither.is_bounded) == (-100.0, math.inf, False)
    (unstable,) = compare(negative, negative._replace(record="another")).coefficients
    assert not unstable.is_bounded


def test_ratio_limits_hold_the_truth_as_often_as_two_sigma_should():
    from windsysid.monitoring.comparison import _ratio

    rng, held = np.random.default_rng(7), 0
    for _ in range(4000):
        a, b = 1.0 + 0.3 * rng.standard_normal(), 0.5 + 0.2 * rng.standard_normal()
        _, low, high = _ratio((a, 0.3), (b, 0.2))
        held += low <= -50.0 <= high
    assert held / 4000 == pytest.approx(0.9545, abs=0.011)


def test_false_alarms_are_as_rare_as_the_odds_promise_and_bands_hold(tower):
    rng, sigma = np.random.default_rng(2), np.array([0.005, 0.02])
    names, alarms, held, runs = ["k_side_side", "k_fore_aft"], 0, 0, 250
    for _ in range(runs):
        a, b = (posterior(tower, names, sigma * rng.standard_normal(2), np.diag(sigma**2)) for _ in range(2))
        found = compare(a, b).coefficients
        alarms += sum(change.moved for change in found)
        held += sum(change.low < 0.0 < change.high for change in found)
    assert alarms <= 2 * runs / MIN_CHANGE_ODDS
    assert held / (2 * runs) == pytest.approx(0.954, abs=0.025)


def test_only_coefficients_that_are_not_to_be_used_are_doubted(verne555):
    good = posterior(verne555, NAMES, np.zeros(4), 1e-4 * np.eye(4))
    some = good._replace(record="some", trusted=False, unusable={"c_y": "prior_conflict"})
    every = good._replace(record="every", trusted=False, unusable=dict.fromkeys(NAMES, "burst"))
    other = good._replace(record="other", trusted=False, unusable={"c_z": "burst"})
    said = {one.record: compare(good._replace(record="good"), one).doubts for one in (some, every, other)}
    assert said["some"] == ("c_y of some (grade C): see its report; the others may be compared",)
    assert said["other"] == ()
    assert said["every"] == ("findings speak against the result of every: see its report",)


def test_what_one_record_does_not_see_has_not_moved(verne555):
    """However sure the other one is, and wherever the priors are."""
    blind = posterior(verne555, ["k_x", "k_y"], np.array([0.1, 0.0]), np.diag([1e-4, 1e14]))
    sharp = posterior(verne555, ["k_x", "k_y"], np.array([0.1, 0.7]), np.diag([1e-4, 1e-6]))
    for pair in ((blind, sharp), (sharp, blind)):
        found = compare(*pair)
        change = found.coefficients[1]
        assert (change.is_bounded, change.low, change.high) == (False, -100.0, math.inf)
        assert change.log_odds == pytest.approx(0.0, abs=1e-3)
        assert "the records hold too little information on k_y" in found.sentence


# Modes


def test_a_towers_frequency_moves_half_as_far_as_its_stiffness(tower):
    names = ["k_side_side", "k_fore_aft"]
    said, sigma = np.array([[0.02, -0.01], [-0.2, 0.03]]), np.array([[0.01, 0.03], [0.02, 0.01]])
    found = compare(*(posterior(tower, names, m, np.diag(s**2)) for m, s in zip(said, sigma, strict=True)))
    for i, mode in enumerate(("tower side-side", "tower fore-aft")):
        change = next(c for c in found.modes if c.name == mode)
        assert growth(change.percent) == pytest.approx(0.5 * (said[1, i] - said[0, i]), abs=1e-5)
        assert growth(change.high) - growth(change.percent) == pytest.approx(math.hypot(*sigma[:, i]), rel=1e-3)
        assert growth(change.percent) - growth(change.low) == pytest.approx(math.hypot(*sigma[:, i]), rel=1e-3)
        assert change.chance == pytest.approx(found.coefficients[i].chance)


def test_bands_of_a_rotors_modes_are_those_of_finite_differences_at_the_mean_rotor_speed(verne555):
    rng, h, speeds = np.random.default_rng(8), 1e-4, (6.0, 8.0)
    covs, values = [correlated(rng) for _ in range(2)], np.array(list(TRUE.values()))
    prior = support(verne555)
    a, b = (
        bayes(replace(verne555, rotor_speed=speed), prior, *said_in(prior, values * factor, cov))
        for speed, cov, factor in zip(speeds, covs, (1.0, np.array([1.02, 1.3, 0.99, 0.8])), strict=True)
    )
    compiled = compile_model(verne555.model)

    def frequencies(result: Posterior, moved: str, step: float) -> dict[str, float]:
        v = {**result.turbine.values}
        v[moved] *= math.exp(step)
        p = np.array([v[name] for name in compiled.parameters])
        return {name: math.log(f) for name, f, _ in modes(verne555.model, compiled, p, 7.0)}

    found = compare(a, b)
    assert len(found.modes) == 5
    for mode in found.modes:
        slope = np.array([
            np.mean([(frequencies(r, q, h)[mode.name] - frequencies(r, q, -h)[mode.name]) / (2.0 * h) for r in (a, b)])
            for q in NAMES
        ])  # fmt: skip
        # of damping: d ln f / d(c / c_file), c being 1 and 1.3, 0.8 times the file's or nearly so
        size = [1.0 if q[0] == "k" else TRUE[q] * np.mean([1 / r.turbine.values[q] for r in (a, b)]) for q in NAMES]
        slope *= size
        step = slope @ [math.log(1.02), 0.3, math.log(0.99), -0.2]
        sigma = math.sqrt(slope @ (covs[0] + covs[1]) @ slope)
        assert growth(mode.percent) == pytest.approx(step, abs=0.02 * sigma + 1e-9)
        assert growth(mode.high) - growth(mode.low) == pytest.approx(4.0 * sigma, rel=0.01, abs=1e-9)
        assert mode.before == pytest.approx(math.exp(frequencies(a, "k_x", 0.0)[mode.name]))
        assert mode.after == pytest.approx(math.exp(frequencies(b, "k_x", 0.0)[mode.name]))


# Statistics of loads and noise


def learned(result: Posterior, said, information, given: float, model: str = "load_time_constant") -> Posterior:
    """`result`, and what it would have learned of a load and a noise from a likelihood of θ and η together."""
    n = len(result.parameters)
    statistics: tuple[Statistic, ...] = (
        Statistic("load_rms_support", "N", given, kind="level", time_constant="load_time_constant"),
        Statistic(model, "s", 2.0 * given, spread=0.7),
        Statistic("noise_tower_acceleration", "m/s^2", 0.05, kind="noise"),
    )
    spread = np.concatenate([[q.prior[1] for q in result.parameters], [1.5, 0.7, 1.5]])
    centre = np.concatenate([[q.prior[0] for q in result.parameters], np.zeros(3)])
    precision = information + np.diag(spread**-2.0)
    mean = np.linalg.solve(precision, information @ said + centre / spread**2)
    level, time, noise = mean[n:]
    level += 0.5 * time if model == "load_time_constant" else 0.0
    found = zip(statistics, (level, time, noise), strict=True)
    found_out = tuple(replace(s, estimate=s.given * math.exp(value)) for s, value in found)
    cov = np.linalg.inv(precision)
    return result._replace(theta=mean[:n], cov=cov[:n, :n], statistics=found_out, joint_cov=cov)


def with_statistics(
    turbine: Turbine, given: float, k: float, said: np.ndarray, cov: np.ndarray, model: str = "load_time_constant"
) -> Posterior:
    """A result of k_x and three statistics; `said` and `cov` are of ln(k/1800), ln(rms / √τ), ln τ and ln noise."""
    q = (Parameter("k_x", 1800.0 * k, max(0.3, abs(math.log(k)))),)
    result = bayes(turbine, q, np.zeros(1), np.eye(1), record=f"given {given}, prior {k}")
    shift = np.array(
        [math.log(k), math.log(given) - 0.5 * math.log(2.0 * given), math.log(2.0 * given), math.log(0.05)]
    )
    result = learned(result, said - shift, np.linalg.inv(cov), given, model)
    values = {"k_x": float(q[0].physical(result.theta[0]))}
    return result._replace(turbine=turbine.with_values(values))


LEVELS = np.array([0.05, 1.0, 0.3, -3.0])


def test_statistics_move_by_what_the_records_say_of_them(verne555):
    rng, step = np.random.default_rng(9), np.array([0.02, 0.4, -0.3, 0.1])
    covs = [correlated(rng, np.array([0.02, 0.1, 0.3, 0.05])) for _ in range(2)]
    a = with_statistics(verne555, 3.0, 1.0, LEVELS, covs[0])
    b = with_statistics(verne555, 5.0, 1.4, LEVELS + step, covs[1])
    found = {c.name: c for c in compare(a, b).statistics}
    turn = np.array([[0.0, 1.0, 0.5, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])  # ln rms = level + ln τ / 2
    sigma = np.sqrt(np.diag(turn @ (covs[0] + covs[1]) @ turn.T))
    assert list(found) == ["load_rms_support", "load_time_constant", "noise_tower_acceleration"]
    for change, delta, s in zip(found.values(), turn @ step, sigma, strict=True):
        assert growth(change.percent) == pytest.approx(delta, abs=1e-3 * s)
        assert growth(change.high) - growth(change.low) == pytest.approx(4.0 * s, rel=1e-3)
    assert found["load_rms_support"].unit == "N"
    assert found["load_rms_support"].after == pytest.approx(b.statistics[0].estimate)


def test_one_record_under_two_priors_has_the_same_statistics(verne555):
    cov = correlated(np.random.default_rng(11), np.array([0.2, 0.1, 0.5, 0.05]))
    a, b = (with_statistics(verne555, given, k, LEVELS, cov) for given, k in ((3.0, 1.0), (8.0, 0.6)))
    for found in (compare(a, b), compare(b, a)):
        for change in found.statistics:
            assert abs(change.percent) < 1e-3
            assert change.log_odds < 0.0


def test_loads_that_were_taken_for_different_things_are_not_compared(verne555):
    cov = np.diag(np.square([0.02, 0.1, 0.3, 0.05]))
    a, b = (with_statistics(verne555, 3.0, 1.0, LEVELS, cov, model) for model in ("load_time_constant", "load_corner"))
    assert [c.name for c in compare(a, b).statistics] == ["noise_tower_acceleration"]


def test_loads_that_differ_are_told_apart_from_the_turbine(verne555):
    cov = np.diag(np.square([0.02, 0.1, 0.3, 0.05]))
    a, b = (
        with_statistics(verne555, 3.0, 1.0, LEVELS + step, cov)._replace(record=f"{step}")
        for step in (0.0, np.array([0.0, 0.0, 0.0, 1.0]))
    )
    found = compare(a, b)
    assert found.moved == ()
    assert found.sentence.startswith("no change")
    assert found.sentence.endswith("loads and noise differ in noise_tower_acceleration")


# What else the comparison says


def test_overlapping_sections_files_that_differ_and_coefficients_of_one_result_alone_are_told(verne555):
    prior = support(verne555)
    a = bayes(
        verne555, prior, *said_in(prior, np.array(list(TRUE.values())), np.diag(SIGMA**2)), record="june, 0–600 s"
    )
    a = a._replace(section=(0.0, 600.0))
    other = a._replace(record="june, 300–900 s", section=(300.0, 900.0))
    assert "the two sections of june have 300 s in common" in compare(a, other).notes[0]
    assert compare(a, other._replace(section=(600.0, 900.0))).notes == ()
    heavier = other._replace(turbine=other.turbine.with_values({"hub_mass_x": 8.0}))
    assert "the turbine files of the two results differ in hub_mass_x" in compare(a, heavier).doubts[0]
    fewer = other._replace(parameters=prior[:3], theta=other.theta[:3], cov=other.cov[:3, :3])
    assert "only one of the two results identified c_y" in compare(a, fewer).doubts[0]


def test_results_of_one_name_that_disagree_are_not_called_the_same_record(verne555):
    """Two files may have one name."""
    a, b = (
        posterior(verne555, ["k_x"], np.array([at]), np.eye(1) * 1e-4)._replace(record="vibration, 0–600 s")
        for at in (0.0, 0.2)
    )
    found = compare(a, b)
    assert not found.same
    assert found.sentence.startswith("changed: k_x rose by")
    assert "both results are of vibration, 0–600 s" in found.doubts[0]


def test_one_record_by_its_hash_has_not_moved_and_two_of_one_name_may_have(verne555):
    a, b = (posterior(verne555, ["k_x"], np.array([at]), np.eye(1) * 1e-4) for at in (0.0, 0.2))
    one = [
        r._replace(record=name, record_hash="0f", section=(0.0, 600.0)) for r, name in ((a, "a.csv"), (b, "copy.csv"))
    ]
    found = compare(*one)
    assert found.same
    assert not found.moved
    assert "the same values, so there is no change" in found.doubts[0]
    other = one[1]._replace(record="a.csv", record_hash="1e")
    assert [change.name for change in compare(one[0], other).moved] == ["k_x"]
    assert not compare(one[0], other).same
    half = one[1]._replace(section=(300.0, 900.0))
    assert "300 s in common" in compare(one[0], half).notes[0]


def test_records_without_a_common_coefficient_are_refused(verne555):
    a, b = (posterior(verne555, [name], np.zeros(1), np.eye(1)) for name in ("k_x", "k_y"))
    with pytest.raises(ConfigurationError, match="expected coefficients that both identified, got k_x and k_y"):
        compare(a, b)


def test_the_winds_mean_lag_angle_is_neither_compared_nor_followed(verne555: Turbine):
    leading = replace(
        verne555, model=replace(verne555.rotor, leads=True), values={**verne555.values, "mean_lag_angle": 0.004}
    )
    parameters = (Parameter("k_x", 1800.0, 0.3), Parameter("mean_lag_angle", 0.0, 0.01, False, 0.01))
    a, b = (bayes(leading, parameters, np.array([0.0, angle]), 1e4 * np.eye(2)) for angle in (0.2, 0.9))
    assert [change.name for change in compare(a, b).coefficients] == ["k_x"]
    results = [a._replace(record=f"record {i}") for i in range(MIN_BLOCKS)]
    assert gather(results, time=np.arange(float(MIN_BLOCKS))).names == ("k_x",)


# Through identification


@pytest.fixture(scope="module")
def identified(tower: Turbine) -> list[Identification]:
    """A record, a record of a softer tower, and the first one again under other priors."""
    truth = [tower.with_values({"k_side_side": k * tower.values["k_side_side"]}) for k in (1.0, 0.8)]
    records = [simulate_record(of, duration=200.0, rate=4.0, seed=seed) for seed, of in enumerate(truth, 3)]
    runs = [(records[0], Prior()), (records[1], Prior()), (records[0], Prior(1.2, 0.5))]
    return [identify(record, tower, prior=prior, loads="broadband") for record, prior in runs]


@pytest.fixture(scope="module")
def results(identified: list[Identification], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folders = [tmp_path_factory.mktemp(f"result_{i}") for i in range(len(identified))]
    for found, folder in zip(identified, folders, strict=True):
        found.save(folder)
    return folders


def test_a_softer_tower_is_found_and_nothing_else(results):
    found: Comparison = compare(*map(load_posterior, results[:2]))
    assert [change.name for change in found.moved] == ["k_side_side"]
    assert found.coefficients[0].low < -20.0 < found.coefficients[0].high
    assert "changed: k_side_side fell by" in found.sentence
    by_mode = {change.name: change for change in found.modes}
    assert by_mode["tower side-side"].high < 0.0
    assert by_mode["tower side-side"].low < 100.0 * (math.sqrt(0.8) - 1.0) < by_mode["tower side-side"].high
    assert found.doubts == ()


def test_an_identified_record_under_other_priors_has_not_moved_in_either_order(results):
    a, b = (load_posterior(results[i]) for i in (0, 2))
    assert a.turbine.values["c_side_side"] != pytest.approx(b.turbine.values["c_side_side"], rel=0.1)
    for pair in ((a, b), (b, a)):
        found = compare(*pair)
        assert found.same
        for change in everything(found):
            assert change.chance > 0.9, change  # not quite 1: the record is not quite Gaussian
            assert not change.log_odds > 0.0
            if change.is_bounded:
                assert abs(growth(change.percent)) < 0.02 * (growth(change.high) - growth(change.low)), change
        assert (
            found.sentence
            == f"no change: both results are of the same record and section ({a.record}), and one record cannot"
            " differ from itself"
        )


def test_saved_results_compare_as_those_in_memory(identified, results):
    kept, loaded = compare(*(f.posterior for f in identified[:2])), compare(*map(load_posterior, results[:2]))
    assert len(kept.statistics) == 4
    for one, other in zip(everything(kept), everything(loaded), strict=True):
        assert one[:2] == other[:2]
        assert one[2:] == pytest.approx(other[2:], nan_ok=True)


def test_the_command_says_it_and_writes_it(results, tmp_path, monkeypatch, capsys):
    output = tmp_path / "comparison"
    monkeypatch.setattr(sys, "argv", ["windsysid", "compare", *map(str, results[:2]), "--output", str(output)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code in (0, None)
    assert "changed: k_side_side fell by" in capsys.readouterr().out
    assert sorted(path.name for path in output.glob("[!.]*")) == [
        "answer.json",
        "changes.png",
        "report.html",
        "summary.json",
    ]
    summary = json.loads((output / "summary.json").read_text())
    assert summary["moved"] == ["k_side_side"]
    assert "noise_tower_acceleration" in summary["statistics"]


def test_a_folder_without_a_result_is_refused_in_one_line(results, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["windsysid", "compare", str(results[0]), str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert "expected a result of windsysid identify" in line


@pytest.mark.parametrize(
    ("percent", "half", "row"),
    [
        (0.004, 0.001, ("1.774", "1.774071", "+0.0040", "+0.0030…+0.0050")),
        (-3.2, 1.6, ("1.774", "1.717", "-3.20", "-4.80…-1.60")),
        (135.0, 400.0, ("1.774", "4.169", "+135", "-265…+535")),
    ],
)
def test_a_change_is_shown_to_two_digits_of_its_interval(percent: float, half: float, row: tuple[str, ...]):
    after = 1.774e6 * (1.0 + 0.01 * percent)
    values = (1.774e6, after, percent, percent - half, percent + half, 6.0, 0.0)
    change = QuantityChange("k_side_side", "N/m", *values, "stiffness")
    assert Comparison(("a", "b"), (change,), (), (), False, (), ()).rows[0][1:5] == row


def test_a_likely_change_comes_first_and_each_detectable_size_has_its_coefficient():
    """The answer said "no change", then that a stiffness may have fallen, and one size for all."""
    sides = QuantityChange("k_side_side", "N/m", 1.77e6, 1.72e6, -3.2, -4.9, -1.5, math.log(66.6), 1e-3, "stiffness")
    fore = QuantityChange("k_fore_aft", "N/m", 1.88e6, 1.91e6, 1.9, -5.5, 9.9, -1.0, 0.6, "stiffness")
    said = Comparison(("a", "b"), (sides, fore), (), (), False, (), ()).sentence
    assert said.startswith("may have changed: k_side_side fell by 3.2 %")
    assert "no change" not in said
    assert "a change of stiffness by less than 3.6 % (k_side_side) … 16 % (k_fore_aft) could remain undetected" in said
    calm = sides._replace(log_odds=0.0)
    said = Comparison(("a", "b"), (calm,), (), (), False, (), ()).sentence
    assert said.startswith(
        "no change shown: no coefficient reaches odds of 10 : 1; a change of stiffness by less than "
    )


def test_a_comparison_is_one_table_at_80_columns():
    names = ("noise_tower_acceleration", "m/s^2"), ("k_side_side", "N/m")
    values = (0.004954, 0.004967, math.nan, -100.0, math.inf, 0.0, 1.0)
    changes = tuple(QuantityChange(*one, *values) for one in names)
    shown = render(Comparison(("a", "b"), (), (), changes, False, (), ()).table(), width=80)
    assert shown.count("noise_tower_acceleration") == 1
    assert max(map(len, shown.splitlines())) <= 80
