"""Samples of the channels of a record, without gaps, spikes and copies."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.continuity import copies_among
from windsysid.inspection.limits import MAX_FAULT_SHARE, MAX_SHORT_GAP_SAMPLES, MIN_MODAL_SAMPLES
from windsysid.inspection.rotor import rotor_of
from windsysid.inspection.screening import doubted, noted, screen
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import RATE_DOUBT, STAMPS, Record
from windsysid.signals.band import bridged
from windsysid.signals.condition import resample
from windsysid.signals.short_gaps import fill_short_gaps
from windsysid.spectral.oma.limits import MAX_FILLED_SHARE
from windsysid.spectral.oma.sensors import ModalSensor, choose_sensors

__all__ = ["Samples", "choose_samples", "without_gaps"]

SPECTRAL_FAULTS = frozenset({"spikes", "clipping", "frozen", "gaps", "saturation"})
"""Faults that change a spectrum."""


class Samples(NamedTuple):
    """Samples of the channels of a record.

    The record is uniformly sampled, if too much is missing its longest segment without gaps; there is one sensor for
    each column of the values (T, n); notes name changes, doubts are reasons why the whole record is doubtful.
    """

    record: Record
    sensors: tuple[ModalSensor, ...]
    values: Array
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def choose_samples(record: Record, sensors: Sequence[Sensor | ModalSensor | str] | None) -> Samples:
    """Choose channels, check them, and bridge gaps and spikes.

    Raises
    ------
    ConfigurationError, RecordError
        If channels are missing, dead or copies of each other, or the record is too short.
    """
    chosen, left_out = choose_sensors(record, sensors)
    channels = [sensor.channel for sensor in chosen]
    rotor = rotor_of(record)
    turning = dict.fromkeys(("rotor_azimuth", "rotor_speed", "" if rotor is None else rotor.source))
    helpers = [name for name in turning if name in record and name not in channels]
    whole, gap_notes = without_gaps(record.select([*channels, *helpers]), channels)
    findings, spikes = _screened(whole, channels, helpers)
    values = np.column_stack([bridged(_without_spikes(whole, name, spikes), name) for name in channels])
    kept, copy_notes = _without_copies(whole.name, channels, values, refuse=sensors is not None)
    return Samples(
        record=whole,
        sensors=tuple(chosen[i] for i in kept),
        values=values[:, kept],
        notes=(*left_out, *gap_notes, *map(str, noted(findings)), *_spike_notes(spikes, whole.samples), *copy_notes),
        doubts=(*(_doubt_of(one) for one in findings if one.kind in SPECTRAL_FAULTS), *map(str, doubted(findings))),
    )


def _doubt_of(fault: Fault) -> str:
    return f"channel {fault.channel or 'clock'}: {fault.kind}: {fault.statement}"


def _screened(record: Record, channels: Sequence[str], helpers: Sequence[str]) -> tuple[list[Fault], list[Fault]]:
    """Findings of the record, copies apart, and its few spikes, which can be bridged."""

    def is_few_spikes(one: Fault) -> bool:
        return one.kind == "spikes" and one.count <= MAX_FAULT_SHARE * record.samples

    findings = [one for one in screen(record, None, channels, others=helpers) if one.kind != "copy"]
    return [one for one in findings if not is_few_spikes(one)], list(filter(is_few_spikes, findings))


def without_gaps(record: Record, channels: Sequence[str]) -> tuple[Record, list[str]]:
    """Return the record on a uniform grid, its longest segment without gaps if too much is missing, and notes.

    Raises
    ------
    RecordError
        If a channel has no readings, or too few samples are left.
    """
    notes = [record.attributes[key] for key in (STAMPS, RATE_DOUBT) if key in record.attributes]
    try:
        record = record.on_uniform_grid()
    except RecordError:
        record = resample(record, record.rate)
        notes.append("the sampling is irregular: readings were interpolated to a uniform grid")
    columns = [record.channels.index(name) for name in channels]
    _refuse_empty(record, columns)
    record, fill_notes = _with_short_gaps_filled(record, columns)
    record, missing_notes = _with_few_gaps(record, columns)
    if record.samples < MIN_MODAL_SAMPLES:
        raise RecordError(
            f"{record.name}: {record.samples} samples are too few for modes: expected {MIN_MODAL_SAMPLES} at least, "
            f"and 100 cycles of a mode"
        )
    return record, [*notes, *fill_notes, *missing_notes]


def _refuse_empty(record: Record, columns: Sequence[int]) -> None:
    """Raise RecordError for the first channel without readings."""
    for column in columns:
        if np.all(np.isnan(record.values[:, column])):
            name = record.channels[column]
            raise RecordError(f"{record.name}: channel '{name}' holds no readings: leave it out of the sensors")


def _missing_share(record: Record, columns: Sequence[int]) -> float:
    """Share of missing samples of the channel that lacks most."""
    return float(np.isnan(record.values[:, columns]).mean(axis=0).max())


def _with_short_gaps_filled(record: Record, columns: Sequence[int]) -> tuple[Record, list[str]]:
    """Fill gaps of a few samples if not too much is missing."""
    share = _missing_share(record, columns)
    if not 0.0 < share <= MAX_FILLED_SHARE:
        return record, []
    values = record.values.copy()
    values[:, columns] = np.column_stack([fill_short_gaps(values[:, i], MAX_SHORT_GAP_SAMPLES) for i in columns])
    filled = replace(record, values=values)
    gained = share - _missing_share(filled, columns)
    if gained <= 0.0:
        return filled, []
    text = f"{100 * gained:.2g} % of a channel is missing in short gaps"
    return filled, [f"{text}, which were filled from the readings around them"]


def _with_few_gaps(record: Record, columns: Sequence[int]) -> tuple[Record, list[str]]:
    """Cut out the longest segment without gaps if too much is missing to be bridged."""
    share = _missing_share(record, columns)
    if share <= MAX_FAULT_SHARE:
        note = f"{100 * share:.2g} % of a channel is missing and was bridged by straight lines"
        return record, [note] if share > 0.0 else []
    first, past = _longest_whole(np.isnan(record.values[:, columns]))
    if past - first < MIN_MODAL_SAMPLES:
        raise RecordError(
            f"{record.name}: {100 * share:.0f} % of a channel is missing and no segment is complete: choose other "
            f"channels, or a section"
        )
    step = record.time[1] - record.time[0]
    record = record.section(float(record.time[first]) - 0.25 * step, float(record.time[past - 1]) + 0.75 * step)
    return record, [
        f"{100 * share:.1f} % of a channel is missing: only {record.time[0]:.6g} to {record.time[-1]:.6g} s, "
        f"without gaps, were used"
    ]


def _longest_whole(missing: NDArray[np.bool_]) -> tuple[int, int]:
    """First index of the longest run of rows (T, n) in which nothing is missing, and the index past it."""
    broken = np.concatenate([[-1], np.flatnonzero(missing.any(axis=1)), [len(missing)]])
    longest = int(np.argmax(np.diff(broken)))
    return int(broken[longest]) + 1, int(broken[longest + 1])


def _without_spikes(record: Record, channel: str, spikes: Sequence[Fault]) -> Array:
    """Return the values of a channel, NaN where it has spikes."""
    values = record[channel].copy()
    for finding in spikes:
        if finding.channel == channel:
            for first, last in np.searchsorted(record.time, finding.spans):
                values[first : last + 1] = np.nan
    return np.asarray(values)


def _spike_notes(spikes: Sequence[Fault], samples: int) -> list[str]:
    if not spikes:
        return []
    count = sum(finding.count for finding in spikes)
    where = ", ".join(finding.channel for finding in spikes[:4]) + (" …" if len(spikes) > 4 else "")
    return [f"{count} samples of spikes among {samples} were bridged by straight lines: {where}"]


def _without_copies(
    record: str, channels: Sequence[str], values: Array, *, refuse: bool
) -> tuple[list[int], list[str]]:
    """Return the columns of values (T, n) that are no copies of others, and a note on each copy; or refuse copies."""
    copies = copies_among(values)
    if copies and refuse:
        i, j = copies[0]
        raise RecordError(
            f"{record}: channel '{channels[j]}' is a copy of '{channels[i]}': leave one of them out of the sensors"
        )
    notes = [f"{channels[j]} is a copy of {channels[i]} and is left out" for i, j in copies]
    left_out = {j for _, j in copies}
    return [i for i in range(len(channels)) if i not in left_out], notes
