"""Loads of a band: sums of terms with amplitudes of their own."""

import numpy as np

from windsysid.spectral.rotor_bands.rotational_sampling import BandSource, HumpLoads, wind_of

TERMS = np.array([[1.0, 2.0, 3.0], [0.5, 0.5, 0.5]])


def test_the_spectrum_of_a_load_is_the_sum_of_its_terms():
    loads = HumpLoads([BandSource("x", "N/√Hz", np.ones(2, dtype=complex), TERMS, 3.0)])
    assert [s.name for s in loads.statistics] == ["load_density_x_1", "load_density_x_2"]
    values = {"load_density_x_1": 2.0, "load_density_x_2": 4.0}
    np.testing.assert_allclose(loads.spectra(values).own[:, 0], 4.0 * TERMS[0] + 16.0 * TERMS[1])


def test_turbulence_on_a_larger_rotor_decays_less_and_its_terms_fall_with_their_order():
    small, large = wind_of(1.0, 10.0, 0.2), wind_of(1.0, 20.0, 0.2)
    assert large.decay < small.decay
    at = small.table[len(small.table) // 2]
    assert at[0] > at[1] > at[3] > 0.0
