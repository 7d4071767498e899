"""A turning rotor's record in narrow bands around its modes, as a function of the unknowns.

One band holds all modes of the blades, about f in their frame, since unequal blades couple the classes; one each mode
of the support, in the fixed frame. In every band each kind of load has levels of its own (`hump_loads`), and each
reading a disturbance, a level at either end: flap in the tips, second modes, noise.

The support is read at f ± Ω and not at f: there it moves by its roll only, with the blades as they move together, and
how much its sensor shows of that depends on where the roll's axis is, which no turbine file knows well.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.loads.statistics import Statistic
from windsysid.modal.analysis import modes
from windsysid.results.finding import Finding
from windsysid.spectral.rotor.harmonic_transfer import coupled, matrix_harmonics
from windsysid.spectral.rotor.likelihood import SpectrumGrid
from windsysid.spectral.rotor.limits import MAX_HARMONICS
from windsysid.spectral.rotor.model import LiftedModel, finer_bins, taper_weights
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.rotor_bands.channels import ABOUT_BLADES, ABOUT_SUPPORT, Combined, Row, bins_between, combine
from windsysid.spectral.rotor_bands.limits import MAX_LIGHT_DAMPING
from windsysid.spectral.rotor_bands.mode_locations import SEARCH_SIGMAS, WHIRLS, ModeLocation, find_places
from windsysid.spectral.rotor_bands.model import BandModel, RotorBand
from windsysid.spectral.rotor_bands.rotational_sampling import (
    BandSource,
    HumpLoads,
    blade_class,
    hump_terms,
    line_terms,
    one_force,
    wind_of,
)
from windsysid.spectral.transforms.lifted import Complex
from windsysid.spectral.transforms.limits import MIN_BAND_BINS
from windsysid.spectral.transforms.rotating_frame import TurnedSpectra, combine_groups, turned_spectra
from windsysid.turbine.turbine import Turbine

__all__ = [
    "PosedBands", "belongs_in_bands", "centre_bands", "highest_in_bands", "is_lightly_damped", "pose_bands",
    "search_bands",
]  # fmt: skip

BLADES_HALF_WIDTH, SUPPORT_HALF_WIDTH = 0.10, 0.14
"""Setting: relative half-width of the band of a mode of the blades, of the support."""

MIN_HALF_WIDTH_BINS = 5.0
"""Setting: smallest half-width of a band in bins."""

MIN_WIDE_BINS = 2.0
"""Setting: bins in half the half-power width of a mode from which on the effect of the taper's window is taken as
known."""

DISTURBANCE_SHARE = 0.2
"""Setting: prior mean of a row's disturbance over its median power."""

SEARCH_FACTOR = 1.4
"""Setting: factor on the highest frequency of a mode up to which spectra are computed, for bands and backgrounds."""


class PosedBands(NamedTuple):
    """A question in bands.

    Attributes
    ----------
    model
        The spectra as a function of the unknowns.
    start
        Where to begin to look for them (n,).
    places
        Modes that are read, and where.
    combined
        What the rows are combinations of.
    doubts
        What speaks against the places.
    spectra
        The record's.
    """

    model: BandModel
    start: Array
    places: tuple[ModeLocation, ...]
    combined: tuple[Combined, ...]
    doubts: tuple[Finding, ...]
    spectra: TurnedSpectra


def belongs_in_bands(question: RotorQuestion) -> bool:
    """Test whether a periodic rotor is to be read in bands: three blades with the modes of a real
    machine, lightly damped, many turns' harmonics apart or with sensors that read what the model has not."""
    turbine = question.turbine
    rotor_hz = abs(float(question.speed.mean())) / (2.0 * math.pi)
    rotor = turbine.model.rotor
    if rotor is None or rotor.blades != len(WHIRLS) or rotor.lag != "free":
        return False
    highest = max(turbine.natural_frequency(name) for name in rotor.coordinates)
    many = math.ceil(highest / (2.0 * math.pi * rotor_hz)) + 2 > MAX_HARMONICS
    drifts = any(sensor.blade and sensor.drift > 0.0 for sensor in question.sensors)
    return many or drifts or is_lightly_damped(turbine)


def is_lightly_damped(turbine: Turbine) -> bool:
    """Test whether a mode is damped as little as those of a real machine."""
    return any(
        turbine.damping(name) < MAX_LIGHT_DAMPING * turbine.critical_damping(name) for name in turbine.model.coordinates
    )


def highest_in_bands(question: RotorQuestion) -> float:
    """The highest frequency [Hz] that bands look at, with springs as stiff as priors reach."""
    stiff = {q.name: q.centre * math.exp(SEARCH_SIGMAS * q.spread) for q in question.parameters if q.logarithmic}
    p = question.centres
    for name, value in stiff.items():
        p[question.compiled.parameters.index(name)] = value
    rotor_hz = abs(float(question.speed.mean())) / (2.0 * math.pi)
    there = modes(question.turbine.model, question.compiled, p, 2.0 * math.pi * rotor_hz)
    return SEARCH_FACTOR * (max(frequency for _, frequency, _ in there) + 2.0 * rotor_hz)


def search_bands(question: RotorQuestion) -> PosedBands | None:
    """The problem in bands around the modes, which are looked for; None where they cannot be separated.

    Raises
    ------
    RecordError
        If the record is too short for the bands, or no sensor shows a mode.
    """
    spectra, combined = _read(question), combine(question.sensors, len(WHIRLS))
    at_centres = question.centres
    names = question.compiled.parameters

    def frequencies(values: Mapping[str, float]) -> dict[str, float]:
        p = at_centres.copy()
        for name, value in values.items():
            p[names.index(name)] = value
        return {name: frequency for name, (frequency, _) in _modes(question, p, spectra).items()}

    of_file = np.array([question.turbine.values.get(name, 0.0) for name in names])
    ratios = {name: ratio for name, (_, ratio) in _modes(question, of_file, spectra).items()}
    blades = [freedom.name for freedom in question.turbine.model.freedoms if freedom.blade]
    found = find_places(frequencies, ratios, question.parameters, spectra, combined, blades)
    if found is None:
        return None
    posed = pose_bands(question, found.places, spectra)
    start = posed.start.copy()
    start[posed.model.unknowns.of("parameters")] = found.start
    return posed._replace(start=start, doubts=found.doubts)


def pose_bands(
    question: RotorQuestion, places: Sequence[ModeLocation], spectra: TurnedSpectra | None = None, *, width: float = 1.0
) -> PosedBands:
    """The problem in bands around modes whose places are known; `width` makes bands narrower.

    Raises
    ------
    RecordError
        If the record is too short for the bands, or no sensor shows a mode.
    """
    spectra = _read(question) if spectra is None else spectra
    combined = combine(question.sensors, len(WHIRLS))
    builder = _Builder(question, spectra, combined, width)
    of_blades = [place for place in places if place.shape is not None]
    built = [builder.blades(of_blades, places)] if of_blades else []
    built += [builder.support(group, places) for group in _near_each_other(places)]
    if not built:
        raise RecordError("no sensor shows a mode of tower or blades: expected accelerometers on them")
    model = BandModel(tuple(built))
    return PosedBands(model, model.prior[0].copy(), tuple(places), tuple(combined), (), spectra)


def centre_bands(question: RotorQuestion, posed: PosedBands, unknowns: Array) -> PosedBands:
    """Problem with the bands around the modes of the unknowns (n,), so that they do not depend on how a peak was
    found; it starts there."""
    p = question.centres
    theta = unknowns[posed.model.unknowns.of("parameters")].tolist()
    for q, value in zip(question.parameters, theta, strict=True):
        p[question.compiled.parameters.index(q.name)] = float(q.physical(value))
    there = _modes(question, p, posed.spectra)
    hz = posed.spectra.rotor_hz
    places = [
        place._replace(frequency=there[place.name][0] + (place.shape or 0) * hz) if place.name in there else place
        for place in posed.places
    ]
    moved = pose_bands(question, places, posed.spectra)
    return moved._replace(start=moved.model.start_from(unknowns, posed.model), doubts=posed.doubts)


def _read(question: RotorQuestion) -> TurnedSpectra:
    if question.turned is not None:
        return combine_groups(question.turned)
    return turned_spectra(question.readings, question.azimuth, question.rate, 1)


def _modes(question: RotorQuestion, p: Array, spectra: TurnedSpectra) -> dict[str, tuple[float, float]]:
    """Frequency [Hz] and damping ratio of every mode for all parameters (n_p,); of several of a name the slowest."""
    found: dict[str, tuple[float, float]] = {}
    speed = 2.0 * math.pi * spectra.rotor_hz
    for name, frequency, ratio in modes(question.turbine.model, question.compiled, p, speed):
        found.setdefault(name.partition(" (")[0], (frequency, ratio))
    return found


def _near_each_other(places: Sequence[ModeLocation]) -> list[list[ModeLocation]]:
    """Modes of the support by rising frequency, those together whose bands would overlap."""
    groups: list[list[ModeLocation]] = []
    for place in sorted((p for p in places if p.shape is None), key=lambda p: p.frequency):
        if groups and place.frequency < groups[-1][-1].frequency * (1.0 + SUPPORT_HALF_WIDTH):
            groups[-1].append(place)
        else:
            groups.append([place])
    return groups


class _Load(NamedTuple):
    """A load to be: its name and unit, where it pushes, the row that shows it most, and the harmonic whose humps it
    has, or None for a line between two levels."""

    name: str
    unit: str
    placement: Complex
    row: Row
    humps: int | None


class _Builder:
    """The parts of every band's model."""

    def __init__(
        self, question: RotorQuestion, spectra: TurnedSpectra, combined: Sequence[Combined], width: float
    ) -> None:
        self.question, self.spectra, self.combined, self.width = question, spectra, combined, width
        self.weights = np.array([c.weights for c in combined])
        self.freedoms = question.turbine.model.freedoms
        self.pushed = [freedom.name for freedom in self.freedoms if not freedom.blade and freedom.name != "roll"]
        self.given = question.centres
        self.hz, self.duration = spectra.rotor_hz, spectra.duration
        v = question.turbine.values
        self.lever, self.hinge = v["blade_inertia_1"] / v["blade_first_moment_1"], v["hinge_offset"]
        self.wind = wind_of(self.hinge, self.lever, self.hz)

    def blades(self, of_blades: Sequence[ModeLocation], places: Sequence[ModeLocation]) -> RotorBand:
        """The band of all modes of the blades."""
        span = {}
        for place in of_blades:
            reach = self._reach(place.frequency, BLADES_HALF_WIDTH)
            span[place.shape] = (place.frequency - reach, place.frequency + reach)
        ends = np.array(list(span.values()))
        low, high = float(ends.min()), float(ends.max())
        whole: dict[int | None, tuple[float, float]] = {None: (low, high), **span}
        rows = [Row(i, 0, *whole[c.shape]) for i, c in enumerate(self.combined) if c.turns and c.shape in whole]
        loads = [self._on_blades(p or 0, limits, rows) for p, limits in span.items()]
        for place in of_blades:
            if place.shape:  # only whirls shake the hub
                more = self._hub_rows(place, places, span[place.shape])
                rows += more
                loads += self._on_hub(-place.shape, more)
        wide = min(place.ratio * place.frequency for place in of_blades) * self.duration > MIN_WIDE_BINS
        return self._band("blades", bins_between(self.spectra, low, high), ABOUT_BLADES, rows, loads, wide=wide)

    def _on_blades(self, p: int, ends: tuple[float, float], rows: Sequence[Row]) -> _Load:
        """The load on the blades in class p, between two frequencies."""
        row = next((r for r in rows if self.combined[r.combination].shape == p), rows[0])
        kappa = self.question.turbine.values.get("kappa", 0.0)
        push = blade_class(self.freedoms, p, len(WHIRLS), self.lever, self.hinge, kappa)
        return _Load(f"blades_{_WAY[p]}", "N*m/√Hz", push, row._replace(low=ends[0], high=ends[1]), p)

    def _hub_rows(self, place: ModeLocation, places: Sequence[ModeLocation], ends: tuple[float, float]) -> list[Row]:
        """The rows in which the support shows a whirl of the blades."""
        low, high = self._apart(place, places, *ends)
        return [Row(i, -(place.shape or 0), low, high) for i, c in enumerate(self.combined) if not c.turns]

    def _on_hub(self, side: int, rows: Sequence[Row]) -> list[_Load]:
        """The loads on the support at the frequencies of a whirl, if it is read there."""
        if not rows:
            return []
        return [
            _Load(f"{name}_{_WAY[-side]}", "N/√Hz", one_force(self.freedoms, name, ABOUT_BLADES, side), rows[0], None)
            for name in self.pushed
        ]

    def support(self, group: Sequence[ModeLocation], places: Sequence[ModeLocation]) -> RotorBand:
        """The band of modes of the support that are near each other."""
        place, last = group[0], group[-1]
        others = [other for other in places if other not in group]
        low, _ = self._apart(
            place, others, place.frequency - self._reach(place.frequency, SUPPORT_HALF_WIDTH), math.inf
        )
        _, high = self._apart(last, others, 0.0, last.frequency + self._reach(last.frequency, SUPPORT_HALF_WIDTH))
        rows = [Row(i, 0, low, high) for i, c in enumerate(self.combined) if not c.turns]
        name = place.name.replace(" ", "_")
        loads = [
            _Load(f"{of}_{name}", "N/√Hz", one_force(self.freedoms, of, ABOUT_SUPPORT, 0), rows[0], 0)
            for of in self.pushed
        ]
        wide = place.ratio * place.frequency * self.duration > MIN_WIDE_BINS
        return self._band(name, bins_between(self.spectra, low, high), ABOUT_SUPPORT, rows, loads, wide=wide)

    def _reach(self, frequency: float, share: float) -> float:
        return max(self.width * share * frequency, MIN_HALF_WIDTH_BINS / self.duration)

    def _apart(
        self, place: ModeLocation, places: Sequence[ModeLocation], low: float, high: float
    ) -> tuple[float, float]:
        """A band cut where, in the fixed frame, another mode is nearer: nothing is used twice."""
        here = place.frequency - (place.shape or 0) * self.hz
        for other in places:
            if other != place:
                middle = 0.5 * (other.frequency - (other.shape or 0) * self.hz - here)
                if middle > 0.0:
                    high = min(high, place.frequency + middle)
                elif middle < 0.0:
                    low = max(low, place.frequency + middle)
        return low, high

    def _band(
        self, name: str, bins: NDArray[np.intp], orders: NDArray[np.intp], rows: Sequence[Row], loads: Sequence[_Load],
        *, wide: bool,
    ) -> RotorBand:  # fmt: skip
        """The model of a band. Where its modes are wide, what the taper's window adds is taken as known."""
        question, width = self.question, len(self.combined)
        if len(bins) < MIN_BAND_BINS:
            needed = self.duration * MIN_BAND_BINS / max(len(bins), 1)
            raise RecordError(
                f"band of {name}: expected {needed:.3g} s or more, got {self.duration:.3g} s: choose a longer record"
            )
        middle = len(orders) // 2
        ordered = sorted(rows, key=lambda row: (row.order + middle) * width + row.combination)
        entries = np.array([(row.order + middle) * width + row.combination for row in ordered], dtype=np.intp)
        f, fine = bins / self.duration, finer_bins(int(bins[0]), int(bins[-1])) / self.duration
        left_out = np.column_stack([(f < row.low) | (f > row.high) for row in ordered])
        data, recent = self._entries(self.spectra, ordered, bins, left_out), None
        blocks = self.spectra.blocks
        if self.spectra.recent is not None:
            last = self.spectra._replace(data=self.spectra.recent)
            recent = self._entries(last, ordered, bins, left_out)
        power = np.sum(np.abs(data) ** 2, axis=2) / blocks
        powers = [
            float(np.median(power[~left_out[:, i], i])) if (~left_out[:, i]).any() else 0.0 for i in range(len(ordered))
        ]
        T = self._transfer(f, orders)[:, entries]

        def model_at(where: Array, window: Array | None) -> LiftedModel:
            unseen = left_out if window is None else np.zeros((len(where), len(entries)), dtype=np.bool_)
            sources = [self._source(load, ordered, powers, T, left_out, where) for load in loads]
            noise, given = self._disturbances(name, ordered, powers, where)
            return LiftedModel(
                data, SpectrumGrid(where, orders, self.hz, entries, unseen), window, None, left_out,
                self.spectra.overlap, self.weights, question.compiled, self.freedoms, self.given, question.inputs[0],
                question.parameters, True, HumpLoads(sources), noise, given, np.full(len(bins), blocks), blocks, recent,
                self.spectra.gusts,
            )  # fmt: skip

        smoothed = model_at(fine, taper_weights(len(self.spectra.taper), bins) ** 2)
        return (
            RotorBand(model_at(f, None), smoothed, tuple(ordered))
            if wide
            else RotorBand(smoothed, None, tuple(ordered))
        )

    def _entries(
        self, spectra: TurnedSpectra, rows: Sequence[Row], bins: NDArray[np.intp], left_out: NDArray[np.bool_]
    ) -> Complex:
        """Readings of the rows at the bins (B, e, g), 0 where it is left out."""
        read = [spectra.combined(self.weights[row.combination], row.order)[bins] for row in rows]
        return np.where(left_out[:, :, None], 0.0, np.stack(read, axis=1))

    def _transfer(self, f: Array, orders: NDArray[np.intp]) -> Complex:
        """From loads to combined readings at the priors' centres (B, k r, k n)."""
        n = len(self.freedoms)
        speed = 2.0 * math.pi * self.hz
        found = matrix_harmonics(
            self.question.compiled, self.given[None], np.zeros((1, n)), speed, self.question.inputs[0]
        )
        size = len(orders) * n
        D = coupled(found.mechanics[:, 0], f, orders, self.hz).reshape(len(f), size, size)
        R = coupled((self.weights @ found.readings)[:, 0], f, orders, self.hz).reshape(len(f), -1, size)
        return np.asarray(R @ np.linalg.inv(D))

    def _source(
        self, load: _Load, rows: Sequence[Row], powers: Sequence[float], T: Complex, left_out: NDArray[np.bool_],
        fine: Array,
    ) -> BandSource:  # fmt: skip
        """A load, as loud at first as the row that shows it is."""
        low, high = load.row.low, load.row.high
        i = next(i for i, row in enumerate(rows) if row[:2] == load.row[:2])
        shown = float(np.median(np.abs(T[~left_out[:, i], i] @ load.placement) ** 2))
        if load.humps is None:
            terms = line_terms(fine, low, high)
        else:
            terms = hump_terms(self.wind, fine, low, high, self.hz, load.humps, len(WHIRLS))
        given = math.sqrt(max(powers[i], 1e-300) / max(shown, 1e-300) / len(terms))
        return BandSource(load.name, load.unit, load.placement, terms, given)

    def _disturbances(
        self, name: str, rows: Sequence[Row], powers: Sequence[float], fine: Array
    ) -> tuple[tuple[Statistic, ...], Array]:
        """Levels of every row, one at either end: statistics, and the density of each as given (n, F, e)."""
        statistics, given = [], []
        for i, row in enumerate(rows):
            what = self.combined[row.combination]
            sensor = self.question.sensors[int(np.argmax(np.abs(what.weights)))]
            where = f"{sensor.channel}_{_WAY[what.shape]}" if what.shape is not None else sensor.channel
            place = name if row.order == 0 else f"{name}_{_WAY[-row.order]}"
            for end, term in zip(("low", "high"), line_terms(fine, row.low, row.high), strict=True):
                level = max(DISTURBANCE_SHARE * powers[i], sensor.noise**2 / self.question.rate)
                density = np.zeros((len(fine), len(rows)))
                density[:, i] = level * term
                given.append(density)
                amplitude = math.sqrt(level)
                statistics.append(
                    Statistic(f"noise_{where}_{place}_{end}", f"{sensor.unit}/√Hz", amplitude, kind="noise")
                )
        return tuple(statistics), np.array(given)


_WAY = {0: "together", 1: "backward", -1: "forward"}
"""Words for the classes."""
