"""Welch spectra, their peaks, and the harmonic or mode of each peak.

Spectra follow Welch (1967, doi:10.1109/TAU.1967.1161901), with Hann windows that overlap by half. A peak counts where
the spectrum stands above the running median around it by more than the scatter of its averages can do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import HARMONIC_HALF_WIDTH_SHARE
from windsysid.inspection.bodies import body_of
from windsysid.inspection.fault import Fault
from windsysid.inspection.limits import MAX_REFERENCE_DISTANCE
from windsysid.inspection.rotor import Rotor
from windsysid.records.checks import refuse_gaps
from windsysid.records.record import Record
from windsysid.signals.textbook import short_spectra

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = [
    "ExpectedLine", "SpectralPeak", "Spectrogram", "Spectrum", "cleaned", "expected_modes", "lines_in", "spectra",
    "spectrogram",
]  # fmt: skip


MAX_PEAKS = 8
"""Setting: largest number of peaks of a spectrum that are listed."""
SEGMENTS_PER_RECORD = 6
"""Setting: number of segment lengths in a record (eleven segments, overlapping by half), none longer than
`MAX_SEGMENT_SECONDS`."""
MAX_SEGMENT_SECONDS = 100.0
"""Setting: largest length of a segment [s]."""
BROAD_PEAK_HALF_WIDTH = 0.06
"""Setting: half-width of the window for broad peaks, relative to its frequency."""


@dataclass(frozen=True)
class ExpectedLine:
    """A frequency to look for: a harmonic of the rotor or an expected mode.

    Attributes
    ----------
    name
        ``3P``, ``tower x`` …
    frequency
        [Hz], as this channel sees it.
    half_width
        [Hz]: how far from it a peak may sit and still be it.
    mode
        True for a mode, False for a harmonic.
    number
        Order n of the harmonic, or position of the mode in `Inspection.modes`, from 1.
    """

    name: str
    frequency: float
    half_width: float
    mode: bool
    number: int


@dataclass(frozen=True)
class SpectralPeak:
    """A peak of a spectrum: frequency [Hz], height above its surroundings [dB], rms [channel's unit], cause."""

    frequency: float
    prominence: float
    rms: float
    matches: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One channel's spectrum.

    Attributes
    ----------
    channel, unit
        Name and unit u.
    frequency, density
        (F,) [Hz] and (F,) [u²/Hz], one-sided.
    resolution
        Width of a line [Hz].
    peaks
        By falling rms.
    lines
        Harmonics and modes, as this channel sees them.
    """

    channel: str
    unit: str
    frequency: Array
    density: Array
    resolution: float
    peaks: tuple[SpectralPeak, ...]
    lines: tuple[ExpectedLine, ...]

    def summary(self) -> dict[str, Any]:
        """Peaks as plain values."""
        listed = [
            {"frequency_hz": p.frequency, "above_background_db": p.prominence, "rms": p.rms, "matches": list(p.matches)}
            for p in self.peaks
        ]
        return {"channel": self.channel, "unit": self.unit, "resolution_hz": self.resolution, "peaks": listed}


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Spectra of one channel over time, or over rotor speed where that varies.

    Attributes
    ----------
    against
        ``time`` or ``rotor speed``.
    position
        (P,): middle of each column, [s] or [rad/s].
    frequency, density
        (F,) [Hz] and (F, P) [u²/Hz]; NaN where the rotor never turned at that speed.
    """

    channel: str
    unit: str
    against: str
    position: Array
    frequency: Array
    density: Array


def cleaned(record: Record, channels: Sequence[str], findings: Sequence[Fault]) -> tuple[Array, Array, float, str]:
    """Time (T,), values (T, m) and rate of channels on a uniform grid, faults bridged; and a remark, if one is due."""
    values = _without_faults(record, channels, findings)
    if record.is_uniform:
        return record.time, values, record.rate, ""
    rate = record.rate
    rows = int(record.duration * rate * (1.0 + 1e-9)) + 1
    if rows > 10 * record.samples:
        refuse_gaps(record.name, record.time, rows)
    grid = record.time[0] + np.arange(rows) / rate
    resampled = np.empty((grid.size, values.shape[1]))
    for to, column in zip(resampled.T, values.T, strict=True):
        to[:] = np.interp(grid, record.time, column)
    return grid, resampled, rate, "Spectra: gaps and irregular steps are bridged by straight lines."


def _without_faults(record: Record, channels: Sequence[str], findings: Sequence[Fault]) -> Array:
    """Values (T, m) of channels whose spikes, frozen readings and gaps are bridged by straight lines."""
    values = np.column_stack([record[name] for name in channels]) if channels else np.empty((record.samples, 0))
    for finding in findings:
        if finding.kind in ("spikes", "frozen") and finding.channel in channels:
            low = np.searchsorted(record.time, finding.spans[:, 0], side="left")
            high = np.searchsorted(record.time, finding.spans[:, 1], side="right")
            column = list(channels).index(finding.channel)
            for first, past in zip(low, high, strict=True):
                values[first:past, column] = np.nan
    for column in values.T:
        ok = np.isfinite(column)
        if not ok.all():
            column[:] = np.interp(record.time, record.time[ok], column[ok])
    return values


def expected_modes(turbine: "Turbine", rotor_speed: float) -> list[tuple[str, float, float]]:
    """Name, frequency [Hz] and damping ratio of the modes that the turbine file's references give, fixed frame."""
    from windsysid.mechanics.compile import compile_model
    from windsysid.modal.analysis import modes

    model = compile_model(turbine.model)
    return modes(turbine.model, model, np.array([turbine.values[name] for name in model.parameters]), rotor_speed)


def lines_in(
    channel: str,
    rotor: Rotor | None,
    modes: Sequence[tuple[str, float, float]],
    blades: int,
    highest: float,
    resolution: float,
) -> tuple[ExpectedLine, ...]:
    """Harmonics to 2N P and modes, as an instrument on `channel` sees them.

    An instrument that turns sees a mode shifted by 1P.
    """
    lines = []
    turning = body_of(channel) == "rotor"
    once = rotor.mean / (2.0 * np.pi) if rotor is not None and rotor.turns else 0.0
    spread = 2.0 * rotor.variation if rotor is not None else 0.0
    for n in range(1, 2 * blades + 1):
        if 0.0 < n * once < highest:
            lines.append(ExpectedLine(f"{n}P", n * once, 1.5 * resolution + n * once * min(spread, 0.3 / n), False, n))
    for number, (name, frequency, _) in enumerate(modes, start=1):
        for seen, said in seen_from(name, frequency, once, turning):
            if 0.0 < seen < highest:
                lines.append(ExpectedLine(said, seen, 1.5 * resolution, True, number))
    return tuple(lines)


def seen_from(name: str, frequency: float, once: float, turning: bool) -> list[tuple[float, str]]:
    """Frequencies [Hz] and names under which an instrument, turning or not, sees a mode of the fixed frame."""
    if not turning or not once:
        return [(frequency, name)]
    if name.startswith("tower"):
        return [(abs(frequency - once), f"{name} − 1P"), (frequency + once, f"{name} + 1P")]
    for whirl, sign in (("backward", 1.0), ("forward", -1.0)):
        if whirl in name:
            order = int(name.split()[-1]) if name.split()[-1].isdecimal() else 1
            return [(abs(frequency + sign * order * once), name)]
    return [(frequency, name)]


def spectra(
    values: Array, rate: float, channels: Sequence[str], units: Mapping[str, str],
    rotor: Rotor | None, modes: Sequence[tuple[str, float, float]], blades: int,
) -> tuple[Spectrum, ...]:  # fmt: skip
    """Welch spectra of the columns of `values` (T, m), with peaks and their matches."""
    samples = len(values)
    size = int(min(max(samples // SEGMENTS_PER_RECORD, min(samples, 256)), MAX_SEGMENT_SECONDS * rate))
    if size < 16:
        return ()
    from scipy.fft import next_fast_len

    size = min(samples, int(next_fast_len(size, real=True)))
    segments = max(1, 2 * (samples // size) - 1)
    resolution = 1.5 * rate / size  # noise bandwidth of a Hann window
    found = []
    for column, channel in enumerate(channels):
        frequency, _, short = short_spectra(values[:, column], rate, size, size // 2)
        density = short.mean(axis=1)
        lines = lines_in(channel, rotor, modes, blades, rate / 2.0, resolution)
        peaks = _peaks(frequency, density, resolution, segments, lines)
        found.append(Spectrum(channel, units[channel], frequency, density, resolution, peaks, lines))
    return tuple(found)


def _peaks(
    frequency: Array, density: Array, resolution: float, segments: int, lines: Sequence[ExpectedLine]
) -> tuple[SpectralPeak, ...]:
    from scipy.ndimage import median_filter

    top = float(density.max())
    if not top > 0.0 or frequency.size < 16:
        return ()
    level = 10.0 * np.log10(np.maximum(density, 1e-14 * top))
    step = frequency[1]
    width = 2 * int(np.clip(np.ceil(8.0 * resolution / step), 5, frequency.size // 4)) + 1
    above = level - median_filter(level, width, mode="nearest")
    local = (level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:])
    index = np.flatnonzero(local) + 1
    # Chance alone, by Wilson & Hilferty's cube-root rule for chi-squared at 4.3 sigma.
    freedom = 2.0 * max(1.0, segments / 1.06)
    chance = 10.0 * np.log10((1.0 - 2.0 / (9.0 * freedom) + 4.3 * np.sqrt(2.0 / (9.0 * freedom))) ** 3)
    # What lies 100 dB below the largest peak is arithmetic, not vibration.
    index = index[(above[index] > max(6.0, chance)) & (frequency[index] > 2.0 * step) & (density[index] > 1e-10 * top)]
    found: list[SpectralPeak] = []
    for i in sorted(index, key=lambda i: -density[i]):
        left, middle, right = level[i - 1 : i + 2]
        bend = left - 2.0 * middle + right
        at = float(frequency[i] + (0.5 * (left - right) / bend * step if bend < 0.0 else 0.0))
        if all(abs(at - peak.frequency) > 2.0 * resolution for peak in found):
            around = density[max(i - 2, 0) : i + 3]
            found.append(SpectralPeak(at, float(above[i]), float(np.sqrt(around.sum() * step)), _matches(at, lines)))
    for peak in _broad_peaks(frequency, density, resolution, lines):
        if all(abs(peak.frequency - other.frequency) > BROAD_PEAK_HALF_WIDTH * peak.frequency for other in found):
            found.append(peak)
    return tuple(sorted(found, key=lambda peak: -peak.rms)[:MAX_PEAKS])


def _broad_peaks(
    frequency: Array, density: Array, resolution: float, lines: Sequence[ExpectedLine]
) -> list[SpectralPeak]:
    """Find the peaks of modes whose damping makes them wider than the background's window.

    The search is the same, on a logarithmic axis.
    """
    step = frequency[1]
    lowest = (
        2.0 * resolution / BROAD_PEAK_HALF_WIDTH
    )  # below this a band of ± BROAD_PEAK_HALF_WIDTH holds too few lines to be averaged
    if lowest >= 0.5 * frequency[-1]:
        return []
    centre = np.geomspace(
        lowest, frequency[-1] / (1.0 + BROAD_PEAK_HALF_WIDTH), int(np.log(frequency[-1] / lowest) / np.log(1.02)) + 2
    )
    power = np.concatenate([[0.0], np.cumsum(density) * step])
    edges = np.append(frequency - 0.5 * step, frequency[-1] + 0.5 * step)
    band = np.interp(centre * (1.0 + BROAD_PEAK_HALF_WIDTH), edges, power) - np.interp(
        centre * (1.0 - BROAD_PEAK_HALF_WIDTH), edges, power
    )
    band = np.maximum(band, 1e-300)
    level = 10.0 * np.log10(band / centre)
    found = []
    for i in range(1, centre.size - 1):
        near = level[max(0, i - 4) : i + 5]
        low, high = level[max(0, i - 30) : i], level[i + 1 : i + 31]  # to a factor 1.8 on either side
        rise = float(level[i] - max(low.min(), high.min()))
        if level[i] == near.max() and rise > 5.0 and band[i] > 1e-8 * band.max():
            at = float(centre[i])
            inside = np.abs(frequency - at) <= BROAD_PEAK_HALF_WIDTH * at
            at = float(np.average(frequency[inside], weights=density[inside]))
            wide = [
                ExpectedLine(x.name, x.frequency, max(x.half_width, 0.5 * BROAD_PEAK_HALF_WIDTH * at), x.mode, x.number)
                for x in lines
            ]
            found.append(SpectralPeak(at, rise, float(np.sqrt(band[i])), _matches(at, wide)))
    return found


def _matches(at: float, lines: Sequence[ExpectedLine]) -> tuple[str, ...]:
    """Names of the lines a peak may be, the nearest first; a mode that is only near is named with its distance."""
    near = sorted(lines, key=lambda line: abs(line.frequency - at))
    exact = tuple(line.name for line in near if abs(line.frequency - at) <= line.half_width)
    if exact:
        return exact
    return tuple(
        f"{line.name} {100.0 * (at / line.frequency - 1.0):+.1f} %".replace("-", "−")
        for line in near
        if line.mode and abs(at - line.frequency) <= MAX_REFERENCE_DISTANCE * line.frequency
    )


def spectrogram(
    time: Array, values: Array, rate: float, channel: str, unit: str, rotor: Rotor | None
) -> Spectrogram | None:
    """Short spectra of one channel (T,), over time or, where `rotor` (on the same grid) varies, over rotor speed.

    A segment lasts some five turns of the rotor: 1P is distinguished from 2P while the speed hardly changes.
    """
    from scipy.fft import next_fast_len

    duration = values.size / rate
    seconds = 5.0 * 2.0 * np.pi / abs(rotor.mean) if rotor is not None and rotor.turns else duration / 20.0
    if not (varies := rotor is not None and rotor.turns and rotor.variation > HARMONIC_HALF_WIDTH_SHARE):
        seconds = max(2.0 * seconds, duration / 60.0)
    size = int(min(max(seconds * rate, 32), values.size / 4))
    if size < 16:
        return None
    size = int(next_fast_len(size, real=True))
    overlap = size - max(1, min(size // 2, max(size // 4, values.size // 2000)))
    frequency, middle, density = short_spectra(values, rate, size, overlap)
    if not varies or rotor is None:
        return Spectrogram(channel, unit, "time", time[0] + middle, frequency, density)
    speeds, mean = _over_speed(np.interp(middle, time - time[0], rotor.speed), density)
    return Spectrogram(channel, unit, "rotor speed", speeds, frequency, mean)


def _over_speed(speed: Array, density: Array) -> tuple[Array, Array]:
    """Bins of rotor speed (P,) [rad/s] and the mean density (F, P) within each, of densities (F, S) at speeds (S,)."""
    low, high = np.percentile(speed, (0.5, 99.5))
    bins = int(np.clip(speed.size // 8, 4, 40))
    edges = np.linspace(low, high, bins + 1)
    which = np.digitize(speed, edges) - 1
    mean = np.full((len(density), bins), np.nan)
    for b in np.unique(which[(which >= 0) & (which < bins)]):
        mean[:, b] = density[:, which == b].mean(axis=1)
    return 0.5 * (edges[1:] + edges[:-1]), mean
