"""The particle filter: equal to the Kalman filter where that is exact, reproducible, and better where it is not."""

import itertools
from collections import Counter
from dataclasses import replace
from typing import Any

import numba
import numpy as np
import pytest
import scipy.integrate
import scipy.special
import scipy.stats
import sympy as sp

from tests.filters.test_protocol import (
    LOADS,
    assert_a_sample_without_readings_is_a_prediction,
    assert_same,
    chain_with,
    record,
    rotor_with_everything,
    without_mechanics,
)
from tests.mechanics.models import CHAIN_VALUES, Reads, chain_sensors, symbols
from windsysid.errors import ConfigurationError
from windsysid.filters import EKF, Mixture, MixtureInfo, ParticleFilter, RaoBlackwellised, SplitModel, degeneracy
from windsysid.filters.particles.cloud import weighted_quantiles
from windsysid.filters.particles.resampling import Resampling, ancestors
from windsysid.filters.particles.weights import ParticleInfo, liu_west
from windsysid.kernels.philox import Purpose, _words, normals, uniforms
from windsysid.mechanics.equations import Equations
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter

SCHEMES: tuple[Resampling, ...] = ("systematic", "stratified", "residual")


def regression(spread: float = 1.0, noise: float = 0.3, centre: tuple[float, float] = (1.0, 1.0)) -> StateSpace:
    """Two readings, linear in two coefficients: a + b t and a t."""
    a, b, t = symbols("a b t")
    return compose(
        Equations("regression", (), (t,), (a, b), (), ()),
        rate=10.0,
        values={},
        parameters=[Parameter("a", centre[0], spread, False), Parameter("b", centre[1], spread, False)],
        sensors=(Reads("line", a + b * t, noise), Reads("slope", a * t, noise)),
    )


def straight(model: StateSpace, samples: int, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = rng.uniform(-1.0, 1.0, samples)
    noise = np.sqrt(model.blocks.noise) * rng.standard_normal((samples, 2))
    return t[:, None], np.column_stack([0.5 + 2.0 * t, 0.5 * t]) + noise


MODELS = {
    "regression": regression,
    "rotor": rotor_with_everything,
    "chain_with_loads_and_a_parameter": lambda: chain_with(loads=LOADS, parameters=[Parameter("k_2", 330.0, 0.2)]),
    "sampled_unequally": lambda: chain_with(loads=LOADS, rate=None, intervals=[0.02, 0.005, 0.033]),
    "line": without_mechanics,
}
every_model = pytest.mark.parametrize("name", MODELS)


def joined(infos: list[ParticleInfo]) -> ParticleInfo:
    return ParticleInfo(*(np.concatenate(parts) for parts in zip(*infos, strict=True)))


# the protocol


@every_model
@pytest.mark.parametrize("tempering", [True, False])
def test_step_is_run_and_predict_then_update_is_step(name: str, tempering: bool):
    model, pf = MODELS[name](), ParticleFilter(particles=300, seed=3, tempering=tempering)
    inputs, readings = record(model)
    whole, info = pf.run(model, pf.init(model), inputs, readings)
    assert info.resamplings.sum() > 0
    stepped, infos = pf.init(model), []
    for u, y in zip(inputs, readings, strict=True):
        updated, updating = pf.update(model, pf.predict(model, stepped, u), y)
        stepped, one = pf.step(model, stepped, u, y)
        infos.append(one)
        assert_same(updated, stepped)
        np.testing.assert_array_equal(updating.log_likelihood, one.log_likelihood)
    assert_same(stepped, whole)
    assert_same(joined(infos), info)


@every_model
def test_a_run_can_stop_and_go_on_and_changes_nothing_it_is_given(name: str):
    model, pf = MODELS[name](), ParticleFilter(particles=300)
    inputs, readings = record(model)
    whole, info = pf.run(model, pf.init(model), inputs, readings)
    belief, first = pf.run(model, pf.init(model), inputs[:17], readings[:17])
    before = [np.copy(array) for array in belief]
    end, second = pf.run(model, belief, inputs[17:], readings[17:])
    assert_same(end, whole)
    assert_same(joined([first, second]), info)
    for array, copy in zip(belief, before, strict=True):
        np.testing.assert_array_equal(array, copy)
    again, _ = pf.run(model, belief, inputs[17:17], readings[17:17])
    assert_same(again, belief)


@every_model
def test_threads_change_nothing(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.filters.particles.filter.MIN_THREADED_WORK", 0)
    model = MODELS[name]()
    inputs, readings = record(model)
    runs = []
    for threads in (1, 2, 3):
        pf = ParticleFilter(particles=1100, seed=4, threads=threads)
        runs.append(pf.run(model, pf.init(model), inputs, readings))
    for belief, info in runs[1:]:
        assert_same(belief, runs[0][0])
        assert_same(info, runs[0][1])


def test_a_seed_decides_everything():
    model = regression()
    inputs, readings = straight(model, 50)
    ends = [pf.run(model, pf.init(model), inputs, readings)[0] for pf in map(seeded, (7, 7, 8))]
    assert_same(ends[0], ends[1])
    assert not np.any(ends[0].particles == ends[2].particles)


def seeded(seed: int) -> ParticleFilter:
    return ParticleFilter(particles=500, seed=seed)


@every_model
def test_what_is_missing_is_left_out(name: str):
    model, pf = MODELS[name](), ParticleFilter(particles=300)
    inputs, readings = record(model)
    assert_a_sample_without_readings_is_a_prediction(pf, model, inputs, readings)
    _, info = pf.run(model, pf.init(model), inputs, readings)
    for array in (info.innovation, info.innovation_std, info.whitened):
        np.testing.assert_array_equal(np.isnan(array), np.isnan(readings))
    assert np.isfinite(info.mean).all()
    assert np.isfinite(info.std).all()
    assert np.isfinite(info.log_likelihood).all()


# against the Kalman filter


def off(model: StateSpace, inputs: np.ndarray, readings: np.ndarray, seeds: int, **options: Any) -> np.ndarray:
    """Rms over seeds of three errors.

    The mean's error in Kalman standard deviations, the ratio of variances − 1, the log-likelihood's error.
    """
    exact, info = EKF.run(model, EKF.init(model), inputs, readings)
    std = np.sqrt(np.diag(exact.cov))
    errors = []
    for seed in range(seeds):
        pf = ParticleFilter(seed=seed, **options)
        cloud, found = pf.run(model, pf.init(model), inputs, readings)
        errors.append(
            [
                np.sqrt(np.mean(((cloud.mean - exact.mean) / std) ** 2)),
                np.sqrt(np.mean((np.diag(cloud.cov) / std**2 - 1.0) ** 2)),
                found.log_likelihood.sum() - info.log_likelihood.sum(),
            ]
        )
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=0)))


@pytest.mark.parametrize(
    "resampling", [SCHEMES[0], *(pytest.param(one, marks=pytest.mark.slow) for one in SCHEMES[1:])]
)
def test_static_coefficients_are_the_kalman_filters(resampling: Resampling):
    model = regression()
    inputs, readings = straight(model, 300)
    few, many = (off(model, inputs, readings, 8, particles=n, resampling=resampling) for n in (300, 4800))
    assert np.all(many < [0.1, 0.06, 0.5])
    assert np.all(
        few[:2] > 2.0 * many[:2]
    )  # 16 times the particles: a quarter of the error, as far as 8 seeds can tell


@pytest.mark.slow
def test_moving_states_are_the_kalman_filters():
    # A coarse sensor, so that a sample says little more than the motion forgets.
    sensors = (Reads("displacement_2", symbols("q_2")[0], 0.05),)
    model = chain_with(loads=LOADS, sensors=sensors, cov=0.02**2 * np.eye(6))
    readings = 0.06 * np.random.default_rng(21).standard_normal((60, 1))
    few, many = (off(model, np.zeros((60, 3)), readings, 5, particles=n) for n in (300, 4800))
    assert np.all(many < [0.1, 0.1, 0.2])
    assert np.all(few > 2.0 * many)


def test_the_info_of_each_sample_is_the_kalman_filters():
    model = regression()
    inputs, readings = straight(model, 200)
    readings[::7, 0] = np.nan
    _, exact = EKF.run(model, EKF.init(model), inputs, readings)
    pf = ParticleFilter(particles=20_000)
    _, found = pf.run(model, pf.init(model), inputs, readings)
    assert np.nanmax(np.abs(found.mean - exact.mean) / exact.std) < 0.15
    assert np.nanmax(np.abs(found.std / exact.std - 1.0)) < 0.1
    assert np.nanmax(np.abs(found.innovation - exact.innovation) / exact.innovation_std) < 0.05
    assert np.nanmax(np.abs(found.innovation_std / exact.innovation_std - 1.0)) < 0.02


def test_a_parameter_that_walks_is_followed_as_by_the_kalman_filter():
    a, t = symbols("a t")
    model = compose(
        Equations("walk", (), (t,), (a,), (), ()), rate=10.0, values={}, parameters=[Parameter("a", 1.0, 1.0, False)],
        sensors=(Reads("a", a, 0.3),), walk={"a": 0.5},
    )  # fmt: skip
    readings = np.cumsum(np.random.default_rng(8).standard_normal((200, 1)) * 0.16, axis=0) + 1.0
    assert np.all(off(model, np.zeros((200, 1)), readings, 4, particles=10_000, discount=1.0) < [0.05, 0.06, 0.3])


# static parameters


def test_without_a_kernel_the_values_die_out_and_with_it_they_do_not():
    model = regression(noise=0.1)
    inputs, readings = straight(model, 2000)
    exact, _ = EKF.run(model, EKF.init(model), inputs, readings)
    left = {}
    for discount in (1.0, 0.95):
        pf = ParticleFilter(particles=500, discount=discount, tempering=False)
        cloud, _ = pf.run(model, pf.init(model), inputs, readings)
        left[discount] = len(np.unique(cloud.particles[0])), np.sqrt(np.diag(cloud.cov) / np.diag(exact.cov))
    assert left[1.0][0] < 10
    assert left[0.95][0] == 500
    assert np.all(left[1.0][1] < 0.5)
    assert np.all(np.abs(left[0.95][1] - 1.0) < 0.25)


def test_the_kernel_keeps_mean_and_covariance():
    rng = np.random.default_rng(9)
    values = rng.standard_normal((3, 50_000)) * [[1.0], [10.0], [0.1]] + [[0.0], [5.0], [1.0]]
    values[2] += 0.05 * values[1]
    weights = rng.random(50_000)
    weights /= weights.sum()
    chosen = ancestors(weights, rng.random(50_000))
    new = liu_west(values, weights, chosen, rng.standard_normal((3, 50_000)), 0.7)
    cov = np.cov(values, aweights=weights)
    scale = np.sqrt(np.diag(cov))
    np.testing.assert_allclose((new.mean(axis=1) - values @ weights) / scale, 0.0, atol=1e-10)
    np.testing.assert_allclose(np.cov(new) / np.outer(scale, scale), cov / np.outer(scale, scale), atol=1e-10)


def test_a_bound_truncates_the_posterior():
    # The Kalman posterior cut off at zero is the exact one: a single coefficient, its likelihood centred below the
    # bound.
    a, t = symbols("a t")
    model = compose(
        Equations("bounded", (), (t,), (a,), (), ()), rate=10.0, values={},
        parameters=[Parameter("a", 1.0, 1.0, False)],
        sensors=(Reads("a", a, 1.0),),
    )  # fmt: skip
    readings = np.random.default_rng(10).standard_normal((100, 1)) - 0.1
    exact, _ = EKF.run(model, EKF.init(model), np.zeros((100, 1)), readings)
    mean, std = exact.mean[0], np.sqrt(exact.cov[0, 0])
    truncated = scipy.stats.truncnorm(-mean / std, np.inf, mean, std)
    pf = ParticleFilter(particles=20_000, bounds={"a": (0.0, np.inf)}, discount=0.99)
    assert pf.init(model).particles.min() >= 0.0
    cloud, _ = pf.run(model, pf.init(model), np.zeros((100, 1)), readings)
    assert cloud.particles.min() >= 0.0
    levels = [0.1, 0.5, 0.9]
    np.testing.assert_allclose(cloud.quantiles(levels)[:, 0], truncated.ppf(levels), atol=0.05 * std)


def test_both_modes_of_a_posterior_are_kept():
    # y = u cos α: the sign of α is invisible. The exact posterior by quadrature.
    alpha, u = symbols("alpha u")
    model = compose(
        Equations("tilted", (), (u,), (alpha,), (), ()), rate=10.0, values={},
        parameters=[Parameter("alpha", 0.05, 0.3, False)], sensors=(Reads("y", u * sp.cos(alpha), 0.2),),
    )  # fmt: skip
    rng = np.random.default_rng(11)
    inputs = 2.0 * rng.standard_normal((400, 1))
    readings = inputs * np.cos(0.35) + 0.2 * rng.standard_normal((400, 1))
    grid = np.linspace(-1.5, 1.5, 30_001)
    log_density = -0.5 * ((grid - 0.05) / 0.3) ** 2
    log_density -= 0.5 * np.sum((readings - inputs * np.cos(grid)) ** 2, axis=0) / 0.04
    density = np.exp(log_density - log_density.max())
    density /= scipy.integrate.trapezoid(density, grid)
    pf = ParticleFilter(particles=5000, discount=0.9995, seed=1)
    cloud, _ = pf.run(model, pf.init(model), inputs, readings)
    above = float(cloud.weights[cloud.particles[0] > 0.0].sum())
    assert above == pytest.approx(scipy.integrate.trapezoid(density[grid > 0], grid[grid > 0]), abs=0.1)
    size = scipy.integrate.trapezoid(density * np.abs(grid), grid)
    assert float(np.abs(cloud.particles[0]) @ cloud.weights) == pytest.approx(size, abs=0.006)
    believed, _ = EKF.run(model, EKF.init(model), inputs, readings)
    assert np.sqrt(believed.cov[0, 0]) < 0.3 * np.sqrt(cloud.cov[0, 0])  # certain, and of one of two


# sensors with heavy tails


def test_student_sensors_weigh_as_scipys_density_says():
    model = regression()
    inputs, readings = straight(model, 1)
    pf = ParticleFilter(particles=400, freedom={"line": 3.0}, threshold=0.0)
    start = pf.init(model)
    cloud, info = pf.run(model, start, inputs, readings)
    a, b = start.particles
    expected = scipy.stats.t.logpdf(readings[0, 0] - a - b * inputs[0, 0], 3.0, scale=0.3)
    expected += scipy.stats.norm.logpdf(readings[0, 1] - a * inputs[0, 0], scale=0.3)
    np.testing.assert_allclose(np.log(cloud.weights), scipy.special.log_softmax(expected), rtol=1e-10, atol=1e-10)
    assert info.log_likelihood[0] == pytest.approx(scipy.special.logsumexp(expected) - np.log(400), rel=1e-10)
    scatter = np.array([scipy.stats.t.var(3.0, scale=0.3), scipy.stats.norm.var(scale=0.3)])
    scatter += np.var([a + b * inputs[0, 0], a * inputs[0, 0]], axis=1)
    np.testing.assert_allclose(info.innovation_std[0], np.sqrt(scatter), rtol=1e-10)


def test_outliers_carry_a_gaussian_filter_away_and_not_one_with_student_sensors():
    model = regression(noise=0.1)
    inputs, readings = straight(model, 200)
    readings[100:110] += 20.0
    believed, _ = EKF.run(model, EKF.init(model), inputs, readings)
    pf = ParticleFilter(particles=2000, freedom=3.0)
    cloud, _ = pf.run(model, pf.init(model), inputs, readings)
    truth = [0.5, 2.0]
    assert np.abs((believed.mean - truth) / np.sqrt(np.diag(believed.cov))).max() > 10.0
    assert np.abs((cloud.mean - truth) / np.sqrt(np.diag(cloud.cov))).max() < 3.0


# particles on the parameters, a Kalman filter on the rest


def split(truth: float = 300.0) -> tuple[SplitModel, np.ndarray, np.ndarray]:
    """The chain with one unknown spring, linear given it, and a record of it."""
    values = CHAIN_VALUES | {"k_2": truth}
    rng = np.random.default_rng(16)
    sensors, cov = chain_sensors(bias=0.3), 0.01 * np.eye(6)
    joint = chain_with(loads=LOADS, parameters=[Parameter("k_2", 330.0, 0.2)], sensors=sensors, cov=cov)
    given = chain_with(loads=LOADS, sensors=sensors, cov=cov)
    loads = draw_loads(LOADS, given.compiled.loads, 400, 50.0, rng)
    p = np.array([values[name] for name in given.compiled.parameters])
    clean = integrate(given.compiled, p, loads, rate=50.0, start=np.zeros(6), substeps=4).readings
    readings = clean + np.sqrt(given.blocks.noise) * rng.standard_normal(clean.shape)
    readings[rng.random(readings.shape) < 0.05] = np.nan
    return SplitModel(joint, given), np.zeros((400, 3)), readings


def exact_posterior(model: SplitModel, inputs: np.ndarray, readings: np.ndarray) -> tuple[float, float, float]:
    """Mean and standard deviation of θ, and the log-likelihood: Kalman filters on a grid."""
    (prior,) = model.joint.parameters
    grid = np.linspace(-0.5, 0.3, 401)
    log_density = np.empty(401)
    at = model.given.compiled.parameters.index("k_2")
    for i, theta in enumerate(grid):
        p = model.given.blocks.p.copy()
        p[at] = prior.physical(theta)
        here = replace(model.given, blocks=model.given.blocks._replace(p=p))
        log_density[i] = EKF.run(here, EKF.init(here), inputs, readings)[1].log_likelihood.sum()
    log_density += scipy.stats.norm.logpdf(grid, 0.0, prior.spread)
    density = np.exp(log_density - log_density.max())
    evidence = scipy.integrate.trapezoid(density, grid)
    mean = scipy.integrate.trapezoid(density * grid, grid) / evidence
    variance = scipy.integrate.trapezoid(density * (grid - mean) ** 2, grid) / evidence
    return float(mean), float(np.sqrt(variance)), float(np.log(evidence) + log_density.max())


def test_rao_blackwellised_is_the_exact_posterior_of_a_linear_model():
    model, inputs, readings = split()
    mean, std, evidence = exact_posterior(model, inputs, readings)
    rb = RaoBlackwellised(particles=512)
    belief, info = rb.run(model, rb.init(model), inputs, readings)
    assert belief.mean[-1] == pytest.approx(mean, abs=0.3 * std)
    assert np.sqrt(belief.cov[-1, -1]) == pytest.approx(std, rel=0.15)
    assert info.log_likelihood.sum() == pytest.approx(evidence, abs=1.0)
    assert info.mean[-1, 0] == pytest.approx(belief.mean[-1], rel=1e-9)
    assert info.std[-1, 0] ** 2 == pytest.approx(belief.cov[-1, -1], rel=1e-6)
    np.testing.assert_array_equal(np.isnan(info.whitened), np.isnan(readings))
    assert np.nanvar(info.whitened) == pytest.approx(1.0, abs=0.15)
    at_mean, _ = EKF.run(model.given, EKF.init(model.given), inputs, readings)
    state_std = np.sqrt(np.diag(belief.cov))[:6]
    assert np.all(np.abs(belief.mean[:6] - at_mean.mean[:6]) < 3.0 * state_std)


def test_rao_blackwellised_keeps_the_protocol():
    model, inputs, readings = split()
    inputs, readings = inputs[:60], readings[:60]
    rb = RaoBlackwellised(particles=20, threads=1)
    whole, info = rb.run(model, rb.init(model), inputs, readings)
    assert info.resamplings.sum() > 0
    belief, infos = rb.init(model), []
    for u, y in zip(inputs, readings, strict=True):
        updated, _ = rb.update(model, rb.predict(model, belief, u), y)
        belief, one = rb.step(model, belief, u, y)
        infos.append(one)
        for a, b in zip(
            (updated.theta, updated.log_weights, updated.mean),
            (belief.theta, belief.log_weights, belief.mean),
            strict=True,
        ):
            np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(belief.theta, whole.theta)
    np.testing.assert_array_equal(belief.log_weights, whole.log_weights)
    np.testing.assert_array_equal(belief.bank.mean, whole.bank.mean)
    np.testing.assert_array_equal(np.concatenate([one.effective for one in infos]), info.effective)
    threaded = replace(rb, threads=None)
    again, _ = threaded.run(model, threaded.init(model), inputs, readings)
    np.testing.assert_array_equal(again.theta, whole.theta)
    assert isinstance(again, Mixture)
    assert isinstance(info, MixtureInfo)


def test_two_models_that_are_not_one_are_refused():
    model, inputs, readings = split()
    rb = RaoBlackwellised(particles=8)
    with pytest.raises(ConfigurationError, match="expected a joint model and the same one without parameters"):
        rb.run(SplitModel(model.joint, model.joint), rb.init(model), inputs, readings)


# resampling and random numbers


@pytest.mark.parametrize("scheme", SCHEMES)
def test_resampling_is_unbiased_and_ordered(scheme: Resampling):
    rng = np.random.default_rng(12)
    weights = rng.random(40) ** 4
    weights /= weights.sum()
    counts = np.zeros(40)
    for _ in range(4000):
        chosen = ancestors(weights, rng.random(40), scheme)
        assert np.all(np.diff(chosen) >= 0)
        counts += np.bincount(chosen, minlength=40)
    np.testing.assert_allclose(counts / 4000, 40 * weights, atol=4.0 * np.sqrt(40 * weights.max() / 4000))


def test_systematic_and_residual_descendants_are_within_one_of_what_is_due():
    rng = np.random.default_rng(13)
    for _ in range(50):
        weights = rng.random(30) ** 3
        weights /= weights.sum()
        due = 30 * weights
        counts = np.bincount(ancestors(weights, rng.random(30), "systematic"), minlength=30)
        assert np.all((counts >= np.floor(due - 1e-9)) & (counts <= np.ceil(due + 1e-9)))
        counts = np.bincount(ancestors(weights, rng.random(30), "residual"), minlength=30)
        assert np.all(counts >= np.floor(due - 1e-9))


def test_stratified_points_are_the_definition():
    rng = np.random.default_rng(14)
    weights = rng.random(25)
    weights /= weights.sum()
    u = rng.random(25)
    expected = np.searchsorted(np.cumsum(weights), (np.arange(25) + u) / 25)
    np.testing.assert_array_equal(ancestors(weights, u, "stratified"), expected)


def test_philox_is_the_published_one():
    # Known answers of Random123 for philox4x32-10, counter and key zero, and all ones.
    words, zero, ones = numba.njit(lambda *given: _words(*given)), np.uint64(0), np.uint64(0xFFFFFFFF)
    assert [f"{w:08x}" for w in words(*[zero] * 6)] == ["6627e8d5", "e169c58d", "bc57ac4c", "9b00dbd8"]
    assert [f"{w:08x}" for w in words(*[ones] * 6)] == ["408f276d", "41c83b0e", "a20bc7c6", "6d5451fd"]


def test_numbers_are_normal_and_uniform_and_differ_in_every_counter():
    z = normals(1, 5, Purpose.MOVE, 40, 5000)
    assert scipy.stats.kstest(z.ravel(), "norm").pvalue > 0.01
    assert np.abs(np.asarray(np.corrcoef(z))[np.triu_indices(40, 1)]).max() < 5.0 / np.sqrt(5000)
    u = uniforms(1, 5, Purpose.MOVE, 100_000)
    assert scipy.stats.kstest(u, "uniform").pvalue > 0.01
    assert u.min() >= 0.0
    assert u.max() < 1.0
    variants = itertools.product((1, 2**40), (5, 6), (Purpose.MOVE, Purpose.KERNEL), (0, 1))
    firsts = Counter(
        float(np.asarray(normals(seed, k, purpose, 1, 1, part))[0, 0]) for seed, k, purpose, part in variants
    )
    assert len(firsts) == 16


def test_weighted_quantiles_of_equal_weights_are_numpys():
    values = np.random.default_rng(15).standard_normal((2, 101))
    found = weighted_quantiles(values, np.full(101, 1.0 / 101), [0.1, 0.5, 0.9])
    np.testing.assert_allclose(found, np.quantile(values, [0.1, 0.5, 0.9], axis=1, method="inverted_cdf"))


def test_quantiles_come_out_along_the_way():
    model, pf = regression(), ParticleFilter(particles=400)
    inputs, readings = straight(model, 50)
    whole, info = pf.run(model, pf.init(model), inputs, readings)
    end, again, quantiles = pf.quantile_history(model, pf.init(model), inputs, readings, every=20)
    assert_same(end, whole)
    assert_same(again, info)
    assert quantiles.shape == (2, 3, 2)
    assert np.all(np.diff(quantiles, axis=1) > 0.0)
    assert np.all(np.abs(quantiles[:, 1] - info.mean[[19, 39]]) < 0.3 * info.std[[19, 39]])


# words


def test_degeneracy_is_said_in_words():
    model = regression(noise=0.05)
    inputs, readings = straight(model, 200)
    verdicts = {}
    cases: dict[str, dict[str, Any]] = {
        "healthy": {},
        "thin": {"tempering": False},
        "degenerate": {"tempering": False, "threshold": 0.0},
    }
    for name, options in cases.items():
        pf = ParticleFilter(particles=100, **options)
        verdicts[name] = degeneracy(pf.run(model, pf.init(model), inputs, readings)[1])
    for name, text in verdicts.items():
        assert text.startswith(name), text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"particles": 1}, "particles: expected 2 or more, got 1"),
        ({"resampling": "multinomial"}, "resampling: expected systematic, stratified, residual, got 'multinomial'"),
        ({"discount": 0.2}, "discount: expected more than 1/3 and at most 1, got 0.2"),
        ({"threshold": 2.0}, "threshold: expected a share"),
        ({"seed": -1}, "seed: expected 0"),
        ({"freedom": 0.0}, "degrees of freedom: expected positive numbers"),
        ({"bounds": {"a": (1.0, 0.0)}}, "bounds: expected each least < greatest"),
    ],
)
def test_options_out_of_range_are_named(options: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        ParticleFilter(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bounds": {"k": (0.0, 1.0)}}, "bounds: 'k' is not identified: expected some of a, b"),
        ({"freedom": {"x": 3.0}}, "degrees of freedom: no reading 'x': expected some of line, slope"),
    ],
)
def test_options_that_do_not_fit_the_model_are_named(options: dict[str, Any], message: str):
    model = regression()
    pf = ParticleFilter(**options)
    with pytest.raises(ConfigurationError, match=message):
        pf.run(model, ParticleFilter().init(model), np.zeros((1, 1)), np.zeros((1, 2)))


def test_a_gate_is_refused():
    model = chain_with(gate=3.0)
    pf = ParticleFilter(particles=10)
    with pytest.raises(ConfigurationError, match="gate: a particle filter has none"):
        pf.run(model, pf.init(model), np.zeros((1, 3)), np.zeros((1, 3)))
