"""The taper's window on a finer grid, and the spectra of a tower."""

import numpy as np
import pytest

from windsysid.spectral.rotor.model import GRID_FACTOR, finer_bins, taper_window
from windsysid.spectral.rotor.problem import Posed


def test_the_window_of_the_taper_adds_up_to_one_about_its_bin():
    bins = np.array([40, 41, 50])
    fine, weights = finer_bins(40, 50), taper_window(400, bins)
    assert weights.shape == (len(fine), 3)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    np.testing.assert_allclose(fine @ weights, bins)
    assert np.diff(fine) == pytest.approx(1.0 / GRID_FACTOR)


def test_a_likelihood_of_every_other_bin_counts_as_much_as_all(posed: Posed):
    model, at = posed.model, posed.start
    whole, half = (model.likelihood(at, every).information for every in (1, 2))
    np.testing.assert_allclose(np.diag(half), np.diag(whole), rtol=0.5)


def test_noise_and_loads_without_a_gap_are_as_alike_as_the_taper_makes_them(posed: Posed):
    model = posed.model
    S = model.spectrum(posed.start).spectrum
    assert model.likeness(S) >= model.overlap
    shared, count = model.shared_by_neighbours(S)
    assert count > 0
    assert shared < 0.5
