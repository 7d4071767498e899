"""The bank computes what the extended Kalman filter computes, filter by filter."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.filters.test_protocol import LOADS, MODELS, chain_with, record
from tests.mechanics.models import CHAIN_VALUES, chain_sensors
from windsysid.filters import EKF
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.estimate.scoring import neighbours, score
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import LoadBlock

# A bank has no gate: whatever is gated is marked as missing before it runs.
STATE_ONLY = [name for name, build in MODELS.items() if not build().parameters and np.isinf(build().blocks.gate[0])]


def scaled(model: StateSpace, factor: float) -> StateSpace:
    """The same structure with other numbers everywhere: loads, noise, priors, mechanics."""
    blocks = model.blocks
    return replace(
        model,
        blocks=blocks._replace(
            p=blocks.p * factor, noise=blocks.noise * factor, load_noise=blocks.load_noise * factor,
            load_transition=blocks.load_transition * (2.0 - factor), load_output=blocks.load_output * factor,
        ),
        mean=model.mean + 0.01 * factor,
        cov=model.cov * factor,
    )  # fmt: skip


@pytest.mark.parametrize("name", STATE_ONLY)
@pytest.mark.parametrize("filters", [1, 9])
def test_every_lane_is_an_extended_kalman_filter(name: str, filters: int):
    models = [scaled(MODELS[name](), 1.0 + 0.01 * i) for i in range(filters)]
    inputs, readings = record(models[0])
    _, scores = run_bank(bank_of(models), inputs, readings)
    for lane, model in enumerate(models):
        _, info = EKF.run(model, EKF.init(model), inputs, readings)
        np.testing.assert_allclose(scores.whitened[..., lane], np.nan_to_num(info.whitened), rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(
            scores.log_std[..., lane], np.nan_to_num(np.log(info.whitening_std)), rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("name", STATE_ONLY)
def test_slopes_to_changes_of_the_readings_are_those_of_an_extended_kalman_filter(name: str):
    models = [scaled(MODELS[name](), 1.0 + 0.01 * i) for i in range(9)]
    inputs, readings = record(models[0])
    changes = 0.1 * np.random.default_rng(7).standard_normal((*readings.shape, 2))
    with ThreadPoolExecutor(2) as pool:
        bank, first = run_bank(bank_of(models, 2), inputs[:17], readings[:17], pool, changes[:17])
        bank, second = run_bank(bank, inputs[17:], readings[17:], pool, changes[17:])
    found = first.slopes + second.slopes
    close = 5e-3 if name == "loads_that_turn" else 1e-6  # a rotor's gains go a little with its motion
    assert found.shape == (2, 9)
    for lane in (0, 8):
        model, width = models[lane], 1e-4
        for t in range(2):
            above, below = (
                EKF.run(model, EKF.init(model), inputs, readings + sign * width * changes[..., t])[1].log_likelihood
                for sign in (1.0, -1.0)
            )
            slope = (above.sum() - below.sum()) / (2.0 * width)
            assert found[t, lane] == pytest.approx(slope, abs=close * abs(found).max())


def test_a_bank_can_stop_and_go_on_and_use_threads():
    models = [scaled(MODELS["loads_that_turn"](), 1.0 + 0.01 * i) for i in range(20)]
    inputs, readings = record(models[0])
    whole, scores = run_bank(bank_of(models), inputs, readings)
    with ThreadPoolExecutor(2) as pool:
        bank, first = run_bank(bank_of(models), inputs[:17], readings[:17], pool)
        bank, second = run_bank(bank, inputs[17:], readings[17:], pool)
    np.testing.assert_array_equal(bank.mean, whole.mean)
    np.testing.assert_array_equal(bank.cov, whole.cov)
    assert (bank.samples, bank.filters) == (40, 20)
    for one, other, all_ in zip(first, second, scores, strict=True):
        np.testing.assert_array_equal(np.concatenate([one, other]), all_)


@pytest.mark.parametrize(
    "other",
    [
        lambda: chain_with(sensors=chain_sensors()[:2]),
        lambda: chain_with(loads=LOADS),
        lambda: chain_with(parameters=[Parameter("k_2", 330.0, 0.2)]),
    ],
)
def test_a_bank_of_different_structures_is_refused(other: Any):
    with pytest.raises(ValueError, match="a bank holds models of the same states and readings"):
        bank_of([chain_with(), other()])


def test_the_score_is_the_slope_of_the_likelihood():
    def build(theta: np.ndarray) -> StateSpace:
        return chain_with(
            values=CHAIN_VALUES | {"k_1": 300.0 * np.exp(theta[0]), "c_1": CHAIN_VALUES["c_1"] + theta[1]}, loads=LOADS
        )

    inputs, readings = record(build(np.zeros(2)), 400)
    theta, widths = np.array([0.1, 0.2]), np.array([1e-5, 1e-5])

    def log_likelihood(at: np.ndarray) -> float:
        model = build(at)
        return float(EKF.run(model, EKF.init(model), inputs, readings)[1].log_likelihood.sum())

    bank = bank_of([build(at) for at in neighbours(theta, widths)])
    _, found = score(bank, inputs, readings, widths)
    assert found.log_likelihood == pytest.approx(log_likelihood(theta), rel=1e-12)
    for j, step in enumerate(np.diag(widths)):
        slope = (log_likelihood(theta + step) - log_likelihood(theta - step)) / (2.0 * widths[j])
        assert found.gradient[j] == pytest.approx(slope, rel=1e-4)


def test_models_that_differ_in_the_rank_of_their_noise_within_a_step_share_a_bank():
    # What a load adds within a step has as many columns as it has independent noises that are not negligible: that
    # goes with time constants and levels, so models of one structure differ in it.
    def build(columns: int) -> StateSpace:
        model = chain_with(loads=LOADS, continuous=True)
        return replace(
            model, blocks=model.blocks._replace(load_within=50.0 * model.blocks.load_within[..., :columns])
        )  # fmt: skip

    models = [build(columns) for columns in (1, 2, 0, 2, 1, 1, 0, 2, 1, 2)]
    inputs, readings = record(models[0])
    _, together = run_bank(bank_of(models), inputs, readings)
    for lane, model in enumerate(models):
        _, alone = run_bank(bank_of([model]), inputs, readings)
        np.testing.assert_array_equal(together.whitened[..., lane], alone.whitened[..., 0])
        np.testing.assert_array_equal(together.log_std[..., lane], alone.log_std[..., 0])
        _, info = EKF.run(model, EKF.init(model), inputs, readings)
        np.testing.assert_allclose(together.whitened[..., lane], np.nan_to_num(info.whitened), rtol=1e-7, atol=1e-7)
    assert np.abs(together.log_std[..., 0] - together.log_std[..., 1]).max() > 1e-3  # they are different models


def test_models_whose_loads_forget_at_rates_far_apart_share_a_bank():
    # Two states of one load, of which the slow one counts as resting from a factor of ten thousand on.
    def build(slow: float) -> StateSpace:
        drift, unit = np.diag([-2.0, -slow]), np.eye(2)
        load = LoadBlock(("fast", "slow"), drift, unit, {"load_1": 5.0 * unit[:1], "load_3": 2.0 * unit[1:]})
        return chain_with(loads=(load,), continuous=True)

    models = [build(slow) for slow in (1.0, 1e-5)]
    assert [model.blocks.load_within.shape[2] for model in models] == [2, 1]
    inputs, readings = record(models[0])
    _, together = run_bank(bank_of(models), inputs, readings)
    for lane, model in enumerate(models):
        _, alone = run_bank(bank_of([model]), inputs, readings)
        np.testing.assert_array_equal(together.whitened[..., lane], alone.whitened[..., 0])
