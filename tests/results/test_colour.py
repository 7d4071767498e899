"""Innovations that are white have one level over frequency; those that a wrong load's spectrum leaves have not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.checks.colour import smooth_colour
from windsysid.checks.whiteness import examine

RATE, MODES = 50.0, (1.7, 1.8, 4.0)


def smooth(whitened: np.ndarray):
    found = examine(whitened, names=["a", "b", "c"], rate=RATE, frequencies=MODES).smooth
    assert found is not None
    return found


@pytest.mark.slow
def test_white_noise_is_as_coloured_as_chance_makes_it():
    rng = np.random.default_rng(71)
    found = [smooth(rng.standard_normal((5000, 3))) for _ in range(100)]
    # χ² with 7 degrees of freedom, give or take three standard deviations of the mean of 100, and up to a tenth less:
    # the freedom of a half-octave is counted low. One in 1000 is beyond its bound.
    mean, scatter = np.mean([one.statistic for one in found]), np.sqrt(14.0 / 100.0)
    assert 6.3 - 3.0 * scatter < mean < 7.0 + 3.0 * scatter
    assert sum(one.statistic > one.bound for one in found) <= 1


def test_a_level_that_goes_with_frequency_is_seen_where_it_is():
    rng = np.random.default_rng(72)
    for _ in range(5):
        white = rng.standard_normal((5000, 3))
        coloured = lfilter([1.0, -0.2], [1.0], white, axis=0)  # fewer low frequencies
        found = smooth(coloured)
        assert found.ratio > 1.0
        assert found.low_hz < found.high_hz


def test_one_level_all_over_is_no_colour():
    """It moves no coefficient: the statistic says that it is not 1, the slope that it is the same everywhere."""
    frequency, freedom = np.arange(1.0, 200.0), 4.0
    spectrum = 1.3 * np.random.default_rng(73).chisquare(freedom, (len(frequency), 2)) / freedom
    found = smooth_colour(frequency, spectrum, freedom, reach=(1.0, 199.0), chance=1e-3)
    assert found is not None
    assert found.statistic > found.bound
    assert found.ratio < 1.0


def test_a_departure_that_is_chance_has_no_size():
    rng, frequency, freedom = np.random.default_rng(74), np.arange(1.0, 200.0), 4.0
    found = []
    for _ in range(40):
        spectrum = rng.chisquare(freedom, (len(frequency), 2)) / freedom
        one = smooth_colour(frequency, spectrum, freedom, reach=(1.0, 199.0), chance=1e-3)
        assert one is not None
        found.append(one.size)
    assert np.median(found) < 0.03  # of all values together, chance alone would have 0.07
