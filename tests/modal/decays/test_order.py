"""Number of modes in free decays."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.modal.decays.test_start import swing
from windsysid.modal.decays.likelihood import Decay
from windsysid.modal.decays.order import search_decays


@pytest.mark.parametrize("modes", [((0.8, 0.01),), ((0.8, 0.01), (0.83, 0.02), (2.4, 0.008))])
def test_as_many_modes_are_found_as_there_are(modes: tuple[tuple[float, float], ...]):
    clean = swing(modes)
    noisy = Decay(clean.values + 0.02 * np.random.default_rng(3).normal(size=clean.values.shape), clean.rate)
    fit = search_decays([noisy])
    assert np.sort(fit.frequency) == pytest.approx([f for f, _ in modes], rel=3e-3)


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_noise_has_no_modes_whatever_its_spectrum(correlation: float):
    noise = lfilter([1.0], [1.0, -correlation], np.random.default_rng(4).normal(size=(3000, 2)), axis=0)
    assert len(search_decays([Decay(noise, 20.0)]).theta) == 0


def test_modes_outside_the_limits_are_not_sought():
    fit = search_decays([swing(((0.8, 0.01), (2.4, 0.008)))], (2.0, 3.0))
    assert fit.frequency == pytest.approx([2.4], rel=1e-2)
