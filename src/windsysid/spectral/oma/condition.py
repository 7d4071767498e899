"""From a record to the transforms of its readings: sensors, gaps, lines, multi-blade coordinates."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import RecordError
from windsysid.inspection import MIN_MODAL_SAMPLES
from windsysid.inspection.clock import MAX_SHORT_GAP_SAMPLES
from windsysid.inspection.continuity import copies_among
from windsysid.inspection.fault import Fault
from windsysid.inspection.health import sampled_every
from windsysid.inspection.plausibility import MIN_ROTOR_SPEED, rotor_of
from windsysid.inspection.screening import doubted, noted, screen
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import LOW_PASS, RATE_DOUBT, STAMPS, Record
from windsysid.signals.condition import resample
from windsysid.signals.short_gaps import fill_short_gaps
from windsysid.spectral.oma.sensors import ModalSensor, choose_sensors, derivative_order
from windsysid.spectral.transforms.dft import transform
from windsysid.spectral.transforms.harmonics import find_lines, without_harmonics, without_line
from windsysid.spectral.transforms.multiblade import BladeSet, blade_sets, multiblade

__all__ = ["Line", "Readings", "prepare_readings", "transforms"]

MAX_BRIDGED = 0.02
"""Largest share of missing samples that are bridged by straight lines; if more are missing, the longest segment
without gaps is used."""

MAX_FILLED_SHARE = 0.2
"""Largest share of missing samples for which short gaps are filled by interpolation (`fill_short_gaps`)."""

MAX_SPIKED = 0.002
"""Share of a channel's samples in spikes that are bridged; where more are, the record is doubtful."""

HIGHEST = 0.42
"""Of the sampling rate: up to there modes are sought."""

LOW_PASS_SHARE = 0.8
"""Of a record's low-pass: up to there."""

LOWEST_BINS = 8
"""Modes are sought from that many cycles in the record on."""

STEADY = 0.02
"""Relative standard deviation of the rotor speed, beyond which harmonics and whirls are smeared."""

TRANSIENT = 0.6
"""Share of the vibration in an eighth of the record, beyond which it is a transient."""

TELLING = frozenset({"spikes", "clipping", "frozen", "gaps", "saturation"})
"""Faults that change a spectrum."""


class Line(NamedTuple):
    """A line that was taken out: its name, frequency and half-width [Hz]."""

    name: str
    frequency: float
    half_width: float


class Readings(NamedTuple):
    """What is analysed.

    Attributes
    ----------
    names, units, sensors
        Of the channels (n,): those of the record, then multi-blade coordinates; a sensor each, None for coordinates.
    orders
        How often each is derived by time (n,).
    fixed, turning
        Values (T, n_f) real and (T, n_t) complex, z of each set of blades: its forward and backward parts are the last
        2 n_t channels.
    rate
        [Hz].
    low, high
        Where modes are sought [Hz].
    lines
        Taken out.
    rotor_hz
        Turns per second; 0 where there is no rotor or it stands.
    notes, doubts
        What a reader must know; what makes the whole doubtful.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[ModalSensor | None, ...]
    orders: tuple[int, ...]
    fixed: Array
    turning: Complex
    rate: float
    low: float
    high: float
    lines: tuple[Line, ...]
    rotor_hz: float
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    used: Record

    @property
    def samples(self) -> int:
        """T."""
        return len(self.fixed)


def prepare_readings(record: Record, sensors: Sequence[Sensor | ModalSensor | str] | None) -> Readings:
    """Choose channels, check them, bridge gaps, take out lines.

    Raises
    ------
    ConfigurationError, RecordError
        If channels are missing, dead or copies of each other, or the record is too short.
    """
    chosen, left_out = choose_sensors(record, sensors)
    notes: list[str] = [*left_out]
    channels = [sensor.channel for sensor in chosen]
    helpers = [name for name in ("rotor_azimuth", "rotor_speed") if name in record and name not in channels]
    record = _without_gaps(record.select([*channels, *helpers]), channels, notes)
    findings = screen(record, None, channels, others=helpers)
    few = [one for one in findings if one.kind == "spikes" and one.count <= MAX_SPIKED * record.samples]
    findings = [one for one in findings if one not in few and one.kind != "copy"]  # copies are left out
    notes += [*map(str, noted(findings)), *([_bridged_spikes(few, record.samples)] if few else [])]
    doubts = [_doubt_of(finding) for finding in findings if finding.kind in TELLING] + [*map(str, doubted(findings))]
    values = np.column_stack([_bridged(_without_spikes(record, name, few)) for name in channels])
    kept = _without_copies(record, channels, values, notes, refuse=sensors is not None)
    chosen, values = tuple(chosen[i] for i in kept), values[:, kept]
    high = _highest(record, chosen, values, notes)
    azimuth, rotor_hz, harmonics = _rotor(record, high, notes, doubts)
    low = LOWEST_BINS / record.duration
    values, lines = _without_lines(values - values.mean(axis=0), record.rate, azimuth, harmonics, (low, high), notes)
    doubts += _transient(values)
    still, sets = _frames([sensor.channel for sensor in chosen], azimuth, rotor_hz, notes)
    if not still and not sets:
        raise RecordError(
            f"{record.name}: no channel is left: record rotor_azimuth and a sensor on every blade, or one on the tower"
        )
    fixed, turning = [values[:, i] for i in still], []
    for found in sets:
        assert azimuth is not None
        mean, z = multiblade(values[:, list(found.columns)], azimuth)
        fixed.append(mean)
        turning.append(z)
    names = [chosen[i].channel for i in still] + [f"blades_{found.what} collective" for found in sets]
    names += [f"blades_{found.what} {way}" for found in sets for way in ("forward", "backward")]
    of = [chosen[i] for i in still] + [chosen[found.columns[0]] for found in sets]
    of += [chosen[found.columns[0]] for found in sets for _ in range(2)]
    return Readings(
        names=tuple(names),
        units=tuple(record.unit(sensor.channel) for sensor in of),
        sensors=tuple([chosen[i] for i in still] + [None] * (3 * len(sets))),
        orders=tuple(derivative_order(sensor, record) for sensor in of),
        fixed=np.column_stack(fixed),
        turning=np.column_stack(turning) if turning else np.empty((len(values), 0), dtype=np.complex128),
        rate=record.rate,
        low=low,
        high=high,
        lines=tuple(lines),
        rotor_hz=rotor_hz,
        notes=tuple(notes),
        doubts=tuple(doubts),
        used=record,
    )


def _without_copies(
    record: Record, channels: Sequence[str], values: Array, notes: list[str], *, refuse: bool
) -> list[int]:
    """Indices of columns of values (T, n) that are no copies of others; a copy is refused or noted."""
    copies = copies_among(values)
    if copies and refuse:
        i, j = copies[0]
        raise RecordError(
            f"{record.name}: channel '{channels[j]}' is a copy of '{channels[i]}': leave one of them out of the sensors"
        )
    notes += [f"{channels[j]} is a copy of {channels[i]} and is left out" for i, j in copies]
    return [i for i in range(len(channels)) if i not in {j for _, j in copies}]


def _highest(record: Record, chosen: Sequence[ModalSensor], values: Array, notes: list[str]) -> float:
    """Highest frequency for modes [Hz], below the limits of the slowest channel and of the record's low-pass."""
    high = HIGHEST * record.rate
    if LOW_PASS in record.attributes:
        high = min(high, LOW_PASS_SHARE * float(record.attributes[LOW_PASS]))
    slowest = max((sampled_every(column)[0], one.channel) for column, one in zip(values.T, chosen, strict=True))
    if slowest[0] > 1 and HIGHEST * record.rate / slowest[0] < high:
        high = HIGHEST * record.rate / slowest[0]
        read = f"{record.rate / slowest[0]:.4g} times a second and filled in between"
        notes.append(f"{slowest[1]} was read {read}: modes are sought below {high:.4g} Hz")
    return high


def _without_lines(
    values: Array, rate: float, azimuth: Array | None, harmonics: Sequence[Line], limits: tuple[float, float],
    notes: list[str],
) -> tuple[Array, list[Line]]:  # fmt: skip
    """Remove rotor harmonics and other sinusoids from values (T, n); return the values and all lines."""
    if azimuth is not None:
        values = without_harmonics(values, azimuth)
    else:
        for line in harmonics:
            values = without_line(values, rate, line.frequency)
    machines = [
        f
        for f in find_lines(values, rate, *limits)
        if all(abs(f - line.frequency) > 2.0 * line.half_width for line in harmonics)
    ]
    for f in machines:
        values = without_line(values, rate, f)
    if machines:
        listed = ", ".join(f"{f:.4g}" for f in machines[:8]) + (" …" if len(machines) > 8 else "")
        notes.append(f"steady lines were taken out at {listed} Hz: no vibration under random loads looks like that")
    return values, [*harmonics, *(Line("line", f, 2.0 * rate / len(values)) for f in machines)]


def _frames(
    names: list[str], azimuth: Array | None, rotor_hz: float, notes: list[str]
) -> tuple[list[int], list[BladeSet]]:
    """Columns in the fixed frame, and sets of rotating blades for multi-blade coordinates."""
    if rotor_hz <= 0.0:
        return list(range(len(names))), []
    sets, incomplete = blade_sets(names)
    on_blades = [c for found in sets for c in found.columns]
    if (sets or incomplete) and azimuth is None:
        notes.append(
            "rotor_azimuth is missing: the blades' channels are left out, since their frequencies are shifted by the "
            "turning"
        )
        sets = []
    elif incomplete:
        notes.append(
            f"left out: {', '.join(names[i] for i in incomplete)}: multi-blade coordinates need every blade's sensor"
        )
    return [i for i in range(len(names)) if i not in on_blades and i not in incomplete], sets


def transforms(readings: Readings, part: slice = slice(None)) -> tuple[Array, Complex]:
    """Frequencies (F,) [Hz] and transforms (F, n) of a part of the record, all as accelerations."""
    frequency, fixed = transform(readings.fixed[part], readings.rate)
    both = []
    for column in range(readings.turning.shape[1]):
        z = readings.turning[part, column]
        both.append(transform(np.column_stack([z, z.conj()]), readings.rate)[1])
    n = min(len(fixed), *(len(each) for each in both)) if both else len(fixed)
    found = np.hstack([fixed[:n], *(each[:n] for each in both)])
    derived: NDArray[np.int64] = 2 - np.array(readings.orders)
    return frequency[:n], found * (2j * np.pi * frequency[:n, None]) ** derived[None]


def _without_gaps(record: Record, channels: Sequence[str], notes: list[str]) -> Record:
    """The record on a uniform grid; its longest stretch without gaps where more is missing than can be bridged."""
    notes += [record.attributes[key] for key in (STAMPS, RATE_DOUBT) if key in record.attributes]
    try:
        record = record.on_uniform_grid()
    except RecordError:
        record = resample(record, record.rate)
        notes.append("the sampling is irregular: readings were interpolated to a uniform grid")
    columns = [record.channels.index(name) for name in channels]
    missing = np.isnan(record.values[:, columns])
    dead = [name for name, none in zip(channels, np.all(missing, axis=0).tolist(), strict=True) if none]
    if dead:
        raise RecordError(f"{record.name}: channel '{dead[0]}' holds no readings: leave it out of the sensors")
    share = float(missing.mean(axis=0).max())
    if 0.0 < share <= MAX_FILLED_SHARE:
        values = record.values.copy()
        values[:, columns] = np.column_stack([fill_short_gaps(values[:, i], MAX_SHORT_GAP_SAMPLES) for i in columns])
        record = replace(record, values=values)
        before, missing = share, np.isnan(values[:, columns])
        share = float(missing.mean(axis=0).max())
        if before > share:
            notes.append(
                f"{100 * (before - share):.2g} % of a channel is missing in short gaps, which were filled from the"
                " readings around them"
            )
    if share > MAX_BRIDGED:
        whole = ~missing.any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], whole.astype(np.int8), [0]])))
        lengths = edges[1::2] - edges[::2]
        if not lengths.size or lengths.max() < MIN_MODAL_SAMPLES:
            raise RecordError(
                f"{record.name}: {100 * share:.0f} % of a channel is missing and no stretch is whole: choose other "
                f"channels, or a section"
            )
        k = int(np.argmax(lengths))
        first, past = int(edges[2 * k]), int(edges[2 * k + 1])
        step = record.time[1] - record.time[0]
        record = record.section(float(record.time[first]) - 0.25 * step, float(record.time[past - 1]) + 0.75 * step)
        notes.append(
            f"{100 * share:.1f} % of a channel is missing: only {record.time[0]:.6g} to {record.time[-1]:.6g} s, "
            f"without gaps, were used"
        )
    elif share:
        notes.append(f"{100 * share:.2g} % of a channel is missing and was bridged by straight lines")
    if record.samples < MIN_MODAL_SAMPLES:
        raise RecordError(
            f"{record.name}: {record.samples} samples are too few for modes: expected {MIN_MODAL_SAMPLES} at least, "
            f"and 100 cycles of a mode"
        )
    return record


def _transient(values: Array) -> list[str]:
    """A doubt where an eighth of the record has most of the vibration of half the channels."""
    energy = np.array([np.sum(part**2, axis=0) for part in np.array_split(np.diff(values, axis=0), 8)])
    most = float(np.median(energy.max(axis=0) / np.maximum(energy.sum(axis=0), 1e-300)))
    if most < TRANSIENT:
        return []
    return [
        f"the record is a transient: an eighth of it has {100 * most:.0f} % of the vibration; a free decay is for "
        f"windsysid identify"
    ]


def _without_spikes(record: Record, channel: str, spikes: Sequence[Fault]) -> Array:
    """A channel, NaN where it has spikes."""
    values = record[channel].copy()
    for finding in spikes:
        if finding.channel == channel:
            first, last = (
                np.searchsorted(record.time, finding.spans[:, 0]),
                np.searchsorted(record.time, finding.spans[:, 1]),
            )
            for a, b in zip(first, last, strict=True):
                values[a : b + 1] = np.nan
    return np.asarray(values)


def _bridged_spikes(spikes: Sequence[Fault], samples: int) -> str:
    count = sum(finding.count for finding in spikes)
    where = ", ".join(finding.channel for finding in spikes[:4]) + (" …" if len(spikes) > 4 else "")
    return f"{count} samples of spikes among {samples} were bridged by straight lines: {where}"


def _bridged(values: Array) -> Array:
    known = np.isfinite(values)
    return values if known.all() else np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])


def _rotor(record: Record, high: float, notes: list[str], doubts: list[str]) -> tuple[Array | None, float, list[Line]]:
    """Azimuth (T,) unwrapped, turns per second, and the rotor's lines."""
    rotor = rotor_of(record)
    if rotor is None or abs(rotor.mean) <= MIN_ROTOR_SPEED:
        return None, 0.0, []
    azimuth = None
    if "rotor_azimuth" in record:
        azimuth = np.unwrap(_unwrapped_known(record["rotor_azimuth"]))
        turns = np.diff(azimuth) * np.sign(rotor.mean)
        if np.any(turns < -0.05) or np.any(np.abs(turns - np.median(turns)) > 0.5 + np.median(turns)):
            raise RecordError(
                f"{record.name}: rotor_azimuth jumps: choose a section where it turns steadily, or leave the channel "
                f"out"
            )
    once = abs(rotor.mean) / (2.0 * np.pi)
    if rotor.variation > STEADY:
        doubts.append(
            f"the rotor speed varies by {100 * rotor.variation:.1f} %: harmonics and whirls are smeared; choose a "
            f"steadier section"
        )
    width = 1.5 / record.duration
    lines = [
        Line(f"{n}P", n * once, width + n * once * min(rotor.variation, 0.2 / n))
        for n in range(1, int(min(high / once, 60)) + 1)
    ]
    return azimuth, once, lines


def _unwrapped_known(psi: Array) -> Array:
    known = np.isfinite(psi)
    if known.all():
        return psi
    return np.interp(np.arange(len(psi)), np.flatnonzero(known), np.unwrap(psi[known]))


def _doubt_of(fault: Fault) -> str:
    return f"channel {fault.channel or 'clock'}: {fault.kind}: {fault.statement}"
