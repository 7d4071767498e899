"""Merged shapes against exact ratios and weighted means."""

import numpy as np
import pytest

from windsysid.modal.shape_merging import Ratios, merge_shapes

TRUE = np.array([1.0, 0.6 + 0.1j, -0.3, 0.2 - 0.4j])


def ratios(places: list[int], std: float, values: np.ndarray = TRUE) -> Ratios:
    own = values[places]
    own = own / own[np.argmax(np.abs(own))]
    return Ratios(np.array(places, dtype=np.int64), own, std**2 * np.eye(2 * len(places)))


def test_exact_ratios_of_overlapping_setups_give_the_shape():
    merged = merge_shapes([ratios([0, 1], 0.01), ratios([1, 2, 3], 0.02)], 4)
    np.testing.assert_allclose(merged.shape, TRUE, atol=1e-9)
    assert merged.misfit == pytest.approx(0.0, abs=1e-12)
    assert merged.freedom == 0


def test_two_records_of_two_sensors_give_the_weighted_mean():
    one, other = 0.50 + 0.10j, 0.56 - 0.02j
    given = [ratios([0, 1], 0.01, np.array([1.0, one])), ratios([0, 1], 0.02, np.array([1.0, other]))]
    merged = merge_shapes(given, 2)
    weight = np.array([0.01, 0.02]) ** -2.0
    assert merged.shape[1] == pytest.approx(weight @ [one, other] / weight.sum(), rel=1e-5)
    assert merged.cov[1, 1] == pytest.approx(1.0 / weight.sum(), rel=1e-3)
    off = abs(one - other) ** 2 / (0.01**2 + 0.02**2)
    assert merged.misfit == pytest.approx(off, rel=1e-3)
    assert merged.freedom == 2
