"""Bins of spectra in frames that turn."""

import numpy as np

from windsysid.spectral.rotor_bands.channels import LINE_BINS, bins_between
from windsysid.spectral.transforms.rotating_frame import turned_spectra


def test_bins_lie_between_the_limits_and_off_the_harmonics_of_the_rotor():
    psi = np.linspace(0.0, 160.0 * np.pi, 4000, endpoint=False)
    readings = np.random.default_rng(1).normal(size=(4000, 1))
    spectra = turned_spectra(readings, psi, 10.0, 0)
    bins = bins_between(spectra, 0.35, 0.45)
    f = bins / spectra.duration
    assert 0.34 < f[0] < f[-1] < 0.46
    assert np.all(np.abs(f - 0.4) * spectra.duration > LINE_BINS - 1e-6)
