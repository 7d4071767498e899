"""A band of one mode: its spectrum, and random transforms that have it."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes, spectrum
from windsysid.spectral.transforms.dft import Band, plain_band


@pytest.fixture(scope="package")
def one_mode() -> Modes:
    """1 Hz, 1 % damped, in two channels, over white noise."""
    shape = np.array([[0.1], [0.05 + 0.01j]])
    rest = np.asarray(0.3 * np.eye(2), dtype=np.complex128)
    return Modes(np.array([1.0]), np.array([0.01]), shape, np.eye(1, dtype=complex), 0.0, rest, 0.0)


@pytest.fixture(scope="package")
def exact_band(one_mode: Modes) -> Band:
    """Data whose cross-spectra are the mode's exactly."""
    frequency = np.linspace(0.8, 1.2, 200)
    band = plain_band(frequency, np.full(200, 4.0), np.zeros((200, 2, 2), dtype=complex), 1.0)
    return band._replace(power=spectrum(one_mode, band))


@pytest.fixture(scope="package")
def transforms(one_mode: Modes) -> tuple[np.ndarray, np.ndarray]:
    """Bins of a record of 400 s at 10 Hz, and complex normal transforms (k, 2) of the mode's spectrum."""
    rng, bins = np.random.default_rng(5), np.arange(320, 480)
    band = plain_band(bins / 400.0, np.ones(160), np.zeros((160, 2, 2), dtype=complex), 1.0)
    white = (rng.normal(size=(160, 2, 1)) + 1j * rng.normal(size=(160, 2, 1))) / np.sqrt(2.0)
    return bins, (np.linalg.cholesky(spectrum(one_mode, band)) @ white)[:, :, 0]
