"""Result of operational modal analysis from the modes of one record: units, spectra of the figures."""

from typing import NamedTuple

import numpy as np

from windsysid.modal.singular_values import singular_values
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.provenance import record_hash
from windsysid.spectral.modal_bands.model import spectrum
from windsysid.spectral.modal_bands.model_order import BandFit, poles_over_order
from windsysid.spectral.modal_bands.peak_bands import find_peaks
from windsysid.spectral.oma.condition import Readings
from windsysid.spectral.oma.limits import MAX_BAND_MODES, MIN_POWER_SHARE
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.result import BandSpectrum, OperationalModes
from windsysid.spectral.oma.search import SearchedBands, band_bins, is_rotational_peak, modes_inside

__all__ = ["RecordAnalysis", "acceleration_unit", "drawn", "result_of"]


class RecordAnalysis(NamedTuple):
    """Analysis of one record: the whole record, its readings, the result of the search, the modes without names."""

    record: Record
    readings: Readings
    found: SearchedBands
    modes: tuple[OperationalMode, ...]


def result_of(single: RecordAnalysis) -> OperationalModes:
    """Result of one record."""
    record, readings, found, modes = single
    frequency, values = singular_values(found.spectrum.frequency, found.spectrum.values)
    return OperationalModes(
        record=record.name,
        section=(float(readings.used.time[0]), float(readings.used.time[-1])),
        rate=readings.rate,
        samples=readings.samples,
        channels=readings.names,
        units=tuple(
            acceleration_unit(unit, order) for unit, order in zip(readings.units, readings.orders, strict=True)
        ),
        sensors=readings.sensors,
        modes=modes,
        lines=tuple((line.name, line.frequency) for line in readings.lines),
        empty=found.empty,
        frequency=frequency,
        singular_values=values,
        bands=tuple(drawn(one) for one in found.bands if modes_inside(one, readings.samples / readings.rate)),
        rotor_hz=readings.rotor_hz,
        doubts=readings.doubts,
        notes=readings.notes,
        elapsed=0.0,
        start=record.start,
        record_hash=record_hash(record),
        findings=tuple(_unlisted_vibration(single)),
    )


def _unlisted_vibration(single: RecordAnalysis) -> list[Finding]:
    """Find channels with most of their power in a spectral peak that the modes, at their loads, do not explain."""
    spectrum, found = single.found.spectrum, []
    readings, frequency = spectrum.readings, spectrum.frequency
    power, modal = np.abs(spectrum.values) ** 2, np.zeros(spectrum.values.shape)
    for mode in single.modes:
        ratio = (frequency / mode.frequency.estimate) ** 2
        response = ratio / np.abs(1.0 - ratio + 2j * mode.damping_ratio.estimate * np.sqrt(ratio))
        modal += mode.load * response[:, None] ** 2 * np.abs(mode.shape) ** 2
    searched = band_bins(spectrum, (readings.low, readings.high))
    for i, channel in enumerate(readings.names):
        peaks = find_peaks(frequency, spectrum.values[:, i : i + 1], readings.low, readings.high)
        near = [searched[np.abs(frequency[searched] - peak.frequency) <= peak.half_width] for peak in peaks]
        each = ((power[bins, i].sum(), modal[bins, i].sum(), k) for k, bins in enumerate(near))
        held, explained, k = max(each, default=(0.0, 0.0, 0))
        if 2.0 * held <= MIN_POWER_SHARE * power[searched, i].sum() or explained >= MIN_POWER_SHARE * held:
            continue
        if not is_rotational_peak(peaks[k]._replace(half_width=0.5 * peaks[k].half_width), readings):
            found.append(Finding("unlisted_vibration", "remark", {"channel": channel, "frequency": peaks[k].frequency}))
    return found


def drawn(found: BandFit) -> BandSpectrum:
    """Spectra of a band for the figure."""
    measured = np.einsum("kii->k", found.band.power).real
    fitted = np.einsum("kii->k", spectrum(found.fit.modes, found.band)).real
    poles = poles_over_order(found, min(len(found.fit.modes.frequency) + 1, MAX_BAND_MODES))
    return BandSpectrum(found.band.frequency, measured, fitted, poles)


def acceleration_unit(unit: str, order: int) -> str:
    """Unit of the acceleration of a channel that reads in a unit, with the order of its time derivative."""
    if order == 2:
        return unit
    known = {"m": "m/s^2", "rad": "rad/s^2", "m/s": "m/s^2", "rad/s": "rad/s^2"}
    return known.get(unit, f"{unit}/s{'^2' if order == 0 else ''}")
