"""The compiled slopes of a band without modes, against the formulas on paper."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.kernel import whitened_slopes
from windsysid.spectral.modal_bands.start import without_modes
from windsysid.spectral.transforms.dft import Band


def test_the_cost_and_the_slopes_of_white_noise_are_the_textbooks(exact_band: Band):
    band, m = exact_band, 2
    none, empty = np.empty(0), np.empty((m, 0), dtype=complex)
    rest = np.linalg.cholesky(np.array([[2.0, 0.4], [0.4, 1.0]])).astype(complex)
    modes = without_modes(band)._replace(rest=rest, rest_slope=0.0)
    slopes, misfit = np.zeros((modes.size, len(band.counts), m * m)), np.empty((len(band.counts), m * m))
    middle = np.sqrt(band.frequency[0] * band.frequency[-1])
    cost = whitened_slopes()(
        band.power, band.counts, band.frequency, band.fine, band.first, band.window, none, none, empty,
        np.empty((0, 0), dtype=complex), rest, np.array([middle, 0.0, 0.0]), empty,
        np.empty((0, m, m), dtype=complex), np.empty(0, dtype=np.int64), slopes, misfit,
    )  # fmt: skip
    S = rest @ rest.conj().T
    ratio = np.einsum("kii->k", np.linalg.inv(S) @ band.power).real
    assert cost == pytest.approx(float(band.counts @ (np.log(np.linalg.det(S).real) + ratio)))
    flat = slopes.reshape(modes.size, -1)
    tilt = np.log(band.frequency / middle)
    assert flat[-1] @ flat[-1] == pytest.approx(m * float(band.counts @ tilt**2))  # tr of the square of ln(f/f_c) I
    assert flat[0] @ flat[0] == pytest.approx(float(band.counts.sum()))  # of the first diagonal element of X
    assert flat[-1] @ misfit.ravel() == pytest.approx(float(band.counts @ (tilt * (m - ratio))))
