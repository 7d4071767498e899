"""Channels that are late by a constant: found by phases that grow with frequency, and put on time."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.oma.clock_lag import _Shapes, _tested_lags

from ..oscillators import modal_responses
from ..test_oma import record_of

RATE = 20.0
SHAPES = np.array([[0.33, -0.74, -0.59], [0.59, -0.33, 0.74], [0.74, 0.59, -0.33], [0.5, 0.2, 0.6]])


def floors(seed, lags, shapes=SHAPES, frequencies=(1.0, 2.8, 4.03), samples=12_000):
    """Displacements of four floors, each late by some samples."""
    rng = np.random.default_rng(seed)
    q, v = modal_responses(frequencies, [0.01] * len(frequencies), RATE, samples + 100, rng)
    size = q.std(axis=0)
    turned = v / (2.0 * np.pi * np.array(frequencies))  # a quarter of a period ahead
    y = (q / size) @ shapes.real.T - (turned / size) @ shapes.imag.T
    y += 0.02 * rng.normal(size=y.shape)
    return np.column_stack([y[50 - lag : 50 - lag + samples, i] for i, lag in enumerate(lags)])


@pytest.mark.parametrize(
    ("lags", "late"),
    [
        pytest.param((0, 0, 1, 0), {"floor_3": 1}, marks=pytest.mark.slow),
        pytest.param((0, -1, 0, 0), {"floor_2": -1}, marks=pytest.mark.slow),
        ((2, 0, 0, -1), {"floor_1": 2, "floor_4": -1}),
    ],
)
def test_a_late_channel_is_put_on_time_and_its_lag_is_told(lags, late):
    found = ws.oma(record_of(floors(1, lags), RATE))
    assert found.trusted, found.reasons
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [1.0, 2.8, 4.0]
    assert max(mode.complexity for mode in found.modes) < 1e-3
    notes = [note for note in found.notes if "its phases grow with frequency over" in note]
    assert {note.split("_displacement was")[0] for note in notes} == set(late)
    for note in notes:
        words = note.split()
        seconds = float(words[2]) * {"late": 1.0, "early": -1.0}[words[4]]
        assert seconds == pytest.approx(late[words[0].removesuffix("_displacement")] / RATE, abs=0.003)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_healthy_channels_are_left_alone(seed):
    complex_shapes = SHAPES * np.exp(1j * np.random.default_rng(seed).normal(0.0, 0.15, SHAPES.shape))
    for shapes in (SHAPES, complex_shapes):
        found = ws.oma(record_of(floors(10 + seed, (0, 0, 0, 0), shapes), RATE))
        assert found.notes == ()
        assert found.trusted, found.reasons


def drawn(rng, channels, modes, complexity, std, lags):
    """Shapes as they would be identified: random, with phases of their own, lags in periods of the highest mode, and
    errors."""
    f = np.sort(np.exp(rng.uniform(0.0, np.log(8.0), modes)))
    f[-1] = max(f[-1], 1.6 * f[0])
    shape = rng.normal(size=(channels, modes)) * np.exp(1j * rng.normal(0.0, complexity, (channels, modes)))
    shape /= np.abs(shape).max(axis=0)
    shape = shape * np.exp(-2j * np.pi * f / f[-1] * np.asarray(lags)[:, None])
    shape += std * (rng.normal(size=shape.shape) + 1j * rng.normal(size=shape.shape))
    return _Shapes(f, shape / np.hypot(std, 0.03 * np.abs(shape)))


@pytest.mark.parametrize(
    "complexity", [0.0, 0.2, *(pytest.param(size, marks=pytest.mark.slow) for size in (0.05, 0.4))]
)
def test_no_lag_is_found_in_shapes_that_are_real_or_complex(complexity):
    rng = np.random.default_rng(3)
    sizes = [(2, 2), (2, 4), (3, 3), (6, 2), (6, 4)]
    found = [_tested_lags(drawn(rng, n, r, complexity, 0.01, np.zeros(n))) for n, r in sizes for _ in range(20)]
    assert sum(map(bool, found)) == 0


def test_a_lag_of_more_than_half_a_period_is_not_put_right_as_another():
    rng = np.random.default_rng(4)
    for _ in range(30):
        lag = rng.uniform(0.6, 1.6)
        for found in _tested_lags(drawn(rng, 4, 4, 0.01, 0.01, [0.0, 0.0, 0.0, lag])):
            assert found.others


def test_of_two_modes_only_an_ambiguous_lag_is_told_and_the_record_is_doubted():
    found = ws.oma(record_of(floors(6, (0, 0, 2, 0), SHAPES[:, :2], (1.0, 2.0)), RATE))
    assert not found.trusted
    assert any("fit equally well" in doubt for doubt in found.doubts)


@pytest.mark.slow
def test_a_velocity_among_displacements_is_no_lag():
    y = floors(5, (0, 0, 0, 0))
    y[:, 2] = 0.05 * np.gradient(y[:, 2]) * RATE
    found = ws.oma(record_of(y, RATE))
    assert not any("its phases grow" in note for note in found.notes)


@pytest.mark.slow
def test_a_channel_that_is_late_in_one_of_two_records_is_put_on_time_before_they_are_joined():
    found = ws.oma([record_of(floors(seed, lags), RATE) for seed, lags in ((7, (0, 0, 1, 0)), (8, (0, 0, 0, 0)))])
    assert found.trusted, found.reasons
    assert max(mode.complexity for mode in found.modes) < 1e-3
    assert sum("its phases grow with frequency" in note for note in found.notes) == 1
