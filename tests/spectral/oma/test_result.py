"""What a mode under ambient loads says of its band and of its shape."""

import math
from dataclasses import replace

import numpy as np
import pytest

from windsysid._types import Complex
from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.oma.mode import Doubt, OperationalMode


def mode(shape: Complex, ln_damping_std: float = 0.2) -> OperationalMode:
    size = np.full(len(shape), 0.01)
    return OperationalMode(
        name="mode 1", frequency=IntervalEstimate.normal(1.5, 0.01, "Hz"),
        damping_ratio=IntervalEstimate.lognormal(0.02, ln_damping_std, "1"), shape=shape, shape_std=size, load=1.0,
        ln_load_std=0.1, band=(1.0, 2.0), grounds=(),
    )  # fmt: skip


def test_the_band_of_damping_is_one_of_its_logarithm():
    found = mode(np.array([1.0 + 0.0j]))
    f, z = found.frequency, found.damping_ratio
    assert (f.estimate, f.low, f.high, f.std) == pytest.approx((1.5, 1.48, 1.52, 0.01))
    assert (z.estimate, z.low, z.high) == pytest.approx((0.02, 0.02 * math.exp(-0.4), 0.02 * math.exp(0.4)))
    assert z.relative_std == pytest.approx(0.2)


def test_grades_follow_the_reasons_and_the_widening():
    found = mode(np.array([1.0 + 0.0j]))
    assert (found.frequency.grade, found.damping_ratio.grade) == ("A", "A")
    wider = replace(found, widening=(2.0, 1.0), grounds=(Doubt("scores", "", "damping ratio"),))
    assert (wider.frequency.grade, wider.damping_ratio.grade) == ("B", "C")
    assert not wider.trusted
    assert replace(wider, grounds=()).damping_ratio.grade == "A"


@pytest.mark.parametrize("turn", [0.0, 0.7, math.pi / 2])
def test_complexity_is_that_of_the_shape_and_not_of_its_phase(turn: float):
    whole = np.exp(1j * turn)
    assert mode(whole * np.array([1.0, -0.4, 0.2])).complexity == pytest.approx(0.0, abs=1e-12)
    assert mode(whole * np.array([1.0, 1.0j])).complexity == pytest.approx(0.5)


def test_measures_of_the_shape_are_in_the_summary():
    real = mode(np.exp(0.4j) * np.array([1.0, -0.4, 0.2]))
    shape = real.full_summary(("a", "b", "c"), ("m/s^2",) * 3)["shape"]
    assert (shape["mpc"], shape["mpd_rad"]) == pytest.approx((1.0, 0.0), abs=1e-7)
    assert math.isnan(mode(np.array([1.0, 1.0j])).mpc)
