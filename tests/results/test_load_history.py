"""Loads as a filter knew them, and as a file holds them."""

import numpy as np

from windsysid.results.estimate import Loads
from windsysid.results.serialization import as_plain, from_plain


def test_loads_come_back_from_plain_values_bit_by_bit():
    mean, std = np.random.default_rng(1).standard_normal((2, 5, 2))
    mean[2, 1] = np.nan
    found = from_plain(Loads, as_plain(Loads(("load_x", "load_y"), mean, np.abs(std))))
    assert isinstance(found, Loads)
    assert found.names == ("load_x", "load_y")
    np.testing.assert_array_equal(found.mean, mean)
    np.testing.assert_array_equal(found.std, np.abs(std))
