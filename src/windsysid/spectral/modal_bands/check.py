"""Reasons against a mode: its band, its variation, sinusoids; other explanations of its spectrum."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import MAX_INFORMED_STD_RATIO
from windsysid.inspection.limits import MIN_MODE_CYCLES
from windsysid.spectral.modal_bands import limits
from windsysid.spectral.modal_bands.model import Modes, prominence, spectrum, tilt_of
from windsysid.spectral.modal_bands.model_order import BandFit, Shapes
from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR, HALF_TOLERANCE, ModalFit, score
from windsysid.spectral.modal_bands.varying_shapes import background_log_odds
from windsysid.spectral.oma.condition import Readings, RemovedLine
from windsysid.spectral.oma.mode import Doubt, OperationalMode
from windsysid.spectral.transforms.limits import MIN_BAND_BINS

__all__ = [
    "explanations", "fit_doubts", "is_spurious", "mode_doubts", "shape_doubts", "variation", "with_background_odds",
]  # fmt: skip

ENVELOPES = 100
"""Setting: number of motions that are drawn under random loads."""


def is_spurious(found: BandFit, j: int, length: float) -> bool:
    """True if mode j represents the background or the skirt of a mode outside the band: its frequency is not inside,
    its damping is that of the prior, or its prominence is low."""
    modes = found.fit.modes
    inside = found.bins[0] < float(modes.frequency[j]) * length < found.bins[-1]
    if not inside or found.fit.std(j)[1] > MAX_INFORMED_STD_RATIO * DAMPING_PRIOR[1]:
        return True
    least = limits.MIN_CLEAR_PROMINENCE if _at_border(found, j, length) else limits.MIN_PROMINENCE
    return prominence(modes, j, found.band) < least


def _at_border(found: BandFit, j: int, length: float) -> bool:
    """True if a mode's half-power range ends outside its band."""
    f, z = float(found.fit.modes.frequency[j]), float(found.fit.modes.damping[j])
    return not found.bins[0] < (f - z * f) * length or not (f + z * f) * length < found.bins[-1]


def mode_doubts(found: BandFit, j: int, shapes: Shapes, readings: Readings) -> list[Doubt]:
    """Reasons against mode j of a band."""
    length = readings.samples / readings.rate
    doubts = fit_doubts(found, j, readings)
    if _at_border(found, j, length):
        doubts.append(Doubt("border", "it is at the edge of its frequency range"))
    over = prominence(found.fit.modes, j, found.band)
    if over < limits.MIN_CLEAR_PROMINENCE:
        text = f"its power is only {over:.2g} times that of the background: it may be the skirt of a neighbouring mode"
        doubts.append(Doubt("faint", text))
    return doubts + shape_doubts(shapes.std[:, j])


def with_background_odds(modes: Sequence[OperationalMode], found: BandFit) -> list[OperationalMode]:
    """Add a reason to each usable mode of a band that may well be vibration whose shape varies with frequency."""
    usable = [i for i, mode in enumerate(modes) if mode.trusted]
    at = [int(np.argmin(np.abs(found.fit.modes.frequency - modes[i].frequency.estimate))) for i in usable]
    checked = list(modes)
    for i, ratio in zip(usable, background_log_odds(found.fit, found.band, len(found.bins), at), strict=True):
        if (odds := math.exp(min(ratio, 50.0))) > limits.MAX_LOAD_ODDS:
            text = f"it may be vibration between modes, whose shape varies with frequency: odds {odds:.2g} : 1"
            checked[i] = replace(modes[i], grounds=(*modes[i].grounds, Doubt("background", text)))
    return checked


def fit_doubts(found: BandFit, j: int, readings: Readings) -> list[Doubt]:
    """Reasons against mode j from the fit of a band, and sinusoids."""
    fit = found.fit
    f, z = float(fit.modes.frequency[j]), float(fit.modes.damping[j])
    std_z = fit.std(j)[1]
    length = readings.samples / readings.rate
    doubts = []
    if not fit.converged:
        doubts.append(Doubt("search", "the search for its posterior did not converge"))
    if found.crowded:
        doubts.append(Doubt("search", "its band has more modes than are fitted together: it may be several"))
    if std_z > limits.MAX_RELIABLE_LOG_DAMPING_STD or f * length < MIN_MODE_CYCLES:
        factor = np.exp(2.0 * min(std_z, 3.0))
        text = f"the record is too short for it: {f * length:.0f} cycles, damping known to a factor of {factor:.2g}"
        doubts.append(Doubt("short", text))
    doubts += [Doubt("line", text) for text in _line_doubts(f, z, length, readings.lines)]
    return doubts


def shape_doubts(std: Array) -> list[Doubt]:
    """A reason if a shape with these standard deviations (n,) is uncertain."""
    size = float(np.sqrt(np.mean(std**2)))
    if size < limits.MAX_SHAPE_STD:
        return []
    text = f"its shape is uncertain (±{size:.2g}): it may be the skirt of a neighbouring mode"
    return [Doubt("shape", text)]


def explanations(found: BandFit, j: int) -> list[tuple[str, Array]]:
    """Other explanations of a band, and the shifts of ln f and ln ζ of mode j under them: loads of its own for each
    mode, and the motion along the mode's shape alone, beyond what the readings that it leaves out explain."""
    fit = found.fit
    here, stds = _logarithms(fit.modes, j), np.array(fit.std(j))
    rivals = []
    if found.plain is not None:
        i = int(np.argmin(np.abs(found.plain.modes.frequency - fit.modes.frequency[j])))
        rivals.append(("its load also drives its neighbours", _logarithms(found.plain.modes, i) - here))
    alone = _along_shape(found, j)
    off = _logarithms(alone.modes, j) - here
    chance = 2.0 * np.sqrt(np.maximum(np.array(alone.std(j)) ** 2 - stds**2, 0.0))
    rivals.append(("channels contradict each other", np.sign(off) * np.maximum(np.abs(off) - chance, 0.0)))
    return rivals


def _logarithms(modes: Modes, j: int) -> Array:
    """ln f and ln ζ of a mode."""
    return np.log([modes.frequency[j], modes.damping[j]])


def _along_shape(found: BandFit, j: int) -> ModalFit:
    """Modes of a band from the component of the readings along the shape of mode j: loads that reach other channels
    by other paths have no influence on it."""
    modes, band = found.fit.modes, found.band
    way = modes.shape[:, j] / np.linalg.norm(modes.shape[:, j])
    power = np.einsum("i,kij,j->k", way.conj(), band.power, way).reshape(-1, 1, 1)
    rest = np.linalg.norm(way.conj() @ modes.rest)
    drift = None if modes.drift is None else (way.conj() @ modes.drift)[None]
    start = modes._replace(
        shape=(way.conj() @ modes.shape)[None], rest=np.array([[rest]], dtype=np.complex128), drift=drift
    )
    return score(start, band._replace(power=np.ascontiguousarray(power)), tolerance=HALF_TOLERANCE)


def _line_doubts(f: float, z: float, length: float, lines: Sequence[RemovedLine]) -> list[str]:
    found = []
    for line in lines:
        wide = 0 < line.order <= 3 * limits.MAX_COMB_ORDER
        reach = limits.HARMONIC_HALF_WIDTHS if wide else limits.LINE_HALF_WIDTHS
        if abs(line.frequency - f) < line.half_width + reach * z * f:
            found.append(
                f"{'a steady line' if line.name == 'line' else line.name} at {line.frequency:.4g} Hz stands on it"
            )
    if z * f * length < limits.MIN_HALF_WIDTH_BINS:
        found.append(f"it is as narrow as a line: a damping ratio of {100 * z:.2g} % is not resolved in {length:.4g} s")
    return found[:1]


def variation(found: BandFit, j: int) -> tuple[float, float]:
    """Density of the variation of a mode's motion if it is a machine whose speed varies, over that under random loads;
    factor on variances of frequency and damping, as the level of random loads may vary.

    Under random loads, transforms of the readings along the mode's shape are independent and complex Gaussian, with the
    variance of the model; draws of these, all without the background by Wiener's filter, give the distribution of
    `_variations`. If the level varies, values with large power have most of the information: variances grow as the mean
    of the squared power.
    """
    modes, band = found.fit.modes, found.band
    rest = modes.rest @ modes.rest.conj().T
    along = np.linalg.solve(rest, modes.shape[:, j])
    whole = np.einsum("i,kij,j->k", along.conj(), spectrum(modes, band), along).real
    background = (along.conj() @ rest @ along).real * tilt_of(band.frequency, band, modes.rest_slope)
    rows = np.repeat(np.arange(len(whole)), band.counts.astype(np.int64))
    kept = (whole > limits.MIN_PROMINENCE * background)[rows]
    if kept.sum() < MIN_BAND_BINS:
        return 1.0, 1.0
    measured = (found.values[kept] @ np.linalg.pinv(found.directions).T) @ along.conj()
    length = found.bins.sum() / (band.counts @ band.frequency)
    pole = complex(modes.frequency[j] * length * (1j - modes.damping[j]))
    std, filtered = np.sqrt(whole[rows][kept]), (1.0 - background / whole)[rows][kept]
    amplitude, phase, power = _variations(measured * filtered, found.bins[kept], pole)
    rng, drawn = np.random.default_rng(0), np.empty((3, ENVELOPES))
    for k in range(ENVELOPES):  # one at a time: of a day each has 100 MB
        normal = rng.normal(size=2 * len(std)).view(np.complex128)
        drawn[:, k] = _variations(normal * std * filtered, found.bins[kept], pole)
    (size, turn, usual_power), (std, turn_std, _) = drawn.mean(axis=1), drawn.std(axis=1)
    usual, spread, turned, turned_spread = limits.MACHINE_VARIATIONS
    share, rise, uneven = limits.LEVEL_VARIATION
    of_load = _normal(amplitude, math.log(usual), math.hypot(spread, std))
    of_load *= _normal(phase, turn + turned, math.hypot(turned_spread, turn_std))
    even = (1.0 - share) * _normal(amplitude, size, std) * _normal(phase, turn, turn_std)
    level = _normal(amplitude, size + rise, math.hypot(rise, std)) * _normal(phase, turn, math.hypot(uneven, turn_std))
    of_mode = even + share * level
    growth = max(math.exp(power - usual_power) - 1.0, 0.0)
    return min(of_load / of_mode, limits.MAX_STEADINESS), 1.0 + share * level / of_mode * growth


def _normal(x: float, mean: float, std: float) -> float:
    return math.exp(-0.5 * min(((x - mean) / std) ** 2, 500.0)) / std  # no product of two is 0


def _variations(transforms: Complex, bins: NDArray[np.int64], pole: complex) -> Array:
    """Measures (3,) of a motion by its transforms (k,) at some bins: ln of the envelope's coefficient of variation, ln
    of the variance of the load on a mode in phase with its motion over that in quadrature, and ln of the mean of the
    squared power over the squared mean.

    Random loads have equal variances; if the frequency of a load varies, its phase varies more than its amplitude.
    """
    motion, load = _motion(transforms, bins), _motion(transforms * (1j * bins - pole), bins)
    size = np.abs(motion)
    relative = load * motion.conj() / size
    phase = np.log(relative.real.var() / np.mean(relative.imag**2))
    return np.array([np.log(size.std() / size.mean()), phase, np.log(np.mean(size**4) / np.mean(size**2) ** 2)])


def _motion(transforms: Complex, bins: NDArray[np.int64]) -> Complex:
    """Complex amplitude (T,) over time by transforms (k,) at some bins, without its ends, which the taper changes."""
    from scipy.fft import ifft, next_fast_len

    grid = np.zeros(next_fast_len(4 * int(bins[-1] - bins[0] + 1)), dtype=np.complex128)
    grid[bins - bins[0]] = transforms
    motion = ifft(grid, overwrite_x=True)
    cut = len(motion) // 16
    return np.asarray(motion[cut : len(motion) - cut])
