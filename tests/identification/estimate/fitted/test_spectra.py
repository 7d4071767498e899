"""Spectra of a fit against averaged periodograms of a long simulated record, and of the formulations against each
other."""

import numpy as np
import pytest
from scipy.signal import welch

import windsysid as ws
from windsysid._types import Array
from windsysid.results.fitted_spectrum import FittedSpectrum
from windsysid.results.identification import Identification
from windsysid.turbine.turbine import Turbine

RATE, DURATION = 4.0, 600.0


@pytest.fixture(scope="module")
def tower() -> Turbine:
    return ws.load_turbine("tower")


@pytest.fixture(scope="module")
def fits(tower: Turbine) -> dict[str, Identification]:
    record = ws.simulate(tower, duration=DURATION, rate=RATE, seed=1)
    return {kind: ws.identify(record, tower, formulation=kind) for kind in ("spectral", "joint")}


def at(spectrum: FittedSpectrum, frequency: Array) -> tuple[Array, Array]:
    """Logarithm of a spectrum and its standard deviation at frequencies."""
    return (
        np.interp(frequency, spectrum.frequency, np.log(spectrum.density)),
        np.interp(frequency, spectrum.frequency, spectrum.log_std),
    )


@pytest.mark.parametrize("formulation", ["spectral", "joint"])
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
