"""Units and spectra of the result."""

import numpy as np
import pytest

from windsysid.spectral.oma.assemble import _acceleration_unit, _level


@pytest.mark.parametrize(
    ("unit", "order", "expected"),
    [("m/s^2", 2, "m/s^2"), ("m/s", 1, "m/s^2"), ("m", 0, "m/s^2"), ("N m", 0, "N m/s^2"), ("1", 0, "1/s^2")],
)
def test_shapes_have_the_units_of_accelerations(unit: str, order: int, expected: str):
    assert _acceleration_unit(unit, order) == expected


def test_the_level_of_white_noise_is_flat_whatever_the_units():
    rng = np.random.default_rng(1)
    values = (rng.normal(size=(4000, 2)) + 1j * rng.normal(size=(4000, 2))) * [1.0, 1e6]
    expected = 1.0 / np.log(2.0)  # mean over median of an exponential distribution
    assert np.mean(_level(values)) == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(_level(values), _level(values * [1e3, 1.0]))
