"""Reasons against a mode: misfit of its spectrum, its envelope, segments of the record, sinusoids."""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array, Complex
from windsysid.spectral.modal_bands import limits
from windsysid.spectral.modal_bands.model import prominence, spectrum
from windsysid.spectral.modal_bands.model_order import BandFit, Shapes
from windsysid.spectral.modal_bands.scoring import HALF_TOLERANCE, ModalFit, score
from windsysid.spectral.oma.condition import Readings, RemovedLine
from windsysid.spectral.oma.result import Doubt
from windsysid.spectral.transforms.dft import band_data

__all__ = ["fit_doubts", "is_spurious", "misfit", "mode_doubts", "part_fits", "shape_doubts"]


def is_spurious(found: BandFit, j: int, length: float) -> bool:
    """True if mode j represents the background or the skirt of a mode outside the band: its frequency is not inside,
    its damping is that of the prior, or its prominence is low."""
    modes = found.fit.modes
    inside = found.bins[0] < float(modes.frequency[j]) * length < found.bins[-1]
    if not inside or found.fit.std(j)[1] > limits.MAX_LOG_DAMPING_STD:
        return True
    least = limits.MIN_BORDER_PROMINENCE if _at_border(found, j, length) else limits.MIN_PROMINENCE
    return prominence(modes, j, found.band) < least


def _at_border(found: BandFit, j: int, length: float) -> bool:
    """True if a mode's half-power range ends outside its band."""
    f, z = float(found.fit.modes.frequency[j]), float(found.fit.modes.damping[j])
    return not found.bins[0] < (f - z * f) * length or not (f + z * f) * length < found.bins[-1]


def misfit(found: BandFit) -> tuple[float, float]:
    """The largest standard deviation by which the whitened spectrum leaves 1 in eighths of a band, and the frequency
    there [Hz]."""
    band = found.band
    s = spectrum(found.fit.modes, band)
    m = s.shape[1]
    ratio = np.einsum("kij,kji->k", np.linalg.inv(s), band.power).real / m
    worst = (0.0, float(band.frequency[0]))
    for part in np.array_split(np.arange(len(ratio)), min(8, max(1, len(ratio) // 3))):
        n = band.counts[part]
        mean = float(n @ ratio[part] / n.sum())
        z = (mean - 1.0) * np.sqrt(n.sum() * m / band.factor)
        if abs(z) > abs(worst[0]):
            worst = (float(z), float(np.mean(band.frequency[part])))
    return worst


def part_fits(found: BandFit, parts: Sequence[tuple[Array, Complex]], samples: int, rate: float) -> list[ModalFit]:
    """The modes of a band from the transforms of equal parts of a record, starting from those of the whole; none where
    a part has too few bins in the band."""
    back = np.linalg.pinv(found.directions)
    low, high = found.bins[[0, -1]] * rate / samples
    fits = []
    for frequency, values in parts:
        bins = np.flatnonzero((frequency >= low) & (frequency <= high))
        if len(bins) < limits.MIN_BAND_BINS:
            return []
        band = band_data(values[bins] @ back.T, bins, samples // len(parts), rate)
        fits.append(score(found.fit.modes, band, max_steps=15, tolerance=HALF_TOLERANCE))
    return fits


def mode_doubts(
    found: BandFit, j: int, shapes: Shapes, halves: Sequence[ModalFit], quarters: Sequence[ModalFit], readings: Readings
) -> list[Doubt]:
    """Reasons against mode j of a band, with a comparison of `halves` and `quarters` of the record."""
    fit = found.fit
    f = float(fit.modes.frequency[j])
    length = readings.samples / readings.rate
    doubts = fit_doubts(found, j, shapes, readings)
    if _at_border(found, j, length):
        doubts.append(Doubt("border", "it sits at the border of its band"))
    alone = _along_shape(found, j)
    apart = abs(np.log(float(alone.modes.frequency[j]) / f)) / alone.std(j)[0]
    if apart > limits.MAX_CHANNEL_SIGMAS:
        there = f"{float(alone.modes.frequency[j]):.4g} Hz, {apart:.1f} σ away"
        text = f"the channels disagree: along its shape alone its frequency is {there}"
        doubts.append(Doubt("channels", text))
    over = prominence(fit.modes, j, found.band)
    if over < limits.MIN_CLEAR_PROMINENCE:
        text = f"its power is only {over:.2g} times that of the background: it may be the skirt of a neighbouring mode"
        doubts.append(Doubt("faint", text))
    return doubts + (_half_doubts(j, halves) or _quarter_doubts(j, quarters)) + shape_doubts(shapes.std[:, j])


def fit_doubts(found: BandFit, j: int, shapes: Shapes, readings: Readings) -> list[Doubt]:
    """Reasons against mode j from the fit of a band, sinusoids and the envelope of the mode."""
    fit = found.fit
    f, z = float(fit.modes.frequency[j]), float(fit.modes.damping[j])
    std_z = fit.std(j)[1]
    length = readings.samples / readings.rate
    doubts = []
    if not fit.converged:
        doubts.append(Doubt("search", "the search for its posterior did not end"))
    if std_z > limits.MAX_RELIABLE_LOG_DAMPING_STD or f * length < limits.MIN_MODE_CYCLES:
        factor = np.exp(2.0 * min(std_z, 3.0))
        text = f"the record is too short for it: {f * length:.0f} cycles, damping known to a factor of {factor:.2g}"
        doubts.append(Doubt("short", text))
    off, at = misfit(found)
    if abs(off) > limits.MAX_MISFIT_SIGMAS:
        text = f"the spectrum does not follow the modes: {off:+.1f} σ around {at:.4g} Hz; give the band by hand"
        doubts.append(Doubt("misfit", f"{text} (--band)"))
    doubts += [Doubt("line", text) for text in _line_doubts(f, z, std_z, length, readings.lines)]
    doubts += [Doubt("history", text) for text in _history_doubts(found, f, z, shapes.responses[:, j], length)]
    return doubts + _shared_doubts(found, j)


def shape_doubts(std: Array) -> list[Doubt]:
    """A reason if a shape with these standard deviations (n,) is uncertain."""
    size = float(np.sqrt(np.mean(std**2)))
    if size < limits.MAX_SHAPE_STD:
        return []
    text = f"its shape is uncertain (±{size:.2g}): it may be the skirt of a neighbouring mode"
    return [Doubt("shape", text)]


def _half_doubts(j: int, halves: Sequence[ModalFit]) -> list[Doubt]:
    if not halves:
        text = "its band is too narrow to compare the halves of the record: record longer, or widen --band"
        return [Doubt("halves", text)]
    doubts = []
    for i, name in enumerate(("frequency", "damping")):
        logs = [np.log((half.modes.frequency, half.modes.damping)[i][j]) for half in halves]
        apart = abs(logs[0] - logs[1]) / np.hypot(halves[0].std(j)[i], halves[1].std(j)[i])
        if apart > limits.MAX_HALVES_SIGMAS:
            doubts.append(Doubt("halves", f"the halves of the record differ in {name} by {apart:.1f} σ"))
    return doubts


def _quarter_doubts(j: int, quarters: Sequence[ModalFit]) -> list[Doubt]:
    """Reason if a frequency varies within halves that have equal means, as in daily cycles."""
    if not quarters:
        return []
    logs = np.array([np.log(one.modes.frequency[j]) for one in quarters])
    weight = np.array([one.std(j)[0] ** -2.0 for one in quarters])
    square = float(weight @ (logs - weight @ logs / weight.sum()) ** 2)
    if square < limits.MAX_QUARTERS_CHI_SQUARE:
        return []
    text = f"its frequency moves during the record: its quarters differ by up to {100.0 * np.ptp(logs):.2g} %"
    return [Doubt("halves", f"{text} (χ² {square:.3g} for 3)")]


def _shared_doubts(found: BandFit, j: int) -> list[Doubt]:
    """A reason if the mode shifts when loads are assumed to be independent."""
    if found.plain is None:
        return []
    f, plain = float(found.fit.modes.frequency[j]), found.plain.modes
    i = int(np.argmin(np.abs(plain.frequency - f)))
    moves = [
        np.log(now / then) / max(stds)
        for now, then, *stds in zip(
            (f, found.fit.modes.damping[j]),
            (plain.frequency[i], plain.damping[i]),
            found.fit.std(j),
            found.plain.std(i),
            strict=True,
        )
    ]
    if max(map(abs, moves)) < limits.MAX_LOAD_SHIFT_SIGMAS:
        return []
    text = f"its load drives its neighbours, too: that moves its frequency by {moves[0]:+.1f} σ, its damping by"
    return [Doubt("shared", f"{text} {moves[1]:+.1f} σ")]


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


def _line_doubts(f: float, z: float, std_z: float, length: float, lines: Sequence[RemovedLine]) -> list[str]:
    found = []
    for line in lines:
        reach = limits.LINE_HALF_WIDTHS if line.name == "line" else limits.HARMONIC_HALF_WIDTHS
        if abs(line.frequency - f) < line.half_width + reach * z * f:
            found.append(
                f"{'a steady line' if line.name == 'line' else line.name} at {line.frequency:.4g} Hz stands on it"
            )
    if np.exp(2.0 * std_z) * z < limits.MIN_STRUCTURE_DAMPING:
        found.append(
            f"it is as narrow as a machine's line that wanders: a damping ratio of {100 * z:.2g} %, which structures "
            f"hardly have"
        )
    if z * f * length < limits.MIN_HALF_WIDTH_BINS:
        found.append(
            f"it is as narrow as a line: a damping ratio of {100 * z:.2g} % cannot be told from none in {length:.4g} s"
        )
    return found[:1]


def _history_doubts(found: BandFit, f: float, z: float, response: Complex, length: float) -> list[str]:
    """Reasons from the envelope of the mode's response: a sinusoid of varying frequency, or a transient."""
    near = np.abs(found.bins / length - f) <= max(3.0 * z * f, 4.0 / length)
    kept = found.bins[near]
    if len(kept) < 6:
        return []
    grid = np.zeros(int(kept[-1] - kept[0]) + 1, dtype=np.complex128)
    grid[kept - kept[0]] = response[near]
    energy = np.abs(np.fft.ifft(grid, 4 * len(grid))) ** 2
    inner = energy[len(energy) // 16 : -(len(energy) // 16)]  # the taper's ends left out
    lives = 2.0 * np.pi * z * f * length
    doubts = []
    steadiness = float(np.var(inner) / np.mean(inner) ** 2)
    if steadiness < min(limits.MIN_ENVELOPE_VARIANCE, limits.MIN_ENVELOPE_VARIANCE_PER_ROOT * np.sqrt(lives)):
        doubts.append("its amplitude is as steady as a machine's line, not that of a mode under random loads")
    quarters = np.array([part.mean() for part in np.array_split(inner, 4)]) / inner.mean()
    scatter = np.sqrt(4.0 / max(lives, 1.0))
    most = float(quarters.max())
    rises = most > limits.MAX_QUARTER_ENERGY and (most - 1.0) / scatter > limits.MAX_QUARTER_SIGMAS
    if rises or most > limits.MAX_SINGLE_QUARTER_ENERGY:
        doubts.append(f"it is a transient: a quarter of the record has {25 * most:.0f} % of its energy")
    return doubts
