"""Outliers are left out and reported: a gated reading is a missing one, and says so."""

from dataclasses import replace

import numpy as np
import pytest

from tests.filters.test_protocol import LOADS, assert_same, chain_with, every_filter, record, rotor_with_everything
from tests.filters.textbook import composed, simulated
from windsysid.errors import ConfigurationError
from windsysid.filters import Filter
from windsysid.statespace.compose import StateSpace


def gated(model: StateSpace, gate: float) -> StateSpace:
    return replace(model, blocks=model.blocks._replace(gate=np.array([gate])))


@every_filter
@pytest.mark.parametrize("model", [chain_with(loads=LOADS), rotor_with_everything()], ids=["chain", "rotor"])
def test_an_outlier_is_left_out_as_if_it_were_missing_and_reported(filter_: Filter, model: StateSpace):
    inputs, readings = record(model)
    _, info = filter_.run(model, filter_.init(model), inputs, readings)
    k = int(np.flatnonzero(~np.isnan(readings[20:]).any(axis=1))[0]) + 20
    wild, missing = readings.copy(), readings.copy()
    wild[k, 1] += 100.0 * info.innovation_std[k, 1]
    missing[k, 1] = np.nan
    watchful = gated(model, 50.0)
    belief, found = filter_.run(watchful, filter_.init(watchful), inputs, wild)
    other, expected = filter_.run(model, filter_.init(model), inputs, missing)
    assert np.argwhere(found.gated).tolist() == [[k, 1]]
    assert_same(belief, other)
    for name in ("mean", "std", "whitened", "whitening_std", "log_likelihood"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    # what it was is still told, against what was expected before anything of the sample was taken in
    assert found.innovation_std[k, 1] == info.innovation_std[k, 1]
    assert found.innovation[k, 1] == pytest.approx(info.innovation[k, 1] + 100.0 * info.innovation_std[k, 1])
    assert not np.isnan(found.whitened[k, 2])  # the other readings of that sample count


@every_filter
def test_the_gate_is_as_wide_as_it_says(filter_: Filter):
    # One reading a hair inside the gate and a hair outside.
    model = gated(chain_with(loads=LOADS), 3.0)
    inputs, readings = record(model)
    belief, _ = filter_.run(model, filter_.init(model), inputs[:10], readings[:10])
    predicted = filter_.predict(model, belief, inputs[10])
    _, info = filter_.update(model, predicted, np.zeros(3))
    for side in (-1.0, 1.0):
        for width, out in ((2.999, False), (3.001, True)):
            reading = -info.innovation[0] + side * width * info.innovation_std[0]
            _, found = filter_.update(model, predicted, reading)
            np.testing.assert_array_equal(found.gated, np.full((1, 3), out))


@every_filter
def test_the_order_of_the_readings_does_not_decide_who_is_gated(filter_: Filter):
    # Three readings of one sample, the first an outlier: the other two are judged before it is looked at.
    model = chain_with(loads=LOADS, gate=4.0)
    inputs, readings = record(model)
    belief, _ = filter_.run(model, filter_.init(model), inputs[:10], np.nan_to_num(readings[:10]))
    _, clean = filter_.update(model, belief, np.zeros(3))
    for c in range(3):
        wild = -clean.innovation[0].copy()
        wild[c] += 1000.0 * clean.innovation_std[0, c]
        _, found = filter_.update(model, belief, wild)
        assert np.flatnonzero(found.gated).tolist() == [c]


@every_filter
def test_without_a_gate_nothing_is_left_out(filter_: Filter):
    model = chain_with(loads=LOADS)
    inputs, readings = record(model)
    readings[5] = 1e6
    _, info = filter_.run(model, filter_.init(model), inputs, readings)
    assert not info.gated.any()
    assert not np.isnan(info.whitened[5]).any()


@every_filter
def test_gating_rescues_a_record_with_outliers(filter_: Filter):
    # 2 % of the readings thrown 50 standard deviations off: with a gate of five, most of the damage is undone.
    model = composed()
    inputs, readings = simulated(model, 400, seed=41)
    rng = np.random.default_rng(42)
    hit = (rng.random(readings.shape) < 0.02) & ~np.isnan(readings)
    hit[:20] = False
    thrown = readings + np.where(hit, 50.0 * np.sqrt(model.blocks.noise), 0.0)
    watchful = gated(model, 5.0)
    truth = filter_.run(model, filter_.init(model), inputs, readings)[1]
    blind = filter_.run(model, filter_.init(model), inputs, thrown)[1]
    careful = filter_.run(watchful, filter_.init(watchful), inputs, thrown)[1]
    harm, left = (np.sqrt(np.mean(((f.mean - truth.mean) / truth.std) ** 2)) for f in (blind, careful))
    assert left < 0.25 * harm
    assert np.mean(careful.gated[hit]) > 0.5
    assert np.mean(careful.gated[~hit]) < 0.01


@pytest.mark.parametrize("gate", [0.0, -3.0, float("nan")])
def test_a_gate_that_is_none_is_refused(gate: float):
    with pytest.raises(ConfigurationError, match="gate: expected a positive number of standard deviations, got"):
        chain_with(gate=gate)
