"""Release and first modes of free decays."""

import numpy as np
import pytest

from windsysid.modal.decays.likelihood import Decay, fit_decays
from windsysid.modal.decays.start import highest_peak, realized_modes, reduced, release, residual_modes


def swing(modes: tuple[tuple[float, float], ...], rate: float = 20.0, duration: float = 60.0) -> Decay:
    t = np.arange(0.0, duration, 1.0 / rate)
    waves = [np.exp(2.0 * np.pi * f * (-z + 1j * np.sqrt(1.0 - z**2)) * t) for f, z in modes]
    shapes = np.random.default_rng(0).normal(size=(len(modes), 3))
    return Decay(np.array(waves).real.T @ shapes, rate)


def test_the_realization_finds_the_modes_of_a_decay_without_noise():
    modes = ((0.8, 0.01), (0.83, 0.02), (2.4, 0.008))
    found = realized_modes(swing(modes), 3.0)
    for mode in modes:
        assert min(max(abs(f / mode[0] - 1.0), abs(z / mode[1] - 1.0)) for f, z in found) < 1e-3


def test_the_peak_of_the_residual_is_the_mode_that_is_missing():
    decay = swing(((0.8, 0.01), (2.4, 0.008)))
    fit = fit_decays(np.log([0.8, 0.01]), [decay])
    assert {round(f, 1) for f, _ in residual_modes(fit, [decay])} == {2.4}


@pytest.mark.parametrize("before", [0, 500, 2000])
def test_the_release_follows_what_was_there_before(before: int):
    rng = np.random.default_rng(0)
    free = swing(((0.8, 0.01), (2.4, 0.008))).values
    whole = np.vstack([np.tile(free[0], (before, 1)), free]) + 0.01 * rng.normal(size=(before + len(free), 3))
    assert 0 <= release(whole) - before < 60


def test_a_reduced_decay_has_the_modes_of_the_whole():
    decay = swing(((0.8, 0.01), (2.4, 0.008)), rate=100.0)
    noisy = decay._replace(values=decay.values + 0.01 * np.random.default_rng(0).normal(size=decay.values.shape))
    highest = highest_peak(noisy)
    assert 2.4 < highest < 6.0
    slower, later = reduced(noisy, highest)
    assert slower.rate < 50.0
    assert len(slower.values) / slower.rate + 2.0 * later == pytest.approx(60.0, abs=0.2)
    fit = fit_decays(np.log([0.8, 2.4, 0.01, 0.01]), [slower])
    assert fit.damping == pytest.approx([0.01, 0.008], rel=0.02)


def test_a_decay_is_not_reduced_where_its_rate_is_needed_or_nothing_stands_out():
    decay = swing(((0.8, 0.01), (9.0, 0.008)))
    assert reduced(decay, highest_peak(decay))[0] is decay
    noise = Decay(np.random.default_rng(0).normal(size=(2000, 2)), 20.0)
    assert highest_peak(noise) == 0.0
    assert reduced(noise, 0.0) == (noise, 0.0)
