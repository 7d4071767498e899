"""Readings that stand alone are left out, exactly these, and none where they are the rule."""

import numpy as np
import pytest

from windsysid._types import Array
from windsysid.identification.estimate.outlier import Outliers, find_spikes


def spiked(share: float, size: float = 40.0) -> tuple[Array, Array]:
    """Two channels of slow vibration (T, 2), and where the second has spikes."""
    rng = np.random.default_rng(5)
    readings = np.sin(0.3 * np.arange(3000))[:, None] + 0.1 * rng.standard_normal((3000, 2))
    at = 2 + 3 * rng.choice(990, round(3000 * share), replace=False)  # never two beside each other
    readings[at, 1] += size * rng.choice([-1.0, 1.0], len(at))
    return readings, np.sort(at)


@pytest.mark.parametrize("share", [0.001, 0.01, 0.045])
def test_spikes_are_found_to_the_reading_and_their_neighbours_are_kept(share: float):
    readings, at = spiked(share)
    (places,) = find_spikes([(readings, readings)]).places
    assert np.array_equal(places, 2 * at + 1)


def test_a_channel_of_which_a_tenth_are_spikes_has_none():
    readings, _ = spiked(0.1)
    assert not any(len(places) for places in find_spikes([(readings, readings)]).places)


def test_outliers_that_are_the_rule_are_kept():
    """What a model does not explain in a tenth of a channel is no outlier: the model is wrong."""
    few, many = (Outliers((np.arange(count) * 2,)) for count in (40, 120))
    power, read = np.array([500.0, 0.0]), np.array([1000, 1000])
    assert few.that_matter(power, read, 1000).same_as(few)
    assert many.that_matter(power, read, 1000).places == ()


SAMPLES = 2000


@pytest.mark.parametrize(("share", "left_out"), [(0.02, True), (0.04, True), (0.06, False), (0.09, False)])
def test_spikes_are_left_out_up_to_one_in_twenty(share, left_out):
    readings = np.random.default_rng(1).standard_normal((SAMPLES, 1))
    at = np.linspace(10, SAMPLES - 10, round(share * SAMPLES)).astype(int)
    readings[at] += 1000.0
    found = find_spikes([(readings, readings)]).places
    np.testing.assert_array_equal(found[0] if found else [], at if left_out else [])


@pytest.mark.parametrize(("share", "left_out"), [(0.04, True), (0.06, False)])
def test_readings_beyond_the_gate_are_left_out_up_to_one_in_twenty(share, left_out):
    count = round(share * SAMPLES)
    outliers = Outliers((np.arange(count),))
    kept = outliers.that_matter(np.array([1e6]), np.array([SAMPLES]), SAMPLES)
    assert kept.counts(1).tolist() == [count if left_out else 0]
