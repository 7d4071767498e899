"""Readings as spectra need them: without gaps."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.identification.model.fit import known_inputs
from windsysid.inspection.limits import MAX_FAULT_SHARE
from windsysid.mechanics.sensors import Sensor
from windsysid.records.kept import kept_with_record
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.lifted import Lifted
from windsysid.turbine.turbine import Turbine

__all__ = ["SpectralSamples", "read_bridged"]


def read_bridged(record: Record, channels: Sequence[str], notes: list[Finding]) -> Array:
    """Values of channels (T, m), short gaps bridged and noted in `notes`.

    Raises
    ------
    RecordError
        If more than `MAX_FAULT_SHARE` of a channel is missing.
    """
    columns = []
    for name in channels:
        values = record[name]
        missing = ~np.isfinite(values)
        if missing.mean() > MAX_FAULT_SHARE:
            raise RecordError(
                f"channel '{name}': expected at most {100 * MAX_FAULT_SHARE:g} % missing or faulty samples for "
                f"spectra, got {100 * missing.mean():.3g} %: choose another section, or the joint formulation"
            )
        if missing.any():
            values = np.interp(record.time, record.time[~missing], values[~missing])
            data = {"channel": name, "count": missing.sum()}
            notes.append(Finding("missing_samples_bridged", "note", data))
        columns.append(values)
    return np.column_stack(columns)


class SpectralSamples(NamedTuple):
    """A record without gaps, as spectra need it.

    Attributes
    ----------
    record, sensors
        Where it comes from.
    inputs, readings
        The model's inputs (T, n_u), and what the sensors read (T, m).
    sums
        Sums over all blocks of a longer record, of which this is the last; None where this is all of it.
    lifts
        Lifted spectra of the readings by their number of harmonics, as far as they are known.
    """

    record: Record
    sensors: tuple[Sensor, ...]
    inputs: Array
    readings: Array
    sums: BlockSums[Any] | None = None
    lifts: dict[int, Lifted] | None = None

    @classmethod
    def of(
        cls, record: Record, turbine: Turbine, sensors: Sequence[Sensor], notes: list[Finding],
        sums: BlockSums[Any] | None = None,
    ) -> "SpectralSamples":  # fmt: skip
        """Read a record; gaps that were bridged are added to `notes`. RecordError as of `read_bridged`."""
        inputs = known_inputs(record, turbine, sensors)
        readings = read_bridged(record, [sensor.channel for sensor in sensors], notes)
        channels = tuple(sensor.channel for sensor in sensors)
        return cls(record, tuple(sensors), inputs, readings, sums, _lifts(record, channels, id(inputs)))


@kept_with_record
def _lifts(record: Record, channels: tuple[str, ...], inputs: int) -> dict[int, Lifted]:
    """Lifted spectra of channels of a record and inputs of this identity, none at first."""
    return {}
