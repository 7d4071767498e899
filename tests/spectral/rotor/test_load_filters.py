"""The spectrum of a load model that is a filter of white noise."""

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.spectral.rotor.load_filters import load_shapes
from windsysid.statespace.gauss_markov import GaussMarkov


def test_a_first_order_load_has_a_lorentzian():
    (shape,) = load_shapes([GaussMarkov("force", 3.0, 0.5)], ("other", "force"))
    w = 2.0 * np.pi * np.array([0.1, 1.0])
    found = shape(np.asarray(1j * w, dtype=np.complex128))
    np.testing.assert_allclose(np.abs(found[:, 1, 0]) ** 2, 2.0 * 9.0 * 0.5 / (1.0 + (0.5 * w) ** 2), rtol=1e-6)
    np.testing.assert_array_equal(found[:, 0], 0.0)
    assert shape.rank == 1
    assert shape.poles == pytest.approx([-2.0])


def test_a_load_that_the_model_has_not_is_refused():
    with pytest.raises(ConfigurationError, match="expected a load of this model"):
        load_shapes([GaussMarkov("force", 3.0, 0.5)], ("torque",))
