"""Spectra of a fit against averaged periodograms of a long simulated record, and of the formulations against each
other."""

import numpy as np
import pytest
from scipy.signal import welch

import windsysid as ws
from tests.identification.fits import identify_without_effects as identify
from windsysid._types import Array
from windsysid.identification.estimate.fitted.spectra import spectra_of_filter
from windsysid.results.estimate import FittedSpectrum
from windsysid.results.identification import Identification
from windsysid.turbine.turbine import Turbine

RATE, DURATION = 4.0, 600.0


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return ws.load_turbine("tower")


@pytest.fixture(scope="module")
def fits(tower: Turbine) -> dict[str, Identification]:
    record = ws.simulate(tower, duration=DURATION, rate=RATE, seed=1)
    return {kind: identify(record, tower, formulation=kind, loads="broadband") for kind in ("spectral", "joint")}


def at(spectrum: FittedSpectrum, frequency: Array) -> tuple[Array, Array]:
    """Logarithm of a spectrum and its standard deviation at frequencies."""
    return (
        np.interp(frequency, spectrum.frequency, np.log(spectrum.density)),
        np.interp(frequency, spectrum.frequency, spectrum.log_std),
    )


@pytest.mark.parametrize("formulation", ["spectral", "joint"])
@pytest.mark.slow
def test_the_spectrum_of_a_fit_is_that_of_a_long_record(
    tower: Turbine, fits: dict[str, Identification], formulation: str
):
    """Independently: Welch's method on 10 hours of a simulation, with which the fit of 10 minutes agrees within its
    interval, in the skirts of the modes where no line of the rotor is."""
    long = ws.simulate(tower, duration=36_000.0, rate=RATE, seed=9)
    for found in fits[formulation].spectra:
        frequency, density = welch(long[found.channel], RATE, nperseg=4096)
        inside = (frequency > 0.24) & (frequency < 0.45)
        level, std = at(found, frequency[inside])
        off = level - np.log(density[inside])
        assert np.abs(off).mean() < 0.3
        assert np.mean(np.square(off) / (np.square(std) + 2.0 * 4096 / (RATE * 36_000.0))) < 4.0


def test_both_formulations_agree_within_their_intervals(fits: dict[str, Identification]):
    frequency = np.linspace(0.25, 0.44, 100)
    for one, other in zip(fits["spectral"].spectra, fits["joint"].spectra, strict=True):
        assert one.channel == other.channel
        (a, s), (b, t) = at(one, frequency), at(other, frequency)
        assert np.mean(np.abs(a - b) < 2.0 * (s + t)) > 0.9
        assert one.measured is not None
        assert other.measured is None


def test_spectra_have_intervals_and_increasing_frequencies(fits: dict[str, Identification]):
    for found in (*fits["spectral"].spectra, *fits["joint"].spectra):
        assert (np.diff(found.frequency) > 0.0).all()
        assert (found.density > 0.0).all()
        assert np.isfinite(found.log_std).all()
        assert 0.02 < np.median(found.log_std) < 1.0


def test_the_spectrum_of_an_autoregression_has_its_closed_form(tower: Turbine):
    """H = (1 − a e^{−iω}) / σ whitens it; ∂ ln S / ∂ ln σ = 2."""
    a, sigma, rate, samples = 0.9, 0.3, 5.0, 4000
    frequency = np.arange(1, samples // 2) * rate / samples
    H = (1.0 - a * np.exp(-2j * np.pi * frequency / rate)) / sigma
    gradients = np.full((len(frequency), 1, 1, 1), -2.0 + 0j)  # ∂H/∂ln σ H⁻¹ + c.c.
    (found,) = spectra_of_filter(H[:, None, None], gradients, np.array([[0.01]]), frequency, (tower.sensors[0],))
    expected = 2.0 * sigma**2 / rate / np.abs(1.0 - a * np.exp(-2j * np.pi * found.frequency / rate)) ** 2
    assert found.density == pytest.approx(expected, rel=1e-9)
    assert found.log_std == pytest.approx(0.2, rel=1e-9)
    assert len(found.frequency) <= 800
