"""The spectrum of a tower or a parked machine, whose matrices do not turn: bands around its modes."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.spectral.rotor.harmonic_transfer import coupled, matrix_harmonics
from windsysid.spectral.rotor.likelihood import SpectrumGrid
from windsysid.spectral.rotor.load_spectra import BandLoads
from windsysid.spectral.rotor.model import GRID_FACTOR, JointWeights, LiftedModel, finer_bins, taper_weights
from windsysid.spectral.rotor.problem import Posed, RotorQuestion, damped_start
from windsysid.spectral.transforms.block_sums import factored
from windsysid.spectral.transforms.lifted import FIRST_BIN, MIN_LINE_TURNS, Lifted
from windsysid.spectral.transforms.limits import MIN_BAND_BINS
from windsysid.statespace.gauss_markov import GaussMarkov

__all__ = ["pose_standing"]

BAND_RATIO = 1.4
"""Setting: ratio of a band's upper end to the frequency of its mode, and of that to the lower end."""

SEARCH_SIGMAS = 3.0
"""Setting: standard deviations of the prior within which the peaks of modes are searched."""

MIN_EXACT_BINS = 4.0
"""Setting: bins in half the half-power width of a mode below which spectra are smoothed by the taper's window."""

MAX_JOINT_WIDTH, MAX_JOINT_COST, JOINT_GRID_FACTOR = 1.0, 20_000, 8
"""Setting: bins in half a mode's half-power width below which neighbours have a joint covariance; bins times channels³,
as which its time grows, up to which they have; frequencies per bin in its sum: enough for a third of the damping."""

LINE_BINS, LINE_SHARE = 2.5, 0.006
"""Setting: half-width of a rotor harmonic in bins, and as a share of its frequency, since no speed is constant."""

PEAK_BINS = 5
"""Setting: bins over which a spectrum is averaged before its peak is searched."""

BINS_PER_GROUP = 3.0
"""Setting: bins in half the half-power width of a mode for each bin of a group, which has the spectrum in its
middle."""


def pose_standing(
    question: RotorQuestion, given_bands: Sequence[tuple[float, float]], *, narrow: bool = False
) -> Posed:
    """Matrices that do not turn: bands around the modes, with loads of any smooth spectrum in each, and a narrow-band
    one on the support where that is asked."""
    sums, m = question.sums, len(question.sensors)
    lifted, blocks = question.lifted(0), 1.0 if sums is None else sums.blocks
    lines = _on_lines(lifted, question.speed)
    peaks = _peaks(question, lifted, lines)
    bands = tuple(given_bands) or _bands(list(peaks.values()), lifted)
    used = _in_bands(lifted.base, bands) & ~lines
    _check_length(int(used.sum()), 1 if given_bands else MIN_BAND_BINS * len(bands), lifted.duration)
    width = question.narrowest * lifted.duration
    base, joint, window, alike = _grid(lifted, used, width, joint=sums is None and used.sum() * m**3 <= MAX_JOINT_COST)
    data = single = _grouped(lifted.data[used, 0], alike).swapaxes(1, 2)
    if sums is not None:
        data = factored(_grouped(sums.power[used], alike).sum(axis=1))
    none = np.zeros((len(base), m), dtype=np.bool_)
    place = SpectrumGrid(base, lifted.harmonics, lifted.rotor_hz, np.arange(m), none)
    ends = np.array(bands).ravel()
    given = {name: [_given_amplitude(question.loads, name, f) for f in ends] for name in question.compiled.loads}
    broad = BandLoads(given, question.turbine.model.freedoms, bands, base[:, None])
    sources = question.with_narrow_band(broad, base[:, None]) if narrow else broad
    noise, levels = question.noise(base[:, None], place.entries)
    model = LiftedModel(
        np.ascontiguousarray(data), place, window, None, np.zeros(data.shape[:2], dtype=np.bool_), lifted.overlap,
        np.eye(m, dtype=np.complex128), question.compiled, question.turbine.model.freedoms, question.centres,
        question.inputs[0], question.parameters, False, sources, noise, levels, np.full(len(data), blocks * alike),
        blocks, None if sums is None else np.ascontiguousarray(single), 1.0 if sums is None else sums.gusts,
        joint=joint,
    )  # fmt: skip
    text = "any smooth spectrum around each mode" + narrow * ", and a narrow-band process on the support"
    resonance = 2.0 * math.pi * width * blocks / lifted.overlap
    return Posed(model, None, _start(question, model, peaks), bands, text, resonance)


def _check_length(bins: int, least: int, duration: float) -> None:
    """Refuse a record of too few bins."""
    if bins < least:
        raise RecordError(
            f"expected {duration * least / max(bins, 1):.3g} s or more for the bands around the modes, got "
            f"{duration:.3g} s: choose a longer record"
        )


def _in_bands(frequency: Array, bands: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Mask of the frequencies (B,) in a band."""
    low, high = np.array(bands).T
    return np.asarray(((frequency[:, None] >= low) & (frequency[:, None] <= high)).any(axis=1))


def _grid(
    lifted: Lifted, used: NDArray[np.bool_], width: float, *, joint: bool
) -> tuple[Array, JointWeights | None, Any, int]:
    """Frequencies at which spectra are taken [Hz], weights of bins that may be `joint`, and of the taper's
    window, and how many bins share a spectrum; `width` is half the half-power width of the narrowest mode in bins."""
    from scipy.sparse import csc_array

    number, joint = np.flatnonzero(used) + FIRST_BIN, joint and width < MAX_JOINT_WIDTH
    if width < MIN_EXACT_BINS:
        factor = JOINT_GRID_FACTOR if joint else GRID_FACTOR
        weights, fine = taper_weights(len(lifted.taper), number, factor), finer_bins(number[0], number[-1], factor)
        return fine / lifted.duration, JointWeights.of(weights) if joint else None, csc_array(weights**2), 1
    alike = int(width / BINS_PER_GROUP)
    return _grouped(number, alike).mean(axis=1) / lifted.duration, None, None, alike


def _grouped(bins: NDArray[Any], alike: int) -> NDArray[Any]:
    """Values of bins (B, …) by groups of so many neighbours (B // alike, alike, …), the rest left out."""
    groups = len(bins) // alike
    return bins[: groups * alike].reshape(groups, alike, *bins.shape[1:])


def _start(question: RotorQuestion, model: LiftedModel, peaks: Mapping[str, float]) -> Array:
    """Start of a search: stiffnesses at which natural frequencies are those of the peaks."""
    start = damped_start(question.turbine, question.parameters, *model.prior)
    for i, q in enumerate(question.parameters):
        if q.kind == "stiffness" and q.logarithmic and q.part in peaks:
            start[i] = 2.0 * math.log(peaks[q.part] / question.frequency(q.part))
    return start


def _peaks(question: RotorQuestion, lifted: Lifted, lines: NDArray[np.bool_]) -> dict[str, float]:
    """For each degree of freedom where [Hz], within the prior's reach, the channel that sees most of it is loudest."""
    speed, still = float(question.speed.mean()), np.zeros((1, question.size))
    found = matrix_harmonics(question.compiled, question.centres[None], still, speed, question.inputs[0])
    springs = {q.part: q for q in question.parameters if q.kind == "stiffness"}
    kernel = np.full(PEAK_BINS, 1.0 / PEAK_BINS)
    squares = np.abs(lifted.data[:, 0]) ** 2
    if question.sums is not None:
        squares = np.einsum("bii->bi", question.sums.power).real
    power = np.array([np.convolve(channel, kernel, mode="same") for channel in squares.T])
    peaks = {}
    for i, name in enumerate(question.turbine.model.coordinates):
        middle = question.frequency(name)
        q = springs.get(name)
        reach = SEARCH_SIGMAS * 0.5 * q.spread if q is not None and q.logarithmic else 0.0
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
        low, high = max(peak / BAND_RATIO, lifted.base[0]), min(peak * BAND_RATIO, lifted.base[-1])
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
    """Mask of base frequencies close to a harmonic of the rotor, which is as wide as the speed varies."""
    if lifted.rotor_hz * lifted.duration < MIN_LINE_TURNS:
        return np.zeros(len(lifted.base), dtype=np.bool_)
    order = np.round(lifted.base / lifted.rotor_hz)
    share = LINE_SHARE + 2.0 * float(speed.std() / abs(speed.mean()))
    reach = np.maximum(LINE_BINS / lifted.duration, share * lifted.base)
    return np.asarray((np.abs(lifted.base - order * lifted.rotor_hz) < reach) & (order > 0))


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
