"""Readings are outliers only while they are few: the share of a channel beyond which all are kept."""

import numpy as np
import pytest

from windsysid.identification.outliers import Outliers, find_spikes

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
