"""Operational modal analysis: the modes of any structure from its ambient vibration, no model needed.

The spectra of the readings are searched for peaks; in each band around one or a few of them the modes are the most
probable ones under loads that nobody measured (`modal_model`), as many as the evidence asks for (`order`), with their
bands (Laplace). What was found says where the bands should have been, so that they are placed once more. Then each mode
is doubted (`modal_checks`).
"""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.inspection.spectra import expected_modes
from windsysid.mechanics.sensors import Sensor
from windsysid.records.coercion import RecordLike, as_record
from windsysid.spectral.bands import Peak, find_peaks, group_peaks, widened
from windsysid.spectral.modal_checks import AT_BORDER, half_fits, is_flank, mode_doubts
from windsysid.spectral.modal_model import spectrum
from windsysid.spectral.modal_sensors import ModalSensor
from windsysid.spectral.oma_data import Readings, prepare_readings, transforms
from windsysid.spectral.operational import BandSpectrum, OperationalMode, OperationalModes
from windsysid.spectral.order import BandFit, fit_band, full_shapes
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["analyse_vibration", "fit_between", "search_again"]

MOST_MODES = 5
"""In one band."""

AGAIN = 2
"""Times that bands are placed anew."""

MOVED = 0.15
"""Of a band's width: a band whose borders should have been farther away than that is fitted again."""

HUMP = 0.01
"""A peak this near to a harmonic of the rotor, relative, or nearer than one and a half of its half-widths, is of the
wind that blades sample."""

FLANK = 2.0
"""In ζ f: so far a mode reaches into the next band."""

NEAR_REFERENCE = 0.08
"""A mode this near to one that the turbine file gives may be that mode."""

BLADES_MOVE = 3.0
"""Blades move that many times as much as the support in a mode of the blades."""

LEAST_EVIDENCE = 10.0
"""2 ln of the evidence for a mode against none."""


def analyse_vibration(
    record: RecordLike,
    *,
    sensors: Sequence[Sensor | ModalSensor | str] | None = None,
    turbine: "TurbineLike | None" = None,
    bands: Sequence[tuple[float, float]] | None = None,
    section: tuple[float, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> OperationalModes:
    """Find the modes of a structure from its ambient vibration.

    Parameters
    ----------
    record
        Any record: readings of acceleration, velocity, displacement, strain or load. Where a rotor turns, with
        rotor_azimuth, blades' readings go into multi-blade coordinates.
    sensors
        Sensors or names of channels; by default the turbine's, or else the record's accelerometers.
    turbine
        Its sensors are used, and its modes are named where one is near.
    bands
        (lowest, highest) [Hz]; found from the spectra where none are given.
    section
        Start and end [s].

    Raises
    ------
    ConfigurationError, RecordError
        If there is nothing to analyse, or a channel cannot be used.
    """
    begun = time.process_time()
    say = progress or (lambda _: None)
    whole = as_record(record)
    used = whole.section(*section) if section is not None else whole
    machine = None if turbine is None else as_turbine(turbine)
    if sensors is None and machine is not None:
        sensors = [sensor for sensor in machine.sensors if sensor.channel in used] or None
    say("lines and multi-blade coordinates")
    readings = prepare_readings(used, sensors)
    frequency, values = transforms(readings)
    step = float(frequency[1])
    if bands is None:
        say("spectral peaks")
        seen = [
            peak._replace(alone=_is_hump(peak, readings))
            for peak in find_peaks(frequency, values, readings.low, readings.high)
        ]
        wanted = group_peaks(seen, step, readings.low, readings.high)
    else:
        seen = []
        wanted = [_checked_band(band, readings, step) for band in bands]
    found: list[BandFit] = []
    for low, high, count in wanted:
        say(f"{low:.4g} … {high:.4g} Hz")
        most = count if bands is None else MOST_MODES
        found.append(fit_between(frequency, values, readings, low, high, count, most))
    for again in range(AGAIN if bands is None else 0):
        say("bands around what was found")
        found = search_again(found, frequency, values, readings, [] if again else seen, keep=again > 0)
    empty = [
        (low, high)
        for (low, high, _), one in zip(wanted, found, strict=False)
        if bands is not None and not _modes_inside(one, 1.0 / step)
    ]
    say("checks")
    middle = readings.samples // 2
    halves = [transforms(readings, part) for part in (slice(0, middle), slice(readings.samples - middle, None))]
    described = _without_flanks([_described(one, halves, readings) for one in found if _modes_of(one)])
    modes = sorted((mode for band in described for mode in _with_neighbours(band)), key=lambda mode: mode.frequency)
    named = _with_references(_named(modes, readings), machine, readings)
    level = _level(values)
    return OperationalModes(
        record=whole.name,
        section=(float(readings.used.time[0]), float(readings.used.time[-1])),
        rate=readings.rate,
        samples=readings.samples,
        channels=readings.names,
        units=tuple(
            _acceleration_unit(unit, order) for unit, order in zip(readings.units, readings.orders, strict=True)
        ),
        sensors=readings.sensors,
        modes=tuple(named),
        lines=tuple((line.name, line.frequency) for line in readings.lines),
        empty=tuple(empty),
        frequency=frequency,
        level=level,
        bands=tuple(_drawn(one) for one in found if _modes_inside(one, readings.samples / readings.rate)),
        rotor_hz=readings.rotor_hz,
        doubts=readings.doubts,
        notes=readings.notes,
        elapsed=time.process_time() - begun,
        start=whole.start,
    )


def _checked_band(band: tuple[float, float], readings: Readings, step: float) -> tuple[float, float, int]:
    low, high = band
    if not (0.0 < low < high < 0.5 * readings.rate):
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected two rising frequencies between 0 and {0.5 * readings.rate:.4g} Hz, "
            f"half the sampling rate"
        )
    if high - low < 16.0 * step:
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected {16 * step:.3g} Hz of width at least in a record of {1 / step:.4g} "
            f"s; widen it"
        )
    return low, high, 1


def fit_between(
    frequency: Array,
    values: Complex,
    readings: Readings,
    low: float,
    high: float,
    count: int,
    most: int,
    known: Sequence[tuple[float, float]] = (),
) -> BandFit:
    """The modes of one band, its lines left out; `known` are modes to begin with, as `fit_band` has them."""
    inside = (frequency >= low) & (frequency <= high)
    for line in readings.lines:
        off = np.abs(frequency - line.frequency)
        if off[inside].size and off[inside].min() < line.half_width and inside.sum() > 16:
            inside &= off > line.half_width
    bins = np.flatnonzero(inside)
    return fit_band(values[bins], bins, readings.samples, readings.rate, count, most, known)


def _modes_of(found: BandFit) -> int:
    return len(found.fit.modes.frequency) if found.against_none > LEAST_EVIDENCE else 0


def _modes_inside(found: BandFit, length: float) -> int:
    """How many modes of a band are inside it."""
    return sum(not is_flank(found, j, length) for j in range(_modes_of(found)))


def search_again(
    found: Sequence[BandFit],
    frequency: Array,
    values: Complex,
    readings: Readings,
    peaked: Sequence[Peak],
    *,
    keep: bool,
) -> list[BandFit]:
    """Bands around the modes that were found, and around `peaked` frequencies where none was; bands that are where they
    should be stay where `keep` says so.

    A band with one peak of its own may hold the flank of a louder mode: the first search then finds that one.
    """
    step = float(frequency[1])
    peaks: list[Peak] = []
    for one in found:
        if _modes_of(one):
            for j, (f, z) in enumerate(zip(one.fit.modes.frequency, one.fit.modes.damping, strict=True)):
                if not is_flank(one, j, 1.0 / step):
                    peak = Peak(float(f), float(max(z * f, 0.5 * step)), one.against_none)
                    peaks.append(peak._replace(alone=_is_hump(peak, readings)))
    modes = {peak.frequency for peak in peaks}
    peaks += [
        peak
        for peak in peaked
        if all(abs(peak.frequency - p.frequency) > 2.0 * max(peak.half_width, p.half_width) for p in peaks)
    ]
    single: list[Peak] = []
    for peak in sorted(peaks):
        if single and peak.frequency - single[-1].frequency < 0.3 * min(peak.half_width, single[-1].half_width):
            single[-1] = max(peak, single[-1], key=lambda p: p.rise)
        else:
            single.append(peak)
    again = []
    for low, high, count in group_peaks(single, step, readings.low, readings.high):
        same = keep and [one for one in found if _is_same(one, low, high, count, 1.0 / step)]
        known = [
            (peak.frequency, peak.half_width / peak.frequency)
            for peak in single
            if peak.frequency in modes and low < peak.frequency < high
        ]
        one = same[0] if same else fit_between(frequency, values, readings, low, high, count, MOST_MODES, known)
        if known and not _modes_inside(one, 1.0 / step):  # too narrow to tell: neighbours' flanks are let in
            inside = [peak for peak in single if low < peak.frequency < high]
            low, high = widened(inside, [peak for peak in single if peak not in inside], low, high, step)
            one = fit_between(frequency, values, readings, low, high, count, MOST_MODES, known)
        again.append(one)
    return again


def _is_hump(peak: Peak, readings: Readings) -> bool:
    """Whether a peak stands on a harmonic of the rotor: the wind that blades sample, which shares no band with a
    mode."""
    n = round(peak.frequency / readings.rotor_hz) if readings.rotor_hz else 0
    return n > 0 and abs(peak.frequency - n * readings.rotor_hz) < max(HUMP * peak.frequency, 1.5 * peak.half_width)


def _is_same(found: BandFit, low: float, high: float, count: int, length: float) -> bool:
    first, last = found.band.frequency[[0, -1]]
    return _modes_inside(found, length) == count and max(abs(first - low), abs(last - high)) < MOVED * (high - low)


def _described(found: BandFit, halves: Sequence[tuple[Array, Complex]], readings: Readings) -> list[OperationalMode]:
    """The modes of a band with their shapes and doubts."""
    shapes = full_shapes(found)
    both = half_fits(found, halves, readings.samples, readings.rate)
    fit, described = found.fit, []
    length = readings.samples / readings.rate
    for j in range(len(fit.modes.frequency)):
        if is_flank(found, j, length):
            continue
        f, z = float(fit.modes.frequency[j]), float(fit.modes.damping[j])
        std_f, std_z = fit.std(j)
        described.append(
            OperationalMode(
                name="",
                frequency=f,
                frequency_std=f * std_f,
                damping=z,
                ln_damping_std=std_z,
                shape=shapes.shape[:, j],
                shape_std=shapes.std[:, j],
                load=float(shapes.load[j]),
                ln_load_std=float(shapes.load_std[j]),
                band=(float(found.band.frequency[0]), float(found.band.frequency[-1])),
                doubts=tuple(mode_doubts(found, j, shapes.responses[:, j], both, readings)),
            )
        )
    return described


def _without_flanks(bands: list[list[OperationalMode]]) -> list[list[OperationalMode]]:
    """Modes band by band; one at the border of its band that another band's mode reaches is that one's flank."""

    def reach(mode: OperationalMode) -> float:
        return FLANK * mode.damping * mode.frequency

    kept = []
    for band in bands:
        others = [mode for other in bands if other is not band for mode in other if AT_BORDER not in mode.doubts]
        kept.append(
            [
                mode
                for mode in band
                if AT_BORDER not in mode.doubts
                or all(abs(mode.frequency - other.frequency) > reach(mode) + reach(other) for other in others)
            ]
        )
    return kept


def _with_neighbours(modes: list[OperationalMode]) -> list[OperationalMode]:
    """Modes of one band: where one is doubtful the others are, since they were found together."""
    doubtful = [mode for mode in modes if mode.doubts]
    if not doubtful:
        return modes
    why = f"it was found together with a doubtful one at {doubtful[0].frequency:.4g} Hz"
    return [mode if mode.doubts else replace(mode, doubts=(why,)) for mode in modes]


def _named(modes: Sequence[OperationalMode], readings: Readings) -> list[OperationalMode]:
    """Modes with names: numbers, or where a rotor turns what moves and which way it turns."""
    if not any(name.startswith("blades_") for name in readings.names):
        return [replace(mode, name=f"mode {i}") for i, mode in enumerate(modes, start=1)]
    known: dict[str, int] = {}
    named = []
    for mode in modes:
        name = _what_moves(np.abs(mode.shape), readings.names)
        known[name] = known.get(name, 0) + 1
        named.append(replace(mode, name=name if known[name] == 1 else f"{name} {known[name]}"))
    return named


def _what_moves(size: Array, names: Sequence[str]) -> str:
    on_blades = np.array([name.startswith("blades_") for name in names])
    support = size[~on_blades].max(initial=0.0)
    if support * BLADES_MOVE > size[on_blades].max(initial=0.0):
        return " ".join(names[int(np.argmax(np.where(on_blades, -1.0, size)))].split("_")[:2])
    what, _, way = names[int(np.argmax(np.where(on_blades, size, -1.0)))].removeprefix("blades_").rpartition(" ")
    return f"{'flap' if re.search('flap|out', what) else 'lag'} {way}"


def _with_references(
    modes: list[OperationalMode], machine: Turbine | None, readings: Readings
) -> list[OperationalMode]:
    """Modes with the turbine file's frequencies beside them, each used once, the nearest first."""
    if machine is None:
        return modes
    expected = expected_modes(machine, 2.0 * np.pi * readings.rotor_hz)
    pairs = sorted(
        (abs(mode.frequency / f - 1.0), i, k) for i, mode in enumerate(modes) for k, (_, f, _) in enumerate(expected)
    )
    taken: set[int] = set()
    for off, i, k in pairs:
        if off < NEAR_REFERENCE and modes[i].reference is None and k not in taken:
            name, f, z = expected[k]
            modes[i] = replace(modes[i], name=name, reference=(f, z))
            taken.add(k)
    return modes


def _drawn(found: BandFit) -> BandSpectrum:
    measured = np.einsum("kii->k", found.band.power).real
    fitted = np.einsum("kii->k", spectrum(found.fit.modes, found.band)).real
    return BandSpectrum(found.band.frequency, measured, fitted)


def _level(values: Complex) -> Array:
    """The channels' spectra (F,), scaled to the same median and added."""
    power = np.abs(values) ** 2
    return np.asarray((power / np.maximum(np.median(power, axis=0), 1e-300)).mean(axis=1))


def _acceleration_unit(unit: str, order: int) -> str:
    return (
        unit
        if order == 2
        else {"m": "m/s^2", "rad": "rad/s^2", "m/s": "m/s^2", "rad/s": "rad/s^2"}.get(
            unit, f"{unit}/s{'^2' if order == 0 else ''}"
        )
    )
