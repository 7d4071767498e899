"""From a record's readings and a turbine to the lifted spectrum as a function of the unknowns."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.loads.statistics import Statistic, noise_groups
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor
from windsysid.spectral.lifted import Complex, Lifted, lift
from windsysid.spectral.lifted_likelihood import Place
from windsysid.spectral.lifted_loads import BandLoads, BroadbandLoads, Sources, WindLoads
from windsysid.spectral.lifted_mechanics import HIGHEST, coupled, matrix_harmonics
from windsysid.spectral.lifted_model import LiftedModel, finer_bins, taper_window
from windsysid.spectral.lifted_start import damped_start
from windsysid.spectral.lifted_sums import LiftedSums, factored
from windsysid.spectral.turned_sums import TurnedSums
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["Posed", "Question", "harmonics_of", "pose_lifted", "turns_couple"]

BAND = 1.4
"""How far the band of a mode reaches to either side of its frequency, as a factor."""

SEARCHED = 3.0
"""Standard deviations of the prior within which a mode's peak is looked for."""

NARROW = 4.0
"""Bins in half the half-power width of a mode below which spectra are smoothed by the taper's window."""

ALIKE, ALIKE_TURNING = 3.0, 1.4
"""Bins in half the half-power width of a mode for each bin that shares its spectrum with others: where the spectrum in
their middle is taken, and where their mean is, at a turning rotor."""

LINE_BINS, LINE_SHARE = 2.5, 0.006
"""Half-width of a harmonic of the rotor: in bins, and as a share of its frequency, since no speed is quite constant."""

LEAST_BINS = 12
"""Fewest bins of a band."""

MOST_HARMONICS = 10
"""Highest K: a rotor that turns more slowly beside its modes makes matrices too large."""

PEAK_BINS = 5
"""Bins over which a spectrum is averaged where its peak is looked for."""


class Question(NamedTuple):
    """What is asked of a record.

    Attributes
    ----------
    turbine
        With the degrees of freedom that the sensors see.
    sensors, readings, rate
        Instruments, and what they read without gaps (T, m) at `rate` [Hz].
    inputs
        The model's inputs (T, n_u): ψ and Ω first.
    compiled
        The model with these sensors.
    parameters
        What is identified.
    loads
        The turbine file's, those that were measured left out.
    sums
        What blocks of it say together, where it came in pieces: readings and inputs are then those of the last.
    turned
        The same of a rotor that is read in bands.
    """

    turbine: Turbine
    sensors: tuple[Sensor, ...]
    readings: Array
    rate: float
    inputs: Array
    compiled: CompiledModel
    parameters: tuple[Parameter, ...]
    loads: tuple[GaussMarkov, ...]
    sums: LiftedSums | None = None
    turned: TurnedSums | None = None


class Posed(NamedTuple):
    """A question in the frequency domain.

    Attributes
    ----------
    model
        The spectrum as a function of the unknowns.
    smoothed
        The same smoothed by the taper's window; None where `model` is.
    start
        Where to begin to look for them (n,).
    bands
        Frequencies that are used [Hz].
    text
        What the loads are taken for.
    resonance
        As how many independent entries the narrowest resonance of the turbine file counts in the record, 2πδT/c_h of a
        half-power width 2δ.
    """

    model: LiftedModel
    smoothed: LiftedModel | None
    start: Array
    bands: tuple[tuple[float, float], ...]
    text: str
    resonance: float


def turns_couple(question: Question) -> bool:
    """Whether the azimuth stands in the equations or the readings, and the rotor turns."""
    p, speed = _centres(question), float(question.inputs[:, 1].mean())
    found = matrix_harmonics(question.compiled, p[None], np.zeros((1, _size(question))), speed, question.inputs[0])
    others = np.arange(2 * HIGHEST + 1) != HIGHEST
    return bool(found.mechanics[:, :, others].any() or found.readings[:, :, others].any())


def pose_lifted(question: Question, loads: str, bands: Sequence[tuple[float, float]] = ()) -> Posed:
    """The problem under a load model: ``"broadband"``, or for a rotor whose turns couple its motion ``"rotor-wind"``.

    Where nothing turns, `bands` are found around the modes; or they are given, to look at a part of the record as at
    the whole.

    Raises
    ------
    RecordError, ConfigurationError
        If the record is too short, or the rotor turns too slowly beside its modes.
    """
    if turns_couple(question):
        return _pose_turning(question, loads)
    if loads == "rotor-wind":
        raise ConfigurationError(
            "load model rotor-wind: expected a rotor that turns with blades that move, got neither: choose broadband"
        )
    return _pose_standing(question, bands)


def harmonics_of(question: Question) -> int:
    """K: every harmonic up to the blades' modes, and the next; 0 where nothing turns.

    Raises
    ------
    RecordError
        If the rotor turns too slowly beside its modes, or the record is sampled too slowly.
    """
    if not turns_couple(question):
        return 0
    turbine, rate = question.turbine, question.rate
    rotor_hz = float(question.inputs[:, 1].mean()) / (2.0 * math.pi)
    fastest = _fastest(turbine)
    K = math.ceil(fastest / rotor_hz) + 2
    if K > MOST_HARMONICS:
        raise RecordError(
            f"the rotor turns at {rotor_hz:.3g} Hz, and modes reach {fastest:.3g} Hz: expected at most "
            f"{MOST_HARMONICS - 2} P; use --formulation joint"
        )
    if (K + 0.5) * rotor_hz > 0.5 * rate:
        raise RecordError(
            f"sampling rate: expected {(2 * K + 1) * rotor_hz:.3g} Hz or more, got {rate:.4g}: sample faster, or use "
            f"--formulation joint"
        )
    return K


def _fastest(turbine: Turbine) -> float:
    """Highest natural frequency of a degree of freedom [Hz]."""
    return max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * math.pi)


def _lifted(question: Question, harmonics: int) -> Lifted:
    """The record's lifted spectrum; of several blocks the last's."""
    if question.sums is not None:
        return question.sums.last
    return lift(question.readings, question.inputs[:, 0], question.rate, harmonics)


def _pose_turning(question: Question, loads: str) -> Posed:
    """A rotor whose turns couple its motion."""
    turbine, K, sums = question.turbine, harmonics_of(question), question.sums
    lifted, blocks = _lifted(question, K), 1.0 if sums is None else sums.blocks
    width = _narrowest(question) * lifted.duration
    bins, alike = len(lifted.base), max(1, int(width / ALIKE_TURNING))
    if bins < LEAST_BINS // 4 * alike:
        turned = lifted.duration * lifted.rotor_hz
        raise RecordError(
            f"expected {2 * LEAST_BINS} turns of the rotor or more, got {turned:.3g}: choose a longer record"
        )
    pools = np.array_split(np.arange(bins), -(-bins // alike))
    base = np.array([lifted.base[pool].mean() for pool in pools])
    m = len(question.sensors)
    entries = np.flatnonzero(np.repeat(np.abs(lifted.harmonics) < K, m))  # motion beyond K is missing in those of K
    data = single = _pooled(lifted.data.reshape(bins, -1)[:, entries], pools)
    if sums is not None:
        power = sums.power[:, entries[:, None], entries]
        data = factored(np.array([power[pool].sum(axis=0) for pool in pools]))
    number = np.round(lifted.base * lifted.duration).astype(np.intp)
    fine = finer_bins(int(number[0]), int(number[-1])) / lifted.duration
    window = taper_window(lifted.taper, number)
    window = np.column_stack([window[:, pool].mean(axis=1) for pool in pools])

    def model_at(where: Array, weights: Array | None) -> LiftedModel:
        place = Place(
            where, lifted.harmonics, lifted.rotor_hz, entries, np.zeros((len(where), len(entries)), dtype=np.bool_)
        )
        sources = _turning_loads(question, loads, where, lifted, _fastest(turbine))
        noise, given = _noise(question, where[:, None] + lifted.rotor_hz * lifted.harmonics, entries)
        return LiftedModel(
            data,
            place,
            weights,
            None,
            np.zeros(data.shape[:2], dtype=np.bool_),
            lifted.overlap,
            np.eye(m, dtype=np.complex128),
            question.compiled,
            turbine.model.coordinates,
            _centres(question),
            question.inputs[0],
            question.parameters,
            _has_lag(question),
            sources,
            noise,
            given,
            np.array([blocks * len(pool) for pool in pools]),
            blocks,
            None if sums is None else single,
            1.0 if sums is None else sums.gusts,
        )

    model, bands = model_at(base, None), ((float(base[0]), (K - 0.5) * lifted.rotor_hz),)
    text = "wind on the turning rotor" if loads == "rotor-wind" else "first-order Gauss–Markov"
    resonance = 2.0 * math.pi * width * blocks / lifted.overlap
    start = damped_start(question.turbine, question.parameters, *model.prior)
    return Posed(model, model_at(fine, window), start, bands, text, resonance)


def _pooled(entries: Complex, pools: Sequence[NDArray[np.intp]]) -> Complex:
    """Entries (B, e) of the bins in every pool, (pools, e, g), 0 beyond the last."""
    data = np.zeros((len(pools), entries.shape[1], max(len(pool) for pool in pools)), dtype=np.complex128)
    for where, pool in zip(data, pools, strict=True):
        where[:, : len(pool)] = entries[pool].T
    return data


def _turning_loads(question: Question, loads: str, base: Array, lifted: Lifted, fastest: float) -> Sources:
    """The load model at base frequencies."""
    turbine, names = question.turbine, question.compiled.loads
    if loads != "rotor-wind":
        return BroadbandLoads(question.loads, turbine.model, base[:, None] + lifted.rotor_hz * lifted.harmonics)
    v = turbine.values
    moment = next(load.rms for load in question.loads if load.load.startswith("load_beta"))
    lever = v["blade_inertia_1"] / v["blade_first_moment_1"]
    return WindLoads(
        names, turbine.model.blades, v["hinge_offset"], lever, lifted.rotor_hz, base, lifted.harmonics, moment, fastest
    )


def _pose_standing(question: Question, given_bands: Sequence[tuple[float, float]]) -> Posed:
    """Matrices that do not turn: bands around the modes, with loads of any smooth spectrum in each."""
    sums = question.sums
    lifted, blocks = _lifted(question, 0), 1.0 if sums is None else sums.blocks
    lines = _on_lines(lifted, question.inputs[:, 1])
    peaks = _peaks(question, lifted, lines)
    bands = tuple(given_bands) or _bands(list(peaks.values()), lifted)
    used = np.zeros(len(lifted.base), dtype=np.bool_)
    for low, high in bands:
        inside = (lifted.base >= low) & (lifted.base <= high)
        used |= inside
    used &= ~lines
    number = np.round(lifted.base * lifted.duration).astype(np.intp)[used]
    if len(number) < LEAST_BINS * len(bands) and not given_bands:
        needed = lifted.duration * LEAST_BINS * len(bands) / max(len(number), 1)
        raise RecordError(
            f"expected {needed:.3g} s or more for the bands around the modes, got {lifted.duration:.3g} s: choose a "
            f"longer record"
        )
    width = _narrowest(question) * lifted.duration
    m, alike = len(question.sensors), 1
    if width < NARROW:
        base, window = finer_bins(int(number[0]), int(number[-1])) / lifted.duration, taper_window(lifted.taper, number)
    else:
        alike = int(width / ALIKE)
        groups = len(number) // alike
        base, window = number[: groups * alike].reshape(groups, alike).mean(axis=1) / lifted.duration, None
    groups = len(number) // alike
    data = single = np.swapaxes(lifted.data[used, 0][: groups * alike].reshape(groups, alike, m), 1, 2)
    if sums is not None:
        data = factored(sums.power[used][: groups * alike].reshape(groups, alike, m, m).sum(axis=1))
    orders = lifted.harmonics
    place = Place(base, orders, lifted.rotor_hz, np.arange(m), np.zeros((len(base), m), dtype=np.bool_))
    ends = np.array(bands).ravel()
    given = {name: [_given_amplitude(question.loads, name, f) for f in ends] for name in question.compiled.loads}
    sources = BandLoads(given, question.compiled.loads, bands, base[:, None])
    noise, levels = _noise(question, base[:, None], place.entries)
    model = LiftedModel(
        np.ascontiguousarray(data),
        place,
        window,
        None,
        np.zeros(data.shape[:2], dtype=np.bool_),
        lifted.overlap,
        np.eye(m, dtype=np.complex128),
        question.compiled,
        question.turbine.model.coordinates,
        _centres(question),
        question.inputs[0],
        question.parameters,
        False,
        sources,
        noise,
        levels,
        np.full(groups, blocks * alike),
        blocks,
        None if sums is None else np.ascontiguousarray(single),
        1.0 if sums is None else sums.gusts,
    )
    start = damped_start(question.turbine, question.parameters, *model.prior)
    for i, q in enumerate(question.parameters):
        name = q.name.removeprefix("k_")
        if q.name.startswith("k_") and q.logarithmic and name in peaks:
            start[i] = 2.0 * math.log(peaks[name] / _frequency(question, name))
    return Posed(
        model,
        None,
        start,
        bands,
        "any smooth spectrum in the bands around the modes",
        2.0 * math.pi * width * blocks / lifted.overlap,
    )


def _peaks(question: Question, lifted: Lifted, lines: NDArray[np.bool_]) -> dict[str, float]:
    """For each degree of freedom where [Hz], within the prior's reach, the channel that sees most of it is loudest."""
    found = matrix_harmonics(
        question.compiled,
        _centres(question)[None],
        np.zeros((1, _size(question))),
        float(question.inputs[:, 1].mean()),
        question.inputs[0],
    )
    known = {q.name: q for q in question.parameters}
    kernel = np.full(PEAK_BINS, 1.0 / PEAK_BINS)
    squares = np.abs(lifted.data[:, 0]) ** 2
    if question.sums is not None:
        squares = np.einsum("bii->bi", question.sums.power).real
    power = np.array([np.convolve(channel, kernel, mode="same") for channel in squares.T])
    peaks = {}
    for i, name in enumerate(question.turbine.model.coordinates):
        middle = _frequency(question, name)
        q = known.get(f"k_{name}")
        reach = SEARCHED * 0.5 * q.spread if q is not None and q.logarithmic else 0.0
        inside = np.flatnonzero(np.abs(np.log(lifted.base / middle)) <= max(reach, 1e-9))
        R = coupled(found.readings[:, 0], np.array([middle]), lifted.harmonics, lifted.rotor_hz)[0, 0, :, 0, i]
        off_lines = inside[~lines[inside]]
        if not off_lines.size:
            peaks[name] = middle
            continue
        peaks[name] = float(lifted.base[off_lines[np.argmax(power[int(np.argmax(np.abs(R)))][off_lines])]])
    return peaks


def _bands(peaks: Sequence[float], lifted: Lifted) -> tuple[tuple[float, float], ...]:
    """Bands around the peaks; those that meet are one."""
    joined: list[tuple[float, float]] = []
    for peak in sorted(peaks):
        low, high = max(peak / BAND, lifted.base[0]), min(peak * BAND, lifted.base[-1])
        if low >= high:
            raise RecordError(
                f"a mode near {peak:.3g} Hz: expected it below {lifted.base[-1]:.3g} Hz: sample faster, or lock what "
                f"moves there"
            )
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], high)
        else:
            joined.append((low, high))
    return tuple(joined)


def _on_lines(lifted: Lifted, speed: Array) -> NDArray[np.bool_]:
    """Which base frequencies are within reach of a harmonic of the rotor, which is as wide as the speed varies."""
    if lifted.rotor_hz * lifted.duration < 1.0:
        return np.zeros(len(lifted.base), dtype=np.bool_)
    order = np.round(lifted.base / lifted.rotor_hz)
    share = LINE_SHARE + 2.0 * float(speed.std() / abs(speed.mean()))
    reach = np.maximum(LINE_BINS / lifted.duration, share * lifted.base)
    return np.asarray((np.abs(lifted.base - order * lifted.rotor_hz) < reach) & (order > 0))


def _noise(question: Question, frequency: Array, entries: NDArray[np.intp]) -> tuple[tuple[Statistic, ...], Array]:
    """Statistics of the sensors' noise, and its density as given on every entry (n, F, e)."""
    statistics = noise_groups(question.sensors)
    names = [s.name for s in statistics]
    given = np.zeros((len(statistics), *frequency.shape, len(question.sensors)))
    w = 2.0 * np.pi * np.abs(frequency)
    for i, sensor in enumerate(question.sensors):
        density = np.full(frequency.shape, sensor.noise**2 / question.rate)
        if sensor.drift:
            density += sensor.drift**2 / w**2
        given[names.index(noise_groups([sensor])[0].name), :, :, i] = density
    return statistics, np.ascontiguousarray(given.reshape(len(statistics), len(frequency), -1)[:, :, entries])


def _given_amplitude(loads: Sequence[GaussMarkov], name: str, frequency: float) -> float:
    """Spectral amplitude of the file's load at a frequency [unit/√Hz]."""
    power = sum(
        2.0 * load.rms**2 * load.time_constant / (1.0 + (2.0 * math.pi * frequency * load.time_constant) ** 2)
        for load in loads
        if load.load == name and not load.harmonic
    )
    if power <= 0.0:
        raise ConfigurationError(f"load '{name}': expected its rms in the turbine file: add it to [loads]")
    return math.sqrt(power)


def _centres(question: Question) -> Array:
    """All parameters (n_p,), those that are identified at the centres of their priors."""
    centres = {q.name: q.centre for q in question.parameters}
    values = question.turbine.values
    return np.array([centres.get(name, values.get(name, 0.0)) for name in question.compiled.parameters])


def _at_centres(question: Question) -> Turbine:
    return question.turbine.with_values({q.name: q.centre for q in question.parameters})


def _frequency(question: Question, name: str) -> float:
    """Natural frequency of a degree of freedom at the centres of the priors [Hz]."""
    return _at_centres(question).natural_frequency(name) / (2.0 * math.pi)


def _narrowest(question: Question) -> float:
    """Half of the least half-power width of a mode, c/(4π m) [Hz], with the turbine file's damping."""
    turbine = question.turbine
    widths = [turbine.values[f"c_{name}"] / turbine.inertia(name) for name in turbine.model.coordinates]
    return max(0.0, 0.5 * min(widths) / (2.0 * math.pi))


def _has_lag(question: Question) -> bool:
    """Whether the blades' mean lag angle matters: a rotor on a hub that moves."""
    model = question.turbine.model
    return isinstance(model, RotorModel) and model.lag == "free" and "load_x" in model.loads


def _size(question: Question) -> int:
    return len(question.turbine.model.coordinates)
