"""Weights of pairs, and the uncertainty of the modal assurance criterion against draws."""

import math

import numpy as np
import pytest

from windsysid.modal.matching.likelihood import (
    Assurance,
    ModelMode,
    assurance_interval,
    pair_weights,
    shape_assurance,
)
from windsysid.modal.shapes import assurance
from windsysid.spectral.oma.known_modes import KnownMode

MODEL = np.array([1.0, 0.7, 0.3, -0.4], dtype=complex)


def coverage(true: np.ndarray, std: np.ndarray, draws: int = 2000) -> float:
    """Share of noisy shapes whose interval has the true MAC."""
    random = np.random.default_rng(0)
    mac, inside = assurance(true, MODEL), 0
    for _ in range(draws):
        noise = std * (random.normal(size=len(true)) + 1j * random.normal(size=len(true)))
        low, high = assurance_interval(true + noise, std, MODEL)
        inside += low <= mac <= high
    return inside / draws


@pytest.mark.parametrize("noise", [0.01, pytest.param(0.05, marks=pytest.mark.slow)])
@pytest.mark.parametrize("off", [0.0, 0.2, 2.0, *(pytest.param(off, marks=pytest.mark.slow) for off in (0.03, 0.6))])
def test_intervals_of_the_mac_have_the_true_value_as_often_as_they_say(off: float, noise: float):
    """From equal shapes to a MAC of 0.2, for noise that differs between channels."""
    across = np.array([0.4, 1.0j, -0.3, 0.8])
    across = across - MODEL * (np.vdot(MODEL, across) / np.vdot(MODEL, MODEL))
    true = MODEL + off * across
    assert 0.92 <= coverage(true, noise * np.array([0.5, 1.0, 1.5, 1.0])) <= 1.0


def test_an_exact_shape_has_an_exact_mac():
    other = np.array([0.5, 1.0, 0.0, 0.2], dtype=complex)
    low, high = assurance_interval(other, np.zeros(4), MODEL)
    assert low == pytest.approx(assurance(other, MODEL))
    assert high == pytest.approx(low)


def measured(frequency: float = 1.0, damping: float = 0.01, **shape: complex) -> KnownMode:
    return KnownMode("m", math.log(frequency), 0.001, math.log(damping), 0.1, shape, True, dict.fromkeys(shape, 0.02))


def model(frequency: float = 1.0, damping: float = 0.01, **shape: complex) -> ModelMode:
    return ModelMode("k", frequency, 0.0, damping, 0.0, shape)


def weight(one: KnownMode, *others: ModelMode) -> np.ndarray:
    return pair_weights(one, others, [shape_assurance(one, other) for other in others])


def test_weights_fall_with_distance_and_reach_even_odds_at_eight_percent():
    near, edge, far = (weight(measured(f), model(damping=0.0))[0] for f in (1.0, 1.08, 1.25))
    assert near > 10.0 > edge > 0.5 > 0.05 > far


def test_shapes_tell_two_modes_of_one_frequency_apart():
    both = weight(measured(x=1.0, z=0.1), model(x=1.0, z=0.0), model(x=0.05, z=1.0))
    assert both[0] > 8.0 * both[1]


def test_an_uncertain_shape_says_less():
    sure, unsure = measured(x=1.0, z=0.1), measured(x=1.0, z=0.1)._replace(shape_std={"x": 0.4, "z": 0.4})
    modes = model(x=1.0, z=0.0), model(x=0.0, z=1.0)
    ratios = [float(w[0] / w[1]) for w in (weight(sure, *modes), weight(unsure, *modes))]
    assert ratios[0] > 2.0 * ratios[1] > 2.0


def test_damping_tells_a_damped_mode_from_a_lightly_damped_one():
    both = weight(measured(damping=0.005), model(damping=0.005), model(damping=0.2))
    assert both[0] > 10.0 * both[1]


def test_the_damping_of_a_model_without_damping_is_not_compared():
    undamped = [weight(measured(), model(damping=z))[0] for z in (0.0, 1e-14, -1e-14)]
    assert undamped == pytest.approx([undamped[0]] * 3)
    assert undamped[0] > 10.0


def test_one_common_channel_is_no_shape():
    assert shape_assurance(measured(x=1.0), model(x=1.0, z=2.0)) is None


@pytest.mark.parametrize("channels", [200, 1000])
def test_a_shape_of_many_channels_has_finite_weights(channels: int):
    macs = [Assurance(mac, mac, mac, channels, 0.0) for mac in (0.99, 0.1)]
    like, unlike = pair_weights(measured(), [model(), model()], macs)
    assert 0.0 <= unlike < 0.05 * like < math.inf
