"""Harmonics of the rotor are removed up to the order that the samples of the azimuth can follow."""

import numpy as np
import pytest

from windsysid.spectral.transforms.harmonics import without_harmonics


@pytest.mark.parametrize(("step", "removed", "left"), [(0.1, (1, 3, 20), (28,)), (1.0, (1, 2), (3,))])
def test_harmonics_are_removed_up_to_four_fifths_of_half_a_turn_in_a_step(step, removed, left):
    """Beyond, the samples of a harmonic are also those of a lower frequency."""
    azimuth = step * np.arange(4000)
    vibration = np.random.default_rng(3).standard_normal(4000)
    rest = sum(np.cos(order * azimuth + 0.4) for order in left)
    readings = 7.0 + rest + vibration + sum(50.0 * np.sin(order * azimuth + order) for order in removed)
    found = without_harmonics(readings[:, None], np.mod(azimuth, 2.0 * np.pi))[:, 0]
    assert abs(found.mean()) < 0.1
    # a cosine and a sine of each of at most 25 harmonics and the mean take 1.3 % of the vibration along
    assert np.mean((found - rest - vibration) ** 2) < 0.03
