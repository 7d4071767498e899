"""Result of operational modal analysis from the modes of one record: units, spectra of the figures."""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.records.record import Record
from windsysid.results.provenance import record_hash
from windsysid.spectral.modal_bands.model import spectrum
from windsysid.spectral.modal_bands.model_order import BandFit
from windsysid.spectral.oma.condition import Readings
from windsysid.spectral.oma.result import BandSpectrum, OperationalMode, OperationalModes
from windsysid.spectral.oma.search import SearchedBands, modes_inside

__all__ = ["RecordAnalysis", "drawn", "result_of"]


class RecordAnalysis(NamedTuple):
    """Analysis of one record: the whole record, its readings, the result of the search, the modes without names."""

    record: Record
    readings: Readings
    found: SearchedBands
    modes: tuple[OperationalMode, ...]


def result_of(single: RecordAnalysis) -> OperationalModes:
    """Result of one record."""
    record, readings, found, modes = single
    return OperationalModes(
        record=record.name,
        section=(float(readings.used.time[0]), float(readings.used.time[-1])),
        rate=readings.rate,
        samples=readings.samples,
        channels=readings.names,
        units=tuple(
            _acceleration_unit(unit, order) for unit, order in zip(readings.units, readings.orders, strict=True)
        ),
        sensors=readings.sensors,
        modes=modes,
        lines=tuple((line.name, line.frequency) for line in readings.lines),
        empty=found.empty,
        frequency=found.spectrum.frequency,
        level=_level(found.spectrum.values),
        bands=tuple(drawn(one) for one in found.bands if modes_inside(one, readings.samples / readings.rate)),
        rotor_hz=readings.rotor_hz,
        doubts=readings.doubts,
        notes=readings.notes,
        elapsed=0.0,
        start=record.start,
        record_hash=record_hash(record),
    )


def drawn(found: BandFit) -> BandSpectrum:
    """Spectra of a band for the figure."""
    measured = np.einsum("kii->k", found.band.power).real
    fitted = np.einsum("kii->k", spectrum(found.fit.modes, found.band)).real
    return BandSpectrum(found.band.frequency, measured, fitted)


def _level(values: Complex) -> Array:
    """Mean (F,) of the spectra of the channels, scaled to the same median."""
    power = np.abs(values) ** 2
    return np.asarray((power / np.maximum(np.median(power, axis=0), 1e-300)).mean(axis=1))


def _acceleration_unit(unit: str, order: int) -> str:
    if order == 2:
        return unit
    known = {"m": "m/s^2", "rad": "rad/s^2", "m/s": "m/s^2", "rad/s": "rad/s^2"}
    return known.get(unit, f"{unit}/s{'^2' if order == 0 else ''}")
