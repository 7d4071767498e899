"""What a mode under ambient loads says of its band and of its shape."""

import math

import numpy as np
import pytest

from windsysid._types import Complex
from windsysid.spectral.oma.mode import OperationalMode


def mode(shape: Complex, ln_damping_std: float = 0.2) -> OperationalMode:
    size = np.full(len(shape), 0.01)
    return OperationalMode("mode 1", 1.5, 0.01, 0.02, ln_damping_std, shape, size, 1.0, 0.1, (1.0, 2.0), ())


def test_the_band_of_damping_is_one_of_its_logarithm():
    told = mode(np.array([1.0 + 0.0j])).mode
    assert told.frequency_hz == pytest.approx((1.5, 1.48, 1.52))
    assert told.damping_ratio == pytest.approx((0.02, 0.02 * math.exp(-0.4), 0.02 * math.exp(0.4)))


@pytest.mark.parametrize("turn", [0.0, 0.7, math.pi / 2])
def test_complexity_is_that_of_the_shape_and_not_of_its_phase(turn: float):
    whole = np.exp(1j * turn)
    assert mode(whole * np.array([1.0, -0.4, 0.2])).complexity == pytest.approx(0.0, abs=1e-12)
    assert mode(whole * np.array([1.0, 1.0j])).complexity == pytest.approx(0.5)


def test_measures_of_the_shape_are_in_the_summary():
    real = mode(np.exp(0.4j) * np.array([1.0, -0.4, 0.2]))
    shape = real.summary(("a", "b", "c"), ("m/s^2",) * 3)["shape"]
    assert (shape["mpc"], shape["mpd_rad"]) == pytest.approx((1.0, 0.0), abs=1e-7)
    assert math.isnan(mode(np.array([1.0, 1.0j])).mpc)
