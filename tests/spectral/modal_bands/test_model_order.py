"""How many modes a band has, and their shapes in all channels."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.model_order import fit_band, full_shapes, principal_directions
from windsysid.spectral.transforms.dft import transform

from .drawn import BINS, RATE, SAMPLES, vibration

Transforms = tuple[np.ndarray, np.ndarray]


def test_one_mode_is_found_with_its_shape(one_mode: Modes, transforms: Transforms):
    bins, values = transforms
    found = fit_band(values, bins, 4000, 10.0, 1, 2)
    assert len(found.fit.modes.frequency) == 1
    assert found.against_none > 100.0
    assert abs(np.log(found.fit.modes.frequency[0])) < 4.0 * found.fit.std(0)[0]
    shapes = full_shapes(found)
    assert shapes.shape[shapes.largest[0], 0] == pytest.approx(1.0)
    true = one_mode.shape[:, 0] / one_mode.shape[0, 0]
    assert np.all(np.abs(shapes.shape[:, 0] - true) < 5.0 * shapes.std[:, 0] + 1e-9)


def test_a_band_with_more_modes_than_allowed_is_crowded():
    """40 storeys had three modes as one of grade A, 4.5 σ off."""
    motions = [vibration(seed, f, 0.005)[:, 0] for seed, f in enumerate((0.97, 1.0, 1.03))]
    noise = 0.01 * np.random.default_rng(5).normal(size=(SAMPLES, 3))
    shapes = np.array([[1.0, 0.5, 0.2], [0.3, -1.0, 0.4], [-0.4, 0.1, 1.0]])
    values = transform(np.array(motions).T @ shapes + noise, RATE)[1][BINS]
    fits = [fit_band(values, BINS, SAMPLES, RATE, 1, most) for most in (2, 3, 4)]
    assert [len(fit.fit.modes.frequency) for fit in fits] == [2, 3, 3]
    assert [fit.crowded for fit in fits] == [True, False, False]


def test_white_noise_has_no_mode():
    rng = np.random.default_rng(2)
    values = rng.normal(size=(160, 2)) + 1j * rng.normal(size=(160, 2))
    assert not len(fit_band(values, np.arange(320, 480), 4000, 10.0, 0, 1).fit.modes.frequency)


def test_principal_directions_lead_there_and_back(transforms: Transforms):
    values = transforms[1]
    directions, back = principal_directions(values, 2)
    np.testing.assert_allclose(back @ directions, np.eye(2), atol=1e-10)
    power = np.mean(np.abs(values @ back.T) ** 2, axis=0)
    np.testing.assert_allclose(power, 1.0, rtol=1e-6)
