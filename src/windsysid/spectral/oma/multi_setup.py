"""Several records of one structure in one state: its modes have one frequency and one damping ratio in all of them.

Each record is analysed alone. Modes that are alike are tracks (`association`), bands are placed around these, and in
each band the modes of all records are sought together: likelihoods add, shapes and levels are each record's own
(`modal_scoring.score_together`). Shapes are then merged over the sensors that records have in common
(`shape_merging`). Sensors may be the same in all records, or move from one setup to the next but for some of reference.

Whether it was one state is tested: the estimates of the records alone scatter about their mean as χ², or they do not,
and then the mode is not trusted.
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.spectral.modal_bands.check import fit_doubts, shape_doubts
from windsysid.spectral.modal_bands.correlated_loads import are_shared
from windsysid.spectral.modal_bands.model_order import BandFit, full_shapes, principal_directions
from windsysid.spectral.modal_bands.peak_bands import Peak, group_peaks
from windsysid.spectral.modal_bands.scoring import Fit, score_together
from windsysid.spectral.modal_bands.start import modes_at
from windsysid.spectral.oma.assemble import Single, drawn, result_of
from windsysid.spectral.oma.describe import mode_of, with_neighbours
from windsysid.spectral.oma.duplicate_records import find_repeated
from windsysid.spectral.oma.mode_tracking import Seen, assurance, follow_modes
from windsysid.spectral.oma.result import Doubt, DoubtKind, OperationalMode, OperationalModes, Part
from windsysid.spectral.oma.search import MIN_BINS, band_bins, covered_note, is_hump
from windsysid.spectral.oma.sensors import ModalSensor
from windsysid.spectral.oma.shape_merging import Ratios, merge_shapes
from windsysid.spectral.transforms.dft import band_data

__all__ = ["join"]

UNLIKELY = 1e-3
"""Probability of a scatter of the records as large, below which they are not of one state."""

LEAST_ALIKE = 0.95
"""Modal assurance criterion below which shapes that scatter too much are not one shape."""

JOINT_STEPS = 120

OF_A_RECORD: tuple[DoubtKind, ...] = ("channels", "halves", "shared", "image")
"""Doubts of one record alone that more records do not answer."""


class _Sensors(NamedTuple):
    """The sensors of all records: names, units, sensors, and where each record's channels are among them."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[ModalSensor | None, ...]
    places: tuple[NDArray[np.int64], ...]


def join(singles: Sequence[Single]) -> OperationalModes:
    """The modes that records have in common, without names.

    Raises
    ------
    ConfigurationError
        If the records are not connected by sensors in common, or read different things by them.
    """
    results = [result_of(single) for single in singles]
    singles = [  # what may be no mode would take the place of one
        single._replace(modes=tuple(mode for mode in single.modes if not mode.doubted_for("shape")))
        for single in singles
    ]
    sensors = _all_sensors(results)
    seen = [
        [Seen(mode.frequency, _spread(mode.shape, place, len(sensors.names))) for mode in single.modes]
        for single, place in zip(singles, sensors.places, strict=True)
    ]
    tracks = follow_modes(seen)
    kept = [track for track in tracks if _is_mode(track, singles)]
    left = [track for track in tracks if track not in kept]
    modes: list[tuple[OperationalMode, dict[int, int]]] = []
    bands, covered = [], []
    for low, high, group in _groups(kept, singles):
        fits = _together(singles, group, low, high)
        if fits is None:
            covered.append((low, high))
            continue
        bands.append(drawn(fits[0]))
        described = [_described(fits, j, track, singles, sensors) for j, track in enumerate(group)]
        modes += zip(with_neighbours(described), group, strict=True)
    modes.sort(key=lambda pair: pair[0].frequency)
    whole = _result(singles, results, sensors, modes, left)
    notes = [*whole.notes, *(covered_note(band) for band in covered)]
    return replace(whole, bands=tuple(bands), notes=tuple(notes), doubts=(*find_repeated(singles), *whole.doubts))


def _all_sensors(results: Sequence[OperationalModes]) -> _Sensors:
    """Sensors as they come; the same where position and direction are, or else where channels are."""
    known: dict[Hashable, int] = {}
    names: list[str] = []
    units: list[str] = []
    sensors: list[ModalSensor | None] = []
    places = []
    for number, result in enumerate(results, start=1):
        place = []
        for name, unit, sensor in zip(result.channels, result.units, result.sensors, strict=True):
            at = None if sensor is None or sensor.direction is None else sensor.position
            key: Hashable = name if sensor is None or at is None else (at, sensor.direction)
            if key not in known:
                known[key] = len(names)
                names.append(name if name not in names else f"{name} ({number})")
                units.append(unit)
                sensors.append(sensor)
            elif units[known[key]] != unit:
                raise ConfigurationError(
                    f"channel '{name}' reads {unit} in {result.record} and {units[known[key]]} in an earlier record: "
                    "one mapping for both?"
                )
            place.append(known[key])
        places.append(np.array(place, dtype=np.int64))
        if number > 1 and not np.isin(places[-1], np.concatenate(places[:-1])).any():
            raise ConfigurationError(
                f"{result.record} has no sensor in common with the records before it: expected reference sensors; name "
                "them alike or give positions"
            )
    return _Sensors(tuple(names), tuple(units), tuple(sensors), tuple(places))


def _spread(shape: Complex, place: NDArray[np.int64], sensors: int) -> Complex:
    whole = np.full(sensors, np.nan, dtype=np.complex128)
    whole[place] = shape
    return whole


def _is_mode(track: dict[int, int], singles: Sequence[Single]) -> bool:
    """Whether half of the records show it, or one of them trusts it."""
    return 2 * len(track) >= len(singles) or any(singles[s].modes[j].trusted for s, j in track.items())


def _groups(
    tracks: Sequence[dict[int, int]], singles: Sequence[Single]
) -> list[tuple[float, float, list[dict[int, int]]]]:
    """Bands (lowest, highest) around modes, and the tracks in each."""
    peaks = []
    for track in tracks:
        of = [singles[s].modes[j] for s, j in track.items()]
        f = float(np.median([mode.frequency for mode in of]))
        peak = Peak(f, float(np.median([mode.damping for mode in of])) * f, 0.0)
        peaks.append(peak._replace(alone=any(is_hump(peak, single.readings) for single in singles)))
    order = sorted(range(len(peaks)), key=lambda i: peaks[i].frequency)
    step = max(float(single.found.frequency[1]) for single in singles)
    low = max(single.readings.low for single in singles)
    high = min(single.readings.high for single in singles)
    usable = [i for i in order if low < peaks[i].frequency < high]
    found, first = [], 0
    for start, end, count in group_peaks([peaks[i] for i in usable], step, low, high):
        found.append((start, end, [tracks[i] for i in usable[first : first + count]]))
        first += count
    return found


def _together(
    singles: Sequence[Single], group: Sequence[dict[int, int]], low: float, high: float
) -> list[BandFit] | None:
    """Fit the modes of one band in all records; None if lines leave too few bins in one of them."""
    known = []
    for track in group:
        of = [singles[s].modes[j] for s, j in track.items()]
        weight = np.array([mode.frequency_std**-2.0 for mode in of])
        f = float(weight @ [mode.frequency for mode in of] / weight.sum())
        known.append((f, float(np.median([mode.damping for mode in of]))))
    parts = []
    for single in singles:
        bins = band_bins(single.found.frequency, single.readings, low, high)
        if len(bins) < MIN_BINS:
            return None
        values = single.found.values[bins]
        directions, back = principal_directions(values, min(values.shape[1], len(group) + 2))
        band = band_data(values @ back.T, bins, single.readings.samples, single.readings.rate)
        parts.append((band, values, bins, directions))
    starts = [modes_at(known, band) for band, *_ in parts]
    bands = [band for band, *_ in parts]
    fits: list[Fit] = score_together(starts, bands, max_steps=JOINT_STEPS)
    plain: Sequence[Fit | None] = [None] * len(fits)
    if any(map(are_shared, fits, bands)):
        plain = fits
        fits = score_together([fit.modes.let_drift() for fit in fits], bands, max_steps=JOINT_STEPS)
    return [
        BandFit(fit, band, values, bins, directions, 0.0, before)
        for fit, before, (band, values, bins, directions) in zip(fits, plain, parts, strict=True)
    ]


def _described(
    fits: Sequence[BandFit], j: int, track: dict[int, int], singles: Sequence[Single], sensors: _Sensors
) -> OperationalMode:
    """Mode j of a band in all sensors, and what speaks against it."""
    doubts: list[Doubt] = []
    each = []
    for number, (fit, single) in enumerate(zip(fits, singles, strict=True)):
        shapes = full_shapes(fit)
        alone = single.modes[track[number]].grounds if number in track else ()
        own = fit_doubts(fit, j, shapes, single.readings) + [doubt for doubt in alone if doubt.kind in OF_A_RECORD]
        doubts += [Doubt(kind, f"{single.record.name}: {text}") for kind, text in own]
        each.append(mode_of(fit, j, shapes, ()))
    if 2 * len(track) < len(singles):
        doubts.append(Doubt("records", f"only {len(track)} of {len(singles)} records show it by themselves"))
    doubts += _disagreement(track, singles)
    ratios = [
        Ratios(place, mode.shape, _known(mode.shape_cov)) for place, mode in zip(sensors.places, each, strict=True)
    ]
    merged = merge_shapes(ratios, len(sensors.names))
    scatter = 1.0
    if merged.freedom > 0:
        scatter = max(1.0, merged.misfit / merged.freedom)
        alike = min(assurance(merged.shape[one.place], one.ratio) for one in ratios)
        if _chance(merged.misfit, merged.freedom) < UNLIKELY and alike < LEAST_ALIKE:
            text = f"χ² {merged.misfit:.3g} for {merged.freedom}, one is only {alike:.2f} alike (MAC)"
            doubts.append(Doubt("records", f"the records disagree in shape: {text}"))
    n = len(merged.shape)
    own_std = np.sqrt(0.5 * scatter * np.maximum(np.diagonal(merged.cov)[:n] + np.diagonal(merged.cov)[n:], 0.0))
    doubts += shape_doubts(own_std)
    load, std = _mean_load(each, ratios, merged.shape)
    return replace(
        each[0],
        shape=merged.shape,
        shape_std=own_std,
        shape_cov=scatter * merged.cov,
        load=load,
        ln_load_std=std,
        grounds=tuple(doubts),
    )


def _known(cov: Array | None) -> Array:
    assert cov is not None
    return cov


def _disagreement(track: dict[int, int], singles: Sequence[Single]) -> list[Doubt]:
    """Doubts where the records alone scatter more than their bands say."""
    of = [singles[s].modes[j] for s, j in track.items()]
    told = []
    for what, values, stds in (
        ("frequency", [np.log(m.frequency) for m in of], [m.frequency_std / m.frequency for m in of]),
        ("damping", [np.log(m.damping) for m in of], [m.ln_damping_std for m in of]),
    ):
        weight = np.array(stds) ** -2.0
        off = np.array(values) - weight @ values / weight.sum()
        square = float(weight @ off**2)
        if len(of) > 1 and _chance(square, len(of) - 1) < UNLIKELY:
            worst = singles[list(track)[int(np.argmax(np.abs(off) * np.sqrt(weight)))]].record.name
            how = f"χ² {square:.3g} for {len(of) - 1}, {worst} most"
            told.append(Doubt("records", f"the records disagree in {what}: {how}: not one state; compare them instead"))
    return told


def _chance(square: float, freedom: int) -> float:
    from scipy.special import chdtrc

    return float(chdtrc(freedom, square))


def _mean_load(each: Sequence[OperationalMode], ratios: Sequence[Ratios], shape: Complex) -> tuple[float, float]:
    """The mean level of the records' loads, for the merged shape, and the standard deviation of its logarithm."""
    logs = []
    for mode, one in zip(each, ratios, strict=True):
        largest = one.place[int(np.argmax(np.abs(one.ratio)))]
        logs.append(np.log(max(mode.load, 1e-300)) - 2.0 * np.log(max(float(np.abs(shape[largest])), 1e-12)))
    return float(np.exp(np.mean(logs))), float(np.sqrt(np.mean([m.ln_load_std**2 for m in each]) / len(each)))


def _result(
    singles: Sequence[Single],
    results: Sequence[OperationalModes],
    sensors: _Sensors,
    modes: Sequence[tuple[OperationalMode, dict[int, int]]],
    left: Sequence[dict[int, int]],
) -> OperationalModes:
    """What all records say together."""
    parts = tuple(
        Part(
            result.record,
            result.start,
            result.section,
            result.rate,
            result.samples,
            tuple(single.modes[track[s]] if s in track else None for _, track in modes),
            result.notes,
        )
        for s, (single, result) in enumerate(zip(singles, results, strict=True))
    )
    notes = [f"{result.record}: {note}" for result in results for note in result.notes]
    if left:
        seen = ", ".join(
            f"{singles[s].modes[j].frequency:.4g} Hz ({results[s].record})"
            for s, j in (next(iter(t.items())) for t in left)
        )
        notes.append(f"seen in fewer than half of the records, never trusted, and left out: {seen}")
    first = results[0]
    return replace(
        first,
        record=", ".join(result.record for result in results),
        rate=min(result.rate for result in results),
        samples=sum(result.samples for result in results),
        channels=sensors.names,
        units=sensors.units,
        sensors=sensors.sensors,
        modes=tuple(mode for mode, _ in modes),
        lines=tuple(dict.fromkeys(line for result in results for line in result.lines)),
        empty=tuple(dict.fromkeys(band for result in results for band in result.empty)),
        rotor_hz=float(np.mean([result.rotor_hz for result in results])),
        doubts=tuple(f"{result.record}: {doubt}" for result in results for doubt in result.doubts),
        notes=tuple(notes),
        parts=parts,
        record_hash=None,
    )
