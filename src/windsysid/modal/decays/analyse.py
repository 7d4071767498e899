"""Modes of a structure from its free decays, without a model.

The release is sought, modes are added one by one (`order`), and fitted jointly in all records (`likelihood`). Intervals
are wider where scores over segments or frequencies scatter more than white noise says; a mode whose decay is not
larger than what goes on near its frequency is not to be used.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import MAX_WIDENING, MIN_REPORTED_WIDENING
from windsysid.errors import ConfigurationError, RecordError
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.modal.decays import limits
from windsysid.modal.decays.likelihood import Decay, DecayFit, Projection, fit_decays, part_scores, poles
from windsysid.modal.decays.order import search_decays
from windsysid.modal.decays.start import release
from windsysid.modal.marks import ModeMarks
from windsysid.modal.shape_merging import Ratios, merge_shapes
from windsysid.modal.singular_values import singular_values
from windsysid.output.progress import Progress, unheard
from windsysid.records.coercion import RecordLike, as_record
from windsysid.records.record import Record
from windsysid.results.provenance import record_hash
from windsysid.spectral.modal_bands.check import shape_doubts
from windsysid.spectral.modal_bands.limits import MIN_STRUCTURE_DAMPING
from windsysid.spectral.modal_bands.part_scores import BandWidening, widening_of
from windsysid.spectral.oma.analyse import Sensors, sensors_of_each
from windsysid.spectral.oma.assemble import acceleration_unit
from windsysid.spectral.oma.describe import named, with_references
from windsysid.spectral.oma.mode import Doubt, OperationalMode
from windsysid.spectral.oma.multi_setup import common_sensors
from windsysid.spectral.oma.result import BandSpectrum, DecayHistory, OperationalModes, RecordModes
from windsysid.spectral.oma.samples import choose_samples
from windsysid.spectral.oma.sensors import derivative_order, geometry_of
from windsysid.spectral.transforms.dft import transform
from windsysid.spectral.transforms.multiblade import is_blade
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["analyse_decays"]

LOCAL_HALF_WIDTHS, LOCAL_BINS = 10.0, 12
"""Setting: half-widths of a mode, and bins, within which the noise is that of the mode."""

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
    progress: Progress = unheard,
) -> OperationalModes:
    """Find the modes of a structure from one or several free decays.

    Parameters
    ----------
    record
        Any record with a release, after which nothing drives the structure; or a list of records of one structure in
        one state, with the same sensors or some in common.
    sensors, turbine
        As in `windsysid.oma`. Channels of rotating blades are left out.
    limits
        Frequency range of the modes [Hz].
    section
        Start and end [s]; the release is sought there.
    marks
        Modes that are to be left out; none can be added (`windsysid.read_mode_marks`).
    progress
        Called with the present step and the share that is done, 0 to 1, or None if that is unknown.

    Returns
    -------
    OperationalModes
        Frequencies [Hz], damping ratios and shapes with their intervals, and reasons for doubt.

    Raises
    ------
    ConfigurationError, RecordError
        If a channel cannot be used, or the record is no free decay.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> t = np.arange(0.0, 40.0, 0.02)
    >>> swing = np.exp(-0.06 * t) * np.cos(6.0 * t) + 0.01 * np.random.default_rng(0).normal(size=len(t))
    >>> found = ws.free_decay(ws.Record(t, swing[:, None], ("top_acceleration",), ("m/s^2",)))
    >>> [(round(mode.frequency, 2), round(mode.damping, 3), mode.grades) for mode in found.modes]
    [(0.95, 0.01, ('A', 'A'))]
    """
    begun = time.process_time()
    marks = ModeMarks() if marks is None else marks
    if marks.add:
        raise ConfigurationError("modes by hand: expected frequencies to remove only, got ranges to add: give limits")
    several = isinstance(record, list | tuple)
    given = cast("list[RecordLike]", record) if several else [cast("RecordLike", record)]
    records = [as_record(one) for one in given]
    if not records:
        raise ConfigurationError("records: expected one at least, got an empty list")
    machine = None if turbine is None else as_turbine(turbine)
    lists = sensors_of_each(sensors, len(records))
    progress("releases", None)
    released = [_released(one, listed, machine, section) for one, listed in zip(records, lists, strict=True)]
    progress("modes", None)
    fit, released = _fitted(released, limits)
    found = _result(fit, released)
    for frequency in marks.remove:
        at = marks.index_of(frequency, [(mode.frequency, mode.damping * mode.frequency) for mode in found.modes])
        left = found.modes[: at or 0] + found.modes[(at or 0) + 1 :] if at is not None else found.modes
        note = f"{frequency:.4g} Hz was removed by hand" if at is not None else f"no mode is near {frequency:.4g} Hz"
        found = replace(found, modes=left, notes=(*found.notes, note))
    nodes, drawn = geometry_of(sensors)
    found = replace(found, nodes=nodes, lines_drawn=drawn)
    modes = with_references(named(found.modes, found.channels), machine, 0.0)
    if found.doubts:
        of_record = Doubt("record", f"the record is doubtful: {found.doubts[0]}")
        modes = [replace(mode, grounds=(*mode.grounds, of_record)) for mode in modes]
    return replace(found, modes=tuple(modes), elapsed=time.process_time() - begun)


def _released(
    record: Record, sensors: "Sensors | None", turbine: Turbine | None, section: tuple[float, float] | None
) -> _Released:
    """Readings of a record from its release on."""
    used = record.section(*section) if section is not None else record
    if sensors is None and turbine is not None:
        sensors = [sensor for sensor in turbine.sensors if sensor.channel in used] or None
    samples = choose_samples(used, cast("Sequence[Sensor | str] | None", sensors))
    turning = "rotor_azimuth" in samples.record or "rotor_speed" in samples.record
    kept = [i for i, one in enumerate(samples.sensors) if not (turning and is_blade(one.channel))]
    if not kept:
        raise RecordError(f"{record.name}: expected channels of what does not turn, got blades only: use identify")
    whole, chosen = samples.record, tuple(samples.sensors[i] for i in kept)
    values = samples.values[:, kept]
    first = release(values)
    if len(values) - first < limits.MIN_SAMPLES:
        raise _no_decay(record.name, "most of its vibration is at its end")
    orders = tuple(derivative_order(sensor, whole) for sensor in chosen)
    frequency, transforms = transform(values[first:] - values[first:].mean(axis=0), whole.rate)
    spectrum = singular_values(frequency, transforms)
    units = tuple(acceleration_unit(whole.unit(s.channel), order) for s, order in zip(chosen, orders, strict=True))
    left = ("channels of blades were left out: free decays are of what does not turn",)
    result = OperationalModes(
        record=record.name, section=(float(whole.time[first]), float(whole.time[-1])), rate=whole.rate,
        samples=len(values) - first, channels=tuple(s.channel for s in chosen), units=units, sensors=chosen, modes=(),
        lines=(), empty=(), frequency=spectrum[0], singular_values=spectrum[1], bands=(), rotor_hz=0.0,
        doubts=tuple(one for one in samples.doubts if "transient" not in one),
        notes=(*samples.notes, *(left if len(kept) < len(samples.sensors) else ())), elapsed=0.0, start=record.start,
        record_hash=record_hash(record),
    )  # fmt: skip
    return _Released(Decay(values[first:], whole.rate), orders, result)


def _no_decay(name: str, why: str) -> RecordError:
    return RecordError(
        f"{name}: expected a free decay, got none: {why}; for ambient vibration leave out --decay (`windsysid.oma`)"
    )


def _fitted(released: Sequence[_Released], between: tuple[float, float] | None) -> tuple[DecayFit, list[_Released]]:
    """Fit of all records, cut off where the slowest decay is over, and begun where the motion is free."""
    released = list(released)
    fit = search_decays([one.decay for one in released], between)
    cut = [_without_end(one, fit) for one in released]
    if any(len(a.decay.values) < len(b.decay.values) for a, b in zip(cut, released, strict=True)):
        released, fit = cut, search_decays([one.decay for one in cut], between)
    begun = released
    for _ in range(limits.MAX_START_STEPS):
        later = [_later(one, records, fit) for one, records in zip(begun, fit.records, strict=True)]
        if all(a is b for a, b in zip(later, begun, strict=True)):
            break
        begun, fit = later, fit_decays(fit.theta, [one.decay for one in later])
    if begun is not released:
        released, fit = begun, search_decays([one.decay for one in begun], between)
    if not len(fit.theta):
        raise _no_decay(released[0].result.record, "no decaying vibration stands out of the noise")
    return fit, released


def _without_end(one: _Released, fit: DecayFit) -> _Released:
    """Cut off what comes after `TIME_CONSTANTS` of the slowest mode."""
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
    return one._replace(decay=Decay(values, rate), result=replace(one.result, section=section, samples=len(values)))


def _result(fit: DecayFit, released: Sequence[_Released]) -> OperationalModes:
    """Result of all records, modes by rising frequency and without names."""
    results, decays = [one.result for one in released], [one.decay for one in released]
    sensors = common_sensors(results)
    scores = part_scores(fit, decays)
    r = len(fit.frequency)
    over = [widening_of(scores, i) for i in range(2 * r)]
    found, alone = [], [fit_decays(fit.theta, [decay]) for decay in decays]
    for j in np.argsort(fit.frequency):
        ratios = [_ratios(fit, one, s, int(j), sensors.places[s]) for s, one in enumerate(released)]
        merged = merge_shapes(ratios, len(sensors.names))
        local = _local_noise(fit, decays, int(j))
        both = (_over(over[j], local), _over(over[r + j], local))
        mode = _mode(fit, int(j), both, (merged.shape, local**2 * merged.cov), local)
        found.append((int(j), replace(mode, grounds=(*_doubts(fit, decays, int(j)), *mode.grounds))))
    driven = _driven(fit, found)
    if driven > limits.MAX_DRIVEN_SHARE:
        raise _no_decay(results[0].record, f"{100 * driven:.0f} % of the vibration at its beginning does not decay")
    if driven > limits.MIN_DRIVEN_SHARE:
        text = f"{100 * driven:.0f} % of the vibration at the beginning does not decay: something drives the structure"
        found = [(j, replace(mode, grounds=(*mode.grounds, Doubt("history", text)))) for j, mode in found]
    histories = tuple(_history(one, projection) for one, projection in zip(released, fit.records, strict=True))
    parts = [
        RecordModes(one.record, one.start, one.section, one.rate, one.samples,
            tuple(_alone(own, j) for j, _ in found), one.notes, one.channels)
        for one, own in zip(results, alone, strict=True)
    ]  # fmt: skip
    several = len(results) > 1
    return replace(
        results[0],
        record=", ".join(one.record for one in results),
        samples=sum(one.samples for one in results),
        channels=sensors.names,
        units=sensors.units,
        sensors=sensors.sensors,
        modes=tuple(mode for _, mode in found),
        bands=tuple(_spectra(fit, decays[0], int(j)) for j, _ in found),
        doubts=tuple(f"{one.record}: {text}" if several else text for one in results for text in one.doubts),
        notes=tuple(f"{one.record}: {text}" if several else text for one in results for text in _notes(one)),
        parts=tuple(parts) if several else (),
        record_hash=None if several else results[0].record_hash,
        decays=histories,
    )


def _driven(fit: DecayFit, found: Sequence[tuple[int, OperationalMode]]) -> float:
    """Share of the power at the beginning of modes that do not decay clearly."""
    begun = _begun(fit)
    lasting = [j for j, mode in found if mode.doubted_for("history", "line", "short")]
    return float(begun[lasting].sum() / max(begun.sum(), 1e-300))


def _notes(result: OperationalModes) -> list[str]:
    first, last = result.section
    return [*result.notes, f"the motion is taken as free from {first:.6g} to {last:.6g} s"]


def _mode(
    fit: DecayFit, j: int, over: tuple[BandWidening, BandWidening], merged: tuple[Complex, Array], local: float = 1.0
) -> OperationalMode:
    """Mode j with the intervals of its local noise, wider by factors for frequency and damping ratio."""
    r = len(fit.frequency)
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    std_f, std_z = (local * float(np.sqrt(fit.cov[i, i])) * one.factor for i, one in zip((j, r + j), over, strict=True))
    shape, cov = merged[0], merged[1] * max(one.factor for one in over) ** 2
    variance, n = np.maximum(np.diagonal(cov), 0.0), len(shape)
    std = np.sqrt(0.5 * (variance[:n] + variance[n:]))
    grounds, remarks = [*shape_doubts(std)], list[Doubt]()
    for one, what in zip(over, ("frequency", "damping ratio"), strict=True):
        if one.factor > MIN_REPORTED_WIDENING:
            text = f"the interval of its {what} is {one.factor:.2g} times as wide as that of the model: {one.cause}"
            (grounds if one.factor > MAX_WIDENING else remarks).append(Doubt("scores", text, what))  # type: ignore[arg-type]
    half = max(10.0 * z * f, 3.0 / float(len(fit.records[0].residual)))
    return OperationalMode(
        "", f, f * std_f, z, std_z, shape, std, np.nan, np.nan, (max(f - half, 0.0), f + half), tuple(grounds),
        shape_cov=cov, remarks=tuple(remarks), widening=(over[0].factor, over[1].factor),
    )  # fmt: skip


def _alone(fit: DecayFit, j: int) -> OperationalMode:
    """A mode as one record alone gives it, without a shape."""
    shape = fit.records[0].amplitude[j] / max(float(np.max(np.abs(fit.records[0].amplitude[j]))), 1e-300)
    nothing: Array = np.zeros(len(shape))
    none = BandWidening()
    return replace(_mode(fit, j, (none, none), (shape, np.zeros((2 * len(shape),) * 2))), shape_std=nothing)


def _ratios(fit: DecayFit, one: _Released, record: int, j: int, place: NDArray[np.int64]) -> Ratios:
    """Shape of mode j in one record, as accelerations, with its covariance."""
    projection = fit.records[record]
    r, n = projection.amplitude.shape
    back = np.linalg.inv(projection.triangle)[[j, r + j]]
    own = back @ back.T  # of one channel with unit noise
    moved = -(back @ (projection.basis.T @ _raw_slopes(fit, one.decay)))  # (2, 4 r)
    follow = np.einsum("ai,cik->ack", moved, projection.weights()).reshape(2 * n, 2 * r)
    cov = np.kron(own, np.diag(projection.noise)) + follow @ fit.cov @ follow.T
    scale = poles(fit.theta)[0][j] ** (2 - np.array(one.orders))
    a = projection.amplitude[j] * scale
    largest = int(np.argmax(np.abs(a)))
    slope = np.diag(scale / a[largest])
    slope[:, largest] -= a * scale[largest] / a[largest] ** 2
    both = np.block([[slope.real, -slope.imag], [slope.imag, slope.real]])
    return Ratios(place, a / a[largest], both @ cov @ both.T)


def _raw_slopes(fit: DecayFit, decay: Decay) -> Array:
    """(T, 4 r): Re and −Im of t λ exp(λt), and of t ∂λ/∂ln ζ exp(λt)."""
    t, (pole, slope) = decay.time[:, None], poles(fit.theta)
    waves = np.exp(pole * t)
    turned = np.hstack([waves * pole, waves * slope]) * t
    return np.stack([turned.real, -turned.imag], axis=2).reshape(len(t), -1)


def _doubts(fit: DecayFit, decays: Sequence[Decay], j: int) -> list[Doubt]:
    """Reasons why a mode is not to be used: no decay, too short, as narrow as the line of a machine."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    std = float(np.sqrt(fit.cov[len(fit.frequency) + j, len(fit.frequency) + j]))
    doubts = []
    if (ratio := _decay_ratio(fit, decays, j))[0] < ratio[1]:
        doubts.append(Doubt("history", f"near {f:.4g} Hz as much vibration goes on as decays: something drives it"))
    if std > limits.MAX_LOG_DAMPING_STD:
        doubts.append(Doubt("short", f"the decay is too short: damping known to a factor of {np.exp(2.0 * std):.2g}"))
    others = np.abs(fit.frequency - f) < limits.MIN_DISTANCE * z * f
    if np.any(others & (_begun(fit) > _begun(fit)[j])):
        text = "a stronger mode is within its half-width: it may be how that one changes with amplitude"
        doubts.append(Doubt("faint", text))
    if np.exp(2.0 * std) * z < MIN_STRUCTURE_DAMPING:
        text = f"it hardly decays: a damping ratio of {100 * z:.2g} %, which machines have and structures hardly"
        doubts.append(Doubt("line", text))
    return doubts


def _over(widening: BandWidening, local: float) -> BandWidening:
    """What of a widening the local noise does not explain."""
    return widening._replace(factor=max(1.0, widening.factor / local))


def _local_noise(fit: DecayFit, decays: Sequence[Decay], j: int) -> float:
    """Amplitude of the residual near a mode over that of white noise of the same variance, not below 1."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    level = weight = 0.0
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(one.residual)
        step = decay.rate / samples
        power = np.abs(np.fft.rfft(one.residual, axis=0)) ** 2 / (one.noise * samples)
        near = np.abs(np.arange(len(power)) * step - f) <= max(LOCAL_HALF_WIDTHS * z * f, LOCAL_BINS * step)
        inside = np.abs(fit.frequency - f) <= max(LOCAL_HALF_WIDTHS * z * f, LOCAL_BINS * step)
        own = np.abs(one.amplitude[j]) ** 2 / one.noise
        bins = max(int(np.count_nonzero(near)) - 2 * int(np.count_nonzero(inside)), 4)
        level += float(own @ power[near].sum(axis=0)) / bins
        weight += float(own.sum())
    return float(np.sqrt(max(level / weight, 1.0)))


def _begun(fit: DecayFit) -> Array:
    """Power (r,) of each mode at the beginning, over the noise, summed over channels and records."""
    each = [np.sum(0.5 * np.abs(one.amplitude) ** 2 / one.noise, axis=1) for one in fit.records]
    return np.asarray(np.sum(each, axis=0))


def _decay_ratio(fit: DecayFit, decays: Sequence[Decay], j: int) -> tuple[float, float]:
    """Power of a mode at the beginning over that of the residual near its frequency, and the ratio that ambient
    vibration exceeds by chance at one of its N instants: N (1 + x/(N − 1))^(1 − N) = p."""
    f, z = float(fit.frequency[j]), float(fit.damping[j])
    begun, lasting, count = float(_begun(fit)[j]), 0.0, 0.0
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(one.residual)
        step, half = decay.rate / samples, max(2.0 * z * f, 2.0 * decay.rate / samples)
        power = np.abs(np.fft.rfft(one.residual, axis=0)) ** 2 / one.noise
        near = np.abs(np.arange(len(power)) * step - f) <= half
        lasting += 2.0 * float(np.sum(power[near])) / samples**2
        count += max(2.0 * np.pi * z * f * samples / decay.rate, 2.0)
    count = max(count, 2.0)
    bound = (count - 1.0) * ((count / limits.AMBIENT_PROBABILITY) ** (1.0 / (count - 1.0)) - 1.0)
    return begun / max(lasting, 1e-300), bound


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
