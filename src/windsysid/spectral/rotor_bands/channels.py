"""Channels of a turning rotor in narrow bands: blades in the rotating frame, the support in the fixed frame.

A real turbine has more modes than a model of it: a spectrum is explained around a mode and nowhere else. A blade's mode
keeps one frequency in the frame of the blades, whichever way it whirls, and the support sees it at that frequency ± Ω.
So the vector that belongs together is taken about the frequency f in the blades' frame,

    Y_k(f) = √(Δt / Σ h²) Σ_t h(t) y(t) exp(−2πi f t − i k ψ(t)),

with the blades' readings at k = 0 and the support's at k = ±1; about a mode of the support in the fixed frame, with the
support's readings at k = 0. Nothing depends on how steady the speed is but the frequency of what is at k ≠ 0.

Readings of N equal sensors, one on each blade, go into N classes, y_p = N^{−1/2} Σ_b e^{−2πi p (b − 1)/N} y_b. A class
is a signed direction in multi-blade coordinates: what whirls backward at F is p = 1 at F + Ω, what whirls forward
p = −1 at F − Ω, what moves together p = 0 at F. Forward flap is distinguished from backward edgewise
motion at the same F. If one blade has no sensor, the others are read as they are.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.mechanics.sensors import Sensor
from windsysid.spectral.transforms.lifted import Complex
from windsysid.spectral.transforms.rotating_frame import TurnedSpectra

__all__ = ["ABOUT_BLADES", "ABOUT_SUPPORT", "LINE_BINS", "Combined", "Row", "bins_between", "combine"]

ABOUT_BLADES, ABOUT_SUPPORT = np.arange(-2, 3), np.arange(-1, 2)
"""Setting: harmonics of the motion about a frequency. Blades move the hub at ±1, which moves blades at ±2; the hub
moves blades at ±1, which move it at its own frequency. Equal blades do no more, and unequal ones hardly."""

LINE_BINS = 1.5
"""Setting: bins on either side of a rotor harmonic that are not used."""


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
        Number of the blade that is read as it is; otherwise 0.
    """

    label: str
    weights: Complex
    shape: int | None
    blade: int

    @property
    def turns(self) -> bool:
        """True if it is read on blades."""
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
                found.append(
                    Combined(f"{sensors[columns[1]].channel} and those of the other blades, {way}", weights, p, 0)
                )
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
    """Common part of sensors with the same reading on different blades."""
    fields = sensor.model_dump(exclude={"channel", "point", "noise", "bias", "drift"})
    return tuple(sorted((name, repr(value)) for name, value in fields.items()))
