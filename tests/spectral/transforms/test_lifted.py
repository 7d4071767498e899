"""Harmonics of a rotor and the lifted spectrum, against least squares and sinusoids."""

import numpy as np

from windsysid.spectral.transforms.dft import taper
from windsysid.spectral.transforms.lifted import count_harmonics, lift, without_rotor_harmonics

RATE, HZ = 20.0, 0.5
TIME = np.arange(1500) / RATE
AZIMUTH = 2.0 * np.pi * (HZ * TIME + 0.05 * np.sin(0.3 * TIME))


def test_rotor_harmonics_are_those_of_weighted_least_squares():
    readings, h = np.random.default_rng(4).normal(size=(1500, 2)), taper(1500)
    design = np.column_stack([np.ones(1500), *(f(k * AZIMUTH) for k in range(1, 5) for f in (np.cos, np.sin))])
    fitted = design @ np.linalg.lstsq(h[:, None] * design, h[:, None] * readings, rcond=None)[0]
    np.testing.assert_allclose(without_rotor_harmonics(readings, AZIMUTH, h, 4), readings - fitted, atol=1e-12)


def test_harmonics_are_fitted_up_to_the_nyquist_frequency_and_none_without_a_rotor():
    assert count_harmonics(0.0, RATE) == 0
    assert count_harmonics(HZ, RATE) == 16  # below 0.8 of half the rate
    assert count_harmonics(0.001, RATE) == 30


def test_blocks_average_their_frequencies_and_not_their_data():
    readings = np.random.default_rng(5).normal(size=(1500, 1))
    first, second = lift(readings, AZIMUTH, RATE, 1), lift(readings, 1.05 * AZIMUTH, RATE, 1)
    mean = second._replace(base=second.base).averaged(first._replace(base=second.base), 0.25)
    assert mean.rotor_hz == first.rotor_hz + 0.25 * (second.rotor_hz - first.rotor_hz)
    assert mean.data is second.data
    assert first.vectors.shape == (len(first.base), 3)
    np.testing.assert_allclose(first.energies, np.mean(np.abs(first.vectors) ** 2))
    assert first.independent.tolist() == [len(first.base)]


def test_harmonics_of_a_rotor_that_idles_are_not_removed():
    """They are closer together than a few bins, so that most of a vibration would go with them."""
    readings = np.random.default_rng(6).normal(size=(1500, 1))
    idling, parked = (lift(readings, turned * TIME, RATE, 0) for turned in (2.0 * np.pi * 0.1, 1e-9))
    np.testing.assert_allclose(idling.data, parked.data)
