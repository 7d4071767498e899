"""How many modes a band has, and their shapes in all channels."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.model_order import fit_band, full_shapes, principal_directions

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
