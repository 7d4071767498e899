"""Where scoring starts, against formulas and the exact spectrum."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes, spectrum
from windsysid.spectral.modal_bands.start import add_mode, deviance, expect, modes_at, quiet_start, without_modes
from windsysid.spectral.transforms.dft import Band


def test_deviance_is_minus_two_log_likelihoods(one_mode: Modes, exact_band: Band):
    S = spectrum(one_mode, exact_band)
    expected = 2.0 * sum(
        n * (np.log(np.linalg.det(s).real) + np.trace(np.linalg.solve(s, P)).real)
        for n, s, P in zip(exact_band.counts, S, exact_band.power, strict=True)
    )
    assert deviance(one_mode, exact_band) == pytest.approx(expected)


def test_a_band_without_modes_is_its_mean_and_its_slope(exact_band: Band):
    f = exact_band.frequency
    level = np.array([[2.0, 0.5], [0.5, 1.0]])
    tilted = (f / np.sqrt(f[0] * f[-1])) ** 3.0
    found = without_modes(exact_band._replace(power=(tilted[:, None, None] * level).astype(complex)))
    assert found.rest_slope == pytest.approx(3.0, abs=0.05)
    np.testing.assert_allclose(found.rest @ found.rest.conj().T, level, rtol=1e-3)


def test_a_mode_is_added_where_the_data_exceed_the_fit(exact_band: Band):
    found = add_mode(without_modes(exact_band), exact_band)
    assert found.frequency[0] == pytest.approx(1.0, abs=0.02)
    assert deviance(found, exact_band) < deviance(without_modes(exact_band), exact_band)


def test_expectation_and_maximisation_raise_the_likelihood(exact_band: Band):
    once, later = (expect(modes_at([(1.0, 0.01)], exact_band), exact_band, passes) for passes in (1, 20))
    assert deviance(later, exact_band) <= deviance(once, exact_band)
    assert later.frequency == once.frequency


def test_a_quiet_start_is_the_floor_beside_the_mode(exact_band: Band):
    root = quiet_start(exact_band)
    np.testing.assert_allclose(np.diag(root @ root.conj().T).real, 0.09, rtol=1.0)
