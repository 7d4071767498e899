"""Joint modes of several records of one structure in one state, with sensors that may move between setups.

Each record is analysed alone. Modes that are alike form tracks (`mode_tracking`), bands are placed around these, and in
each band the modes of all records are fitted jointly: log-likelihoods add, frequencies and damping ratios are common,
shapes and load levels are each record's own (`modal_bands.scoring.score_together`). Shapes are then merged over the
sensors that records have in common (`shape_merging`).

A χ² test of the scatter of the records' own estimates decides whether they are of one state; if not, the mode is not
trusted.
"""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Complex
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.errors import ConfigurationError
from windsysid.modal.shape_merging import MergedShape, Ratios, merge_shapes
from windsysid.modal.shapes import assurance
from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.modal_bands.check import fit_doubts, shape_doubts
from windsysid.spectral.modal_bands.correlated_loads import are_shared
from windsysid.spectral.modal_bands.model_order import BandFit, full_shapes, principal_directions
from windsysid.spectral.modal_bands.peak_bands import Peak, group_peaks
from windsysid.spectral.modal_bands.scoring import ModalFit, score_together
from windsysid.spectral.modal_bands.start import modes_at
from windsysid.spectral.oma.assemble import RecordAnalysis, drawn, result_of
from windsysid.spectral.oma.describe import mode_of
from windsysid.spectral.oma.duplicate_records import find_duplicates
from windsysid.spectral.oma.limits import JOINT_STEPS, MIN_SHAPE_ASSURANCE
from windsysid.spectral.oma.mode import Doubt, DoubtKind, OperationalMode
from windsysid.spectral.oma.mode_tracking import Seen, follow_modes
from windsysid.spectral.oma.result import OperationalModes, RecordModes
from windsysid.spectral.oma.search import band_bins, covered_note, is_rotational_peak
from windsysid.spectral.oma.sensors import ModalSensor
from windsysid.spectral.transforms.dft import band_data
from windsysid.spectral.transforms.limits import MIN_BAND_BINS

__all__ = ["common_sensors", "join"]

DOUBTS_OF_A_RECORD: tuple[DoubtKind, ...] = ("scores", "image", "load", "background")
"""Kinds of doubts about a mode in one record that also concern the joint mode."""

Track: TypeAlias = dict[int, int]
"""A joint mode: the number of its mode in each record that has it, {record: mode}."""

_T = TypeVar("_T", bound=Hashable)


class _Sensors(NamedTuple):
    """Sensors of all records: names, units, sensors, and the indices of each record's channels among them."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[ModalSensor | None, ...]
    places: tuple[NDArray[np.int64], ...]


class _Setups(NamedTuple):
    """Records that are analysed jointly: the analysis and the result of each, and the sensors of all."""

    singles: list[RecordAnalysis]
    results: list[OperationalModes]
    sensors: _Sensors

    def modes_of(self, track: Track) -> list[OperationalMode]:
        """Modes of a track, record by record."""
        return [self.singles[s].modes[j] for s, j in track.items()]


class _Joint(NamedTuple):
    """Joint modes with their tracks, the bands that were fitted, those without enough bins, and tracks left out."""

    modes: list[tuple[OperationalMode, Track]]
    bands: list[list[BandFit]]
    covered: list[tuple[float, float]]
    left_out: list[Track]


def join(singles: Sequence[RecordAnalysis]) -> OperationalModes:
    """Find the modes that records have in common, without names.

    Raises
    ------
    ConfigurationError
        If the records are not connected by common sensors, or one sensor has different units.
    """
    results = [result_of(single) for single in singles]
    setups = _Setups([_without_doubtful_shapes(single) for single in singles], results, common_sensors(results))
    tracks = follow_modes(_observed_modes(setups))
    joint = _Joint([], [], [], [track for track in tracks if not _is_mode(track, setups)])
    for low, high, group in _groups([track for track in tracks if track not in joint.left_out], setups):
        fits = _fit_jointly(setups, group, (low, high))
        if fits is None:
            joint.covered.append((low, high))
            continue
        joint.bands.append(fits)
        joint.modes.extend((_described(fits, j, track, setups), track) for j, track in enumerate(group))
    joint.modes.sort(key=lambda pair: pair[0].frequency.estimate)
    return _result(setups, joint)


def _without_doubtful_shapes(single: RecordAnalysis) -> RecordAnalysis:
    """Remove modes that may be none: they would be taken for those of other records."""
    return single._replace(modes=tuple(mode for mode in single.modes if not mode.doubted_for("shape")))


def common_sensors(results: Sequence[OperationalModes]) -> _Sensors:
    """Sensors of all records; two are the same if position and direction are, or else if channels are."""
    known: dict[Hashable, int] = {}
    names: list[str] = []
    units: list[str] = []
    sensors: list[ModalSensor | None] = []
    places: list[NDArray[np.int64]] = []
    for number, result in enumerate(results, start=1):
        place = []
        for name, unit, sensor in zip(result.channels, result.units, result.sensors, strict=True):
            at = known.setdefault(_sensor_key(name, sensor), len(names))
            if at == len(names):
                names.append(name if name not in names else f"{name} ({number})")
                units.append(unit)
                sensors.append(sensor)
            elif units[at] != unit:
                raise ConfigurationError(
                    f"channel '{name}' reads {unit} in {result.record} and {units[at]} in an earlier record: "
                    "one mapping for both?"
                )
            place.append(at)
        if places and not np.isin(place, np.concatenate(places)).any():
            raise ConfigurationError(
                f"{result.record} has no sensor in common with the records before it: expected reference sensors; name "
                "them alike or give positions"
            )
        places.append(np.array(place, dtype=np.int64))
    return _Sensors(tuple(names), tuple(units), tuple(sensors), tuple(places))


def _sensor_key(name: str, sensor: ModalSensor | None) -> Hashable:
    """Position and direction of a sensor, or the name of its channel if one of them is unknown."""
    if sensor is None or sensor.direction is None or sensor.position is None:
        return name
    return sensor.position, sensor.direction


def _observed_modes(setups: _Setups) -> list[list[Seen]]:
    """Modes of each record, with shapes in the sensors of all records."""
    observed = []
    for single, place in zip(setups.singles, setups.sensors.places, strict=True):
        modes = []
        for mode in single.modes:
            shape: Complex = np.full(len(setups.sensors.names), np.nan, dtype=np.complex128)
            shape[place] = mode.shape
            modes.append(Seen(mode.frequency.estimate, shape))
        observed.append(modes)
    return observed


def _is_mode(track: Track, setups: _Setups) -> bool:
    """True if half of the records have it, or it is trusted in one of them."""
    return 2 * len(track) >= len(setups.singles) or any(mode.trusted for mode in setups.modes_of(track))


def _groups(tracks: Sequence[Track], setups: _Setups) -> list[tuple[float, float, list[Track]]]:
    """Bands (lowest, highest) around modes, and the tracks in each."""
    singles = setups.singles
    step = max(single.found.spectrum.step for single in singles)
    low = max(single.readings.low for single in singles)
    high = min(single.readings.high for single in singles)
    peaks = [(_peak_of(track, setups), track) for track in tracks]
    usable = sorted((pair for pair in peaks if low < pair[0].frequency < high), key=lambda pair: pair[0].frequency)
    found, first = [], 0
    for start, end, count in group_peaks([peak for peak, _ in usable], step, low, high):
        found.append((start, end, [track for _, track in usable[first : first + count]]))
        first += count
    return found


def _peak_of(track: Track, setups: _Setups) -> Peak:
    """Peak at the median frequency of a track, with the median damping ratio."""
    modes = setups.modes_of(track)
    f = float(np.median([mode.frequency.estimate for mode in modes]))
    peak = Peak(f, float(np.median([mode.damping_ratio.estimate for mode in modes])) * f, 0.0)
    return peak._replace(alone=any(is_rotational_peak(peak, single.readings) for single in setups.singles))


def _fit_jointly(setups: _Setups, group: Sequence[Track], limits: tuple[float, float]) -> list[BandFit] | None:
    """Fit the modes of one band in all records; None if sinusoids leave too few bins in one of them."""
    known = [_start_of(setups.modes_of(track)) for track in group]
    fits = []
    for single in setups.singles:
        bins = band_bins(single.found.spectrum, limits)
        if len(bins) < MIN_BAND_BINS:
            return None
        values = single.found.spectrum.values[bins]
        directions, back = principal_directions(values, min(values.shape[1], len(group) + 2))
        band = band_data(values @ back.T, bins, single.readings.samples, single.readings.rate)
        fits.append((band, values, bins, directions))
    bands = [band for band, *_ in fits]
    joint = score_together([modes_at(known, band) for band in bands], bands, max_steps=JOINT_STEPS)
    own: Sequence[ModalFit | None] = [None] * len(joint)
    if any(map(are_shared, joint, bands)):
        own, start = joint, [fit.modes.let_drift() for fit in joint]
        joint = score_together(start, bands, max_steps=JOINT_STEPS)
    return [
        BandFit(fit, band, values, bins, directions, 0.0, before, _is_crowded(single, limits))
        for single, fit, before, (band, values, bins, directions) in zip(setups.singles, joint, own, fits, strict=True)
    ]


def _is_crowded(single: RecordAnalysis, limits: tuple[float, float]) -> bool:
    """True if a record has more modes than are fitted together in a band between frequencies [Hz]."""
    crowded = [one.band.frequency for one in single.found.bands if one.crowded]
    return any(frequency[0] < limits[1] and frequency[-1] > limits[0] for frequency in crowded)


def _start_of(modes: Sequence[OperationalMode]) -> tuple[float, float]:
    """Weighted mean of the frequency and median of the damping ratio of one mode in several records."""
    weight = np.array([mode.frequency.std**-2.0 for mode in modes])
    f = float(weight @ [mode.frequency.estimate for mode in modes] / weight.sum())
    return f, float(np.median([mode.damping_ratio.estimate for mode in modes]))


def _described(fits: Sequence[BandFit], j: int, track: Track, setups: _Setups) -> OperationalMode:
    """Mode j of a band in all sensors, with its doubts."""
    doubts: list[Doubt] = []
    each = []
    for number, (fit, single) in enumerate(zip(fits, setups.singles, strict=True)):
        shapes = full_shapes(fit)
        alone = single.modes[track[number]].grounds if number in track else ()
        own = fit_doubts(fit, j, single.readings) + [one for one in alone if one.kind in DOUBTS_OF_A_RECORD]
        doubts += [one._replace(text=f"{single.record.name}: {one.text}") for one in own]
        each.append(mode_of(fit, j, shapes, ()))
    if 2 * len(track) < len(fits):
        doubts.append(Doubt("records", f"only {len(track)} of {len(fits)} records show it by themselves"))
    doubts += _disagreement(track, setups)
    ratios = [_ratios_of(mode, place) for mode, place in zip(each, setups.sensors.places, strict=True)]
    merged = merge_shapes(ratios, len(setups.sensors.names))
    doubts += _shape_disagreement(merged, ratios)
    scatter = max(1.0, merged.misfit / merged.freedom) if merged.freedom > 0 else 1.0
    variance, n = np.diagonal(merged.cov), len(merged.shape)
    std = np.sqrt(0.5 * scatter * np.maximum(variance[:n] + variance[n:], 0.0))
    load, ln_load_std = _mean_load(each, ratios, merged.shape)
    widening = np.sqrt(np.mean([np.square(mode.widening) for mode in setups.modes_of(track)], axis=0))
    f, z = each[0].frequency, each[0].damping_ratio
    return replace(
        each[0],
        frequency=IntervalEstimate.normal(f.estimate, f.std * float(widening[0]), "Hz"),
        damping_ratio=IntervalEstimate.lognormal(z.estimate, z.relative_std * float(widening[1]), "1"),
        widening=(float(widening[0]), float(widening[1])),
        shape=merged.shape,
        shape_std=std,
        shape_cov=scatter * merged.cov,
        load=load,
        ln_load_std=ln_load_std,
        grounds=(*doubts, *shape_doubts(std)),
    )


def _ratios_of(mode: OperationalMode, place: NDArray[np.int64]) -> Ratios:
    assert mode.shape_cov is not None
    return Ratios(place, mode.shape, mode.shape_cov)


def _shape_disagreement(merged: MergedShape, ratios: Sequence[Ratios]) -> list[Doubt]:
    """Doubt a shape if those of the records scatter more than their uncertainty, and one of them is not alike."""
    if merged.freedom <= 0 or _chi2_probability(merged.misfit, merged.freedom) >= FALSE_ALARM_PROBABILITY:
        return []
    alike = min(assurance(merged.shape[one.place], one.ratio) for one in ratios)
    if alike >= MIN_SHAPE_ASSURANCE:
        return []
    text = f"χ² {merged.misfit:.3g} for {merged.freedom}, one is only {alike:.2f} alike (MAC)"
    return [Doubt("records", f"the records disagree in shape: {text}")]


def _disagreement(track: Track, setups: _Setups) -> list[Doubt]:
    """Doubt a mode if the estimates of the records alone scatter more than their uncertainty."""
    modes = setups.modes_of(track)
    doubts = []
    for name, each in (("frequency", [m.frequency for m in modes]), ("damping", [m.damping_ratio for m in modes])):
        values, stds = np.log([one.estimate for one in each]), np.array([one.relative_std for one in each])
        weight = stds**-2.0
        off = values - weight @ values / weight.sum()
        square = float(weight @ off**2)
        if len(modes) > 1 and _chi2_probability(square, len(modes) - 1) < FALSE_ALARM_PROBABILITY:
            worst = setups.results[list(track)[int(np.argmax(np.abs(off) * np.sqrt(weight)))]].record
            text = f"χ² {square:.3g} for {len(modes) - 1}, {worst} most: not one state; compare them instead"
            doubts.append(Doubt("records", f"the records disagree in {name}: {text}"))
    return doubts


def _chi2_probability(square: float, freedom: int) -> float:
    """Probability of a larger value of χ²."""
    from scipy.special import chdtrc

    return float(chdtrc(freedom, square))


def _mean_load(each: Sequence[OperationalMode], ratios: Sequence[Ratios], shape: Complex) -> tuple[float, float]:
    """Geometric mean of the records' load levels, for the merged shape, and the standard deviation of its logarithm."""
    logs = []
    for mode, one in zip(each, ratios, strict=True):
        largest = one.place[int(np.argmax(np.abs(one.ratio)))]
        logs.append(np.log(max(mode.load, 1e-300)) - 2.0 * np.log(max(float(np.abs(shape[largest])), 1e-12)))
    return float(np.exp(np.mean(logs))), float(np.sqrt(np.mean([m.ln_load_std**2 for m in each]) / len(each)))


def _result(setups: _Setups, joint: _Joint) -> OperationalModes:
    """Result of all records; parts that only one record has, such as spectra for the figure, are those of the first."""
    results, sensors = setups.results, setups.sensors
    return replace(
        results[0],
        record=", ".join(result.record for result in results),
        rate=min(result.rate for result in results),
        samples=sum(result.samples for result in results),
        channels=sensors.names,
        units=sensors.units,
        sensors=sensors.sensors,
        modes=tuple(mode for mode, _ in joint.modes),
        lines=_union(result.lines for result in results),
        empty=_union(result.empty for result in results),
        bands=tuple(drawn(fits[0]) for fits in joint.bands),
        rotor_hz=float(np.mean([result.rotor_hz for result in results])),
        doubts=(*find_duplicates(setups.singles), *_by_record(results, "doubts")),
        notes=tuple(_notes(setups, joint)),
        parts=tuple(_record_modes(setups, joint)),
        findings=_union(result.findings for result in results),
        record_hash=None,
    )


def _union(collections: Iterable[Iterable[_T]]) -> tuple[_T, ...]:
    """Elements of all collections, each once, in their order."""
    return tuple(dict.fromkeys(one for collection in collections for one in collection))


def _by_record(results: Sequence[OperationalModes], field: str) -> list[str]:
    """Sentences of all records, each with the name of its record."""
    return [f"{result.record}: {text}" for result in results for text in getattr(result, field)]


def _notes(setups: _Setups, joint: _Joint) -> list[str]:
    notes = _by_record(setups.results, "notes")
    if joint.left_out:
        first = [next(iter(track.items())) for track in joint.left_out]
        seen = ", ".join(
            f"{setups.singles[s].modes[j].frequency.estimate:.4g} Hz ({setups.results[s].record})" for s, j in first
        )
        notes.append(f"seen in fewer than half of the records, never trusted, and left out: {seen}")
    return [*notes, *map(covered_note, joint.covered)]


def _record_modes(setups: _Setups, joint: _Joint) -> list[RecordModes]:
    """Modes of each record, in the order of the joint modes."""
    parts = []
    for s, (single, one) in enumerate(zip(setups.singles, setups.results, strict=True)):
        modes = tuple(single.modes[track[s]] if s in track else None for _, track in joint.modes)
        parts.append(
            RecordModes(one.record, one.start, one.section, one.rate, one.samples, modes, one.notes, one.channels)
        )
    return parts
