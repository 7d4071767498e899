"""What is read of a turning rotor in narrow bands: blades where they turn, the support where it stands.

A real turbine has more modes than a model of it: a spectrum is explained around a mode and nowhere else. A blade's mode
keeps one frequency in the frame of the blades, whichever way it whirls, and the support sees it at that frequency ± Ω.
So the vector that belongs together is taken about the frequency f in the blades' frame,

    Y_k(f) = √(Δt / Σ h²) Σ_t h(t) y(t) exp(−2πi f t − i k ψ(t)),

with the blades' readings at k = 0 and the support's at k = ±1; about a mode of the support in the fixed frame, with the
support's readings at k = 0. Nothing depends on how steady the speed is but the frequency of what is at k ≠ 0.

Readings of N equal sensors, one on each blade, go into N classes, y_p = N^{−1/2} Σ_b e^{−2πi p (b − 1)/N} y_b. A class
is a signed direction in multi-blade coordinates: what whirls backward at F is p = 1 at F + Ω, what whirls forward
p = −1 at F − Ω, what moves together p = 0 at F. Flap that whirls forward is told from edgewise motion that whirls
backward at the same F. Where one blade has no sensor, its fellows are read as they are.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.mechanics.sensors import Sensor
from windsysid.spectral.transforms.dft import taper, taper_factor
from windsysid.spectral.transforms.lifted import Complex, turn_lines, without_lines

__all__ = [
    "ABOUT_BLADES",
    "ABOUT_SUPPORT",
    "LINE_BINS",
    "Combined",
    "Row",
    "TurnedSpectra",
    "bins_between",
    "combine",
    "turned_spectra",
]

ABOUT_BLADES, ABOUT_SUPPORT = np.arange(-2, 3), np.arange(-1, 2)
"""Harmonics of the motion about a frequency. Blades move the hub at ±1, which moves blades at ±2; the hub moves blades
at ±1, which move it where it was. Equal blades do no more, and unequal ones hardly."""

LINE_BINS = 1.5
"""Bins to either side of a harmonic of the rotor that are not used."""


class TurnedSpectra(NamedTuple):
    """Transforms of a record in frames that turn with the rotor.

    Attributes
    ----------
    data
        Y_k at the bins 0, 1, 2 … below half the rate (T/2, m, 1) for each k; of several blocks columns (B, m, g) that
        have the products of all together.
    rotor_hz, duration, overlap
        Ω / 2π [Hz], T [s], c_h.
    taper
        h (T,).
    blocks
        Of how many blocks `data` are.
    recent, gusts
        Where there are several, Y_k of the last, and how much larger c_h is for what changes between them.
    """

    data: dict[int, Complex]
    rotor_hz: float
    duration: float
    overlap: float
    taper: Array
    blocks: float = 1.0
    recent: dict[int, Complex] | None = None
    gusts: float = 1.0

    def combined(self, weights: Complex, k: int = 0) -> Complex:
        """Y_k of a combination of readings (m,): (B, g)."""
        return np.asarray(np.einsum("bmg,m->bg", self.data[k], weights))


class Combined(NamedTuple):
    """One combination of readings.

    Attributes
    ----------
    label
        In words.
    weights
        Of the readings (m,).
    shape
        p of the class; None for a reading as it is.
    blade
        Number of the blade that is read as it is; 0 elsewhere.
    """

    label: str
    weights: Complex
    shape: int | None
    blade: int

    @property
    def turns(self) -> bool:
        """Whether it is read on blades."""
        return self.shape is not None or self.blade > 0


class Row(NamedTuple):
    """One entry of the vector about f: a combination at a harmonic, between two frequencies.

    Attributes
    ----------
    combination
        Its number.
    order
        k.
    low, high
        f between which it is used [Hz].
    """

    combination: int
    order: int
    low: float
    high: float


def turned_spectra(readings: Array, azimuth: Array, rate: float, reach: int) -> TurnedSpectra:
    """Y_k, |k| ≤ `reach`, of readings (T, m) without gaps at `rate` [Hz] and azimuths (T,) [rad, unwrapped], harmonics
    of the rotor taken out."""
    samples = len(azimuth)
    duration = samples / rate
    turned = abs(float(azimuth[-1] - azimuth[0])) / (2.0 * math.pi) * samples / (samples - 1)
    rotor_hz = turned / duration
    h = taper(samples)
    quiet = without_lines(readings, azimuth, h, turn_lines(rotor_hz, rate)) * h[:, None]
    scale = math.sqrt(1.0 / rate / float(h @ h))
    bins = np.arange((samples + 1) // 2)
    data: dict[int, Complex] = {0: (scale * np.fft.rfft(quiet, axis=0)[bins])[:, :, None]}
    for k in range(1, reach + 1):  # readings are real: Y_{−k}(f) is the complex conjugate of Y_k(−f)
        whole = (scale * np.fft.fft(quiet * np.exp(-1j * k * azimuth)[:, None], axis=0))[:, :, None]
        data |= {k: whole[bins], -k: whole[-bins].conj()}
    return TurnedSpectra(data, rotor_hz, duration, taper_factor(samples), h)


def combine(sensors: Sequence[Sensor], blades: int) -> list[Combined]:
    """The readings as they are combined: sensors alike on all blades by classes, all others as they are."""
    found: list[Combined] = []
    alike: dict[tuple[tuple[str, object], ...], dict[int, int]] = {}
    identity = np.eye(len(sensors), dtype=np.complex128)
    for i, sensor in enumerate(sensors):
        if not sensor.blade:
            found.append(Combined(sensor.channel, identity[i], None, 0))
        else:
            alike.setdefault(_mounting(sensor), {})[sensor.blade] = i
    for columns in alike.values():
        if sorted(columns) == list(range(1, blades + 1)) and blades > 2:
            for p, way in ((0, "together"), (1, "backward"), (-1, "forward")):
                weights = np.zeros(len(sensors), dtype=np.complex128)
                for blade, column in columns.items():
                    weights[column] = np.exp(-2j * math.pi * p * (blade - 1) / blades) / math.sqrt(blades)
                found.append(Combined(f"{sensors[columns[1]].channel} and its fellows, {way}", weights, p, 0))
        else:
            found += [Combined(sensors[i].channel, identity[i], None, blade) for blade, i in columns.items()]
    return found


def bins_between(spectra: TurnedSpectra, low: float, high: float) -> NDArray[np.intp]:
    """Bins between two frequencies [Hz], those near harmonics of the rotor left out."""
    last = min(math.floor(high * spectra.duration), len(spectra.data[0]) - 1)
    bins = np.arange(max(1, math.ceil(low * spectra.duration)), last + 1)
    turns = spectra.rotor_hz * spectra.duration
    return np.asarray(bins[np.abs(bins - np.round(bins / turns) * turns) >= LINE_BINS], dtype=np.intp)


def _mounting(sensor: Sensor) -> tuple[tuple[str, object], ...]:
    """What sensors share that read the same on different blades."""
    fields = sensor.model_dump(exclude={"channel", "point", "noise", "bias", "drift"})
    return tuple(sorted((name, repr(value)) for name, value in fields.items()))
