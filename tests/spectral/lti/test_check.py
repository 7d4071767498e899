"""Ranges of frequencies and their energies."""

from itertools import pairwise

import numpy as np

from windsysid.spectral.lti.check import RANGES, doubts_of, frequency_ranges, range_energies
from windsysid.spectral.lti.fit import fit_linear
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.transforms.cross_spectra import CrossSpectra


def test_ranges_cover_all_frequencies_without_a_gap():
    ranges = frequency_ranges((0.1, 4.0))
    assert len(ranges) == RANGES
    assert ranges[0][0] == 0.1
    assert ranges[-1][1] > 4.0
    assert all(a[1] == b[0] for a, b in pairwise(ranges))


def test_energies_are_means_per_bin_and_block():
    power = np.array([np.diag([1.0, 2.0]), np.diag([3.0, 4.0])], dtype=complex)
    spectra = CrossSpectra(np.asarray(4.0 * power, dtype=np.complex128), 1, 4.0, 10, 10.0)  # at 1 and 2 Hz
    found = range_energies(spectra, [(0.5, 2.5), (3.0, 4.0)])
    np.testing.assert_allclose(found[0], [2.0, 3.0])
    assert np.isnan(found[1]).all()


def test_spectra_of_the_model_are_not_doubted_and_a_louder_half_is(model: LinearModel, exact: CrossSpectra):
    fit, ranges = fit_linear(model, exact), frequency_ranges((0.1, 3.0))
    energies = [range_energies(exact, ranges)] * 4
    assert doubts_of(model, exact, fit, ("a", "b"), energies, ranges) == []
    loud = [*energies[:2], *(10.0 * one for one in energies[2:])]
    assert any("in one half" in doubt for doubt in doubts_of(model, exact, fit, ("a", "b"), loud, ranges))
