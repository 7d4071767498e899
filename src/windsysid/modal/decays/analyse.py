"""Modes of a structure from its free decays, without a model.

The release is sought, modes are added one by one (`order`), and fitted jointly in all records (`likelihood`). Intervals
are wider where scores over segments or frequencies scatter more than white noise says; a mode whose decay is not
larger than what goes on near its frequency is not to be used.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.inspection.rotor import turns_per_second
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.modal.decays import limits
from windsysid.modal.decays.describe import DescribedMode, describe_modes, driven_share, mode_alone
from windsysid.modal.decays.likelihood import Decay, DecayFit, Projection, fit_decays
from windsysid.modal.decays.order import search_decays
from windsysid.modal.decays.start import highest_peak, reduced, release
from windsysid.modal.marks import ModeMarks
from windsysid.modal.matching.match import with_references
from windsysid.modal.singular_values import singular_values
from windsysid.output.progress import Progress, unheard
from windsysid.records.coercion import MappingLike, RecordLike, as_records
from windsysid.records.record import Record
from windsysid.results.provenance import record_hash
from windsysid.spectral.oma.analyse import Sensors, sensors_of_each
from windsysid.spectral.oma.assemble import acceleration_unit
from windsysid.spectral.oma.describe import named
from windsysid.spectral.oma.mode import Doubt, OperationalMode
from windsysid.spectral.oma.multi_setup import common_sensors
from windsysid.spectral.oma.result import BandSpectrum, DecayHistory, OperationalModes, RecordModes
from windsysid.spectral.oma.samples import Samples, choose_samples
from windsysid.spectral.oma.sensors import ModalSensor, derivative_order, geometry_of
from windsysid.spectral.transforms.dft import transform
from windsysid.spectral.transforms.multiblade import is_blade
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["analyse_decays"]

MAX_DRAWN = 4000
"""Setting: number of samples of a history that are kept for the page."""


class _Released(NamedTuple):
    """One record: its readings from the release on, the derivative orders of its channels, and an empty result."""

    decay: Decay
    orders: tuple[int, ...]
    result: OperationalModes


@one_thread()
def analyse_decays(
    record: "RecordLike | Sequence[RecordLike]",
    *,
    sensors: "Sensors | Sequence[Sensors] | None" = None,
    turbine: "TurbineLike | None" = None,
    limits: tuple[float, float] | None = None,
    section: tuple[float, float] | None = None,
    marks: ModeMarks | None = None,
    mapping: "MappingLike | None" = None,
    progress: Progress = unheard,
) -> OperationalModes:
    """Identify the modes of a structure from one or several free decays.

    Parameters
    ----------
    record : Record, str, Path, pandas.DataFrame or xarray.Dataset, or a sequence of these
        A record with a release, after which no load acts; or several of one structure in one state, with the same
        sensors or some in common.
    sensors, turbine : optional
        As in `windsysid.oma`. Channels of rotating blades are left out.
    limits : (float, float), optional
        Frequency range of the modes [Hz].
    section : (float, float), optional
        Start and end [s] of the part in which the release is sought; the whole record by default.
    marks : ModeMarks, optional
        Modes to leave out; none can be added (`windsysid.results.read_mode_marks`).
    mapping : str, Path or Mapping, optional
        Mapping file with the names, units and signs of channels, where `record` is a path (`read_record`).
    progress : callable, optional
        Called with the present step and the share that is done, 0 to 1, or None if that is unknown.

    Returns
    -------
    OperationalModes
        Frequencies [Hz], damping ratios [1] and shapes (n,) with their 95 % intervals and grades.

    Raises
    ------
    RecordError
        If a record cannot be read, or is no free decay.
    ConfigurationError
        If there is no record, or a channel cannot be used.

    See Also
    --------
    oma : Modes from ambient vibration.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> t = np.arange(0.0, 40.0, 0.02)
    >>> swing = np.exp(-0.06 * t) * np.cos(6.0 * t) + 0.01 * np.random.default_rng(0).normal(size=len(t))
    >>> found = ws.free_decay(ws.Record(t, swing[:, None], ("top_acceleration",), ("m/s^2",)))
    >>> for mode in found.modes:
    ...     print(mode.name, round(mode.frequency.estimate, 2), mode.frequency.unit, mode.frequency.grade)
    ...     print("damping ratio", round(mode.damping_ratio.estimate, 3), mode.damping_ratio.grade)
    mode 1 0.95 Hz A
    damping ratio 0.01 A
    """
    begun = time.process_time()
    marks = ModeMarks() if marks is None else marks
    if marks.add:
        raise ConfigurationError("modes by hand: expected frequencies to remove only, got ranges to add: give limits")
    records = as_records(record, mapping)
    machine = None if turbine is None else as_turbine(turbine)
    lists = sensors_of_each(sensors, len(records))
    progress("releases", None)
    released = [_released(one, listed, machine, section) for one, listed in zip(records, lists, strict=True)]
    progress("modes", None)
    fit, released = _fitted(released, limits)
    found = _result(fit, released)
    found = _without_removed(found, marks)
    nodes, drawn = geometry_of(sensors)
    found = replace(found, nodes=nodes, lines_drawn=drawn)
    modes = with_references(named(found.modes, found.channels), found.channels, machine, found.rotor_hz)
    if found.doubts:
        of_record = Doubt("record", f"the record is doubtful: {found.doubts[0]}")
        modes = [replace(mode, grounds=(*mode.grounds, of_record)) for mode in modes]
    return replace(found, modes=tuple(modes), elapsed=time.process_time() - begun)


def _without_removed(found: OperationalModes, marks: ModeMarks) -> OperationalModes:
    """Result without the modes that were removed by hand."""
    kept, notes = marks.kept([(mode.frequency.estimate, mode.half_width) for mode in found.modes])
    return replace(
        found,
        modes=tuple(found.modes[i] for i in kept),
        bands=tuple(found.bands[i] for i in kept),
        parts=tuple(replace(part, modes=tuple(part.modes[i] for i in kept)) for part in found.parts),
        notes=(*found.notes, *notes),
    )


def _released(
    record: Record, sensors: "Sensors | None", turbine: Turbine | None, section: tuple[float, float] | None
) -> _Released:
    """Readings of a record from its release on."""
    used = record.section(*section) if section is not None else record
    if sensors is None and turbine is not None:
        sensors = [sensor for sensor in turbine.sensors if sensor.channel in used] or None
    samples = choose_samples(used, cast("Sequence[Sensor | str] | None", sensors))
    kept = _standing(samples)
    whole, chosen = samples.record, tuple(samples.sensors[i] for i in kept)
    values = samples.values[:, kept]
    first = release(values)
    if len(values) - first < limits.MIN_SAMPLES:
        raise _no_decay(record.name, "most of its vibration is at its end")
    note = "blade channels were left out: free decays are analysed in the fixed frame"
    result = _empty_result(record, samples, chosen, first)
    if len(kept) < len(samples.sensors):
        result = replace(result, notes=(*result.notes, note))
    return _Released(Decay(values[first:], whole.rate), tuple(derivative_order(s, whole) for s in chosen), result)


def _standing(samples: Samples) -> list[int]:
    """Indices of the channels that do not turn."""
    turning = turns_per_second(samples.record) > 0.0
    kept = [i for i, one in enumerate(samples.sensors) if not (turning and is_blade(one.channel))]
    if not kept:
        raise RecordError(f"{samples.record.name}: expected channels in the fixed frame, got blades: use identify")
    return kept


def _empty_result(record: Record, samples: Samples, chosen: Sequence[ModalSensor], first: int) -> OperationalModes:
    """Result of one record from a sample on, without modes."""
    whole = samples.record
    columns = [samples.sensors.index(sensor) for sensor in chosen]
    values = samples.values[first:, columns]
    frequency, spectrum = singular_values(*transform(values - values.mean(axis=0), whole.rate))
    units = tuple(acceleration_unit(whole.unit(s.channel), derivative_order(s, whole)) for s in chosen)
    return OperationalModes(
        record=record.name, section=(float(whole.time[first]), float(whole.time[-1])), rate=whole.rate,
        samples=len(values), channels=tuple(s.channel for s in chosen), units=units, sensors=tuple(chosen), modes=(),
        lines=(), empty=(), frequency=frequency, singular_values=spectrum, bands=(), rotor_hz=turns_per_second(whole),
        doubts=tuple(one for one in samples.doubts if "transient" not in one), notes=samples.notes, elapsed=0.0,
        start=record.start, record_hash=record_hash(record),
    )  # fmt: skip


def _no_decay(name: str, why: str) -> RecordError:
    return RecordError(
        f"{name}: expected a free decay, got none: {why}; for ambient vibration use `oma` without a decay"
    )


def _fitted(released: Sequence[_Released], between: tuple[float, float] | None) -> tuple[DecayFit, list[_Released]]:
    """Fit of all records, cut off where the slowest decay is over, and begun where the motion is free."""
    released = _all_reduced(released)
    fit = search_decays([one.decay for one in released], between)
    cut = [_without_end(one, fit) for one in released]
    if any(a is not b for a, b in zip(cut, released, strict=True)):
        released, fit = cut, search_decays([one.decay for one in cut], between)
    begun = _begun_later(released, fit)
    if begun is not released:
        released, fit = begun, search_decays([one.decay for one in begun], between)
    if not len(fit.theta):
        raise _no_decay(released[0].result.record, "no decaying vibration exceeds the noise")
    return fit, released


def _all_reduced(released: Sequence[_Released]) -> list[_Released]:
    """Records at rates that the vibration of all of them needs."""
    highest = max(highest_peak(one.decay) for one in released)
    return [_reduced(one, highest) for one in released]


def _reduced(one: _Released, highest: float) -> _Released:
    """Record at a rate that its vibration up to a frequency [Hz] needs."""
    decay, later = reduced(one.decay, highest)
    start = one.result.section[0] + later
    section = (start, start + (len(decay.values) - 1) / decay.rate)
    return one._replace(decay=decay, result=replace(one.result, section=section))


def _begun_later(released: list[_Released], fit: DecayFit) -> list[_Released]:
    """Records begun where their motion is free; the same list if it is so from the beginning."""
    for _ in range(limits.MAX_START_STEPS):
        later = [_later(one, records, fit) for one, records in zip(released, fit.records, strict=True)]
        if all(a is b for a, b in zip(later, released, strict=True)):
            break
        released, fit = later, fit_decays(fit.theta, [one.decay for one in later])
    return released


def _without_end(one: _Released, fit: DecayFit) -> _Released:
    """Cut the record after `TIME_CONSTANTS` of the slowest mode."""
    if not len(fit.theta):
        return one
    longest = limits.TIME_CONSTANTS / float(np.min(2.0 * np.pi * fit.frequency * fit.damping))
    samples = max(int(longest * one.decay.rate), limits.MIN_SAMPLES)
    return _section(one, 0, samples) if samples < len(one.decay.values) else one


def _later(one: _Released, projection: Projection, fit: DecayFit) -> _Released:
    """Begin a cycle of the slowest mode later if the residual of the first cycle is too large (F test)."""
    from scipy.special import fdtrc

    if not len(fit.theta):
        return one
    cycle = int(np.ceil(one.decay.rate / float(fit.frequency.min())))
    if len(one.decay.values) < 6 * cycle or cycle < 4:
        return one
    first, rest = projection.residual[:cycle], projection.residual[cycle:]
    ratio = float(np.max(np.mean(first**2, axis=0) / np.maximum(np.mean(rest**2, axis=0), projection.noise * 1e-3)))
    chance = float(fdtrc(cycle, len(rest), ratio)) * first.shape[1]
    return _section(one, cycle, len(one.decay.values)) if chance < limits.START_PROBABILITY else one


def _section(one: _Released, first: int, past: int) -> _Released:
    values, rate = one.decay.values[first:past], one.decay.rate
    start = one.result.section[0] + first / rate
    section = (start, start + (len(values) - 1) / rate)
    return one._replace(decay=Decay(values, rate), result=replace(one.result, section=section))


def _result(fit: DecayFit, released: Sequence[_Released]) -> OperationalModes:
    """Result of all records, modes by rising frequency and without names."""
    results, decays = [one.result for one in released], [one.decay for one in released]
    sensors = common_sensors(results)
    described = describe_modes(fit, decays, [one.orders for one in released], sensors.places, results[0].rotor_hz)
    modes = _undriven_modes(fit, described, results[0].record)
    return replace(
        results[0],
        channels=sensors.names,
        units=sensors.units,
        sensors=sensors.sensors,
        samples=sum(map(_samples, results)),
        modes=modes,
        bands=tuple(_spectra(fit, decays[0], one.number) for one in described),
        decays=tuple(_history(one, projection) for one, projection in zip(released, fit.records, strict=True)),
        **(_of_several(results, described, decays, fit) if len(results) > 1 else {"notes": _notes(results[0])}),
    )


def _undriven_modes(fit: DecayFit, described: Sequence[DescribedMode], record: str) -> tuple[OperationalMode, ...]:
    """Modes, doubtful where some of the vibration does not decay; RecordError where most of it does not."""
    modes, driven = tuple(one.mode for one in described), driven_share(fit, described)
    if driven > limits.MAX_DRIVEN_SHARE:
        raise _no_decay(record, f"{100 * driven:.0f} % of the vibration at its beginning does not decay")
    if driven < limits.MIN_DRIVEN_SHARE:
        return modes
    text = f"{100 * driven:.0f} % of the vibration at the beginning does not decay: a load acts on the structure"
    return tuple(replace(mode, grounds=(*mode.grounds, Doubt("history", text))) for mode in modes)


def _of_several(
    results: Sequence[OperationalModes], described: Sequence[DescribedMode], decays: Sequence[Decay], fit: DecayFit
) -> dict[str, Any]:
    """Fields of a result of several records: names, remarks and the modes of each."""
    parts = []
    for s, (one, decay) in enumerate(zip(results, decays, strict=True)):
        own = fit_decays(fit.theta, [decay])
        modes = tuple(mode_alone(own, mode.number, mode.shapes[s]) for mode in described)
        head = (one.record, one.start, one.section, one.rate, _samples(one))
        parts.append(RecordModes(*head, modes, one.notes, one.channels))
    return {
        "record": ", ".join(one.record for one in results),
        "doubts": tuple(f"{one.record}: {text}" for one in results for text in one.doubts),
        "notes": tuple(f"{one.record}: {text}" for one in results for text in _notes(one)),
        "parts": tuple(parts),
        "record_hash": None,
    }


def _samples(result: OperationalModes) -> int:
    """Samples of the record in its section."""
    return round((result.section[1] - result.section[0]) * result.rate) + 1


def _notes(result: OperationalModes) -> tuple[str, ...]:
    first, last = result.section
    return (*result.notes, f"the motion is taken as free from {first:.6g} to {last:.6g} s")


def _history(one: _Released, projection: Projection) -> DecayHistory:
    """Readings and residual of the channel that decays most clearly."""
    at = int(np.argmax(np.sum(np.abs(projection.amplitude) ** 2, axis=0) / projection.noise))
    step = -(-len(one.decay.values) // MAX_DRAWN)
    measured = one.decay.values[::step, at]
    time_ = one.result.section[0] + one.decay.time[::step]
    fitted = measured - projection.residual[::step, at]
    return DecayHistory(one.result.record, one.result.channels[at], time_, measured, fitted)


def _spectra(fit: DecayFit, decay: Decay, j: int) -> BandSpectrum:
    """Spectra of the first record near a mode: all channels over their noise."""
    one, samples = fit.records[0], len(decay.values)
    f, half = float(fit.frequency[j]), max(10.0 * float(fit.frequency[j] * fit.damping[j]), 6.0 * decay.rate / samples)
    frequency = np.arange(samples // 2 + 1) * decay.rate / samples
    near = np.abs(frequency - f) <= half
    scale = 2.0 / (decay.rate * samples * one.noise)
    measured, fitted = (
        np.sum(np.abs(np.fft.rfft(values - values.mean(axis=0), axis=0)[near]) ** 2 * scale, axis=1)
        for values in (decay.values, decay.values - one.residual)
    )
    return BandSpectrum(frequency[near], measured, fitted)
