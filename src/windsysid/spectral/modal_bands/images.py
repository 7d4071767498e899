"""Images of modes: aliases of readings that were interpolated from a lower sampling rate; harmonics of one machine.

Whatever fills in, straight lines, splines or a filter that is not steep enough, leaves a faint copy of a mode at
F − f and at F + f, with F the rate at which the readings were taken. The motion of an image is that of its mode, turned
back or not, times e^{2πiFt}: their product has one line and no band. Random motions of two modes have none.

Of a machine whose speed wanders, the phases of the harmonics are multiples of that of the first, which those of modes
are not. Of a mode that moves far, a quadratic nonlinearity makes a faint harmonic whose amplitude follows its square.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MODEL_CHANGE_PROBABILITY, NEGLIGIBLE_SHARE
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["with_bound_motions"]

MOTION_HALF_WIDTHS = 6.0
"""Setting: half-widths ζ f of a mode within which its motion is taken."""

MIN_MOTION_BINS = 20
"""Setting: smallest number of bins on either side within which it is taken."""

MAX_HARMONIC = 4
"""Setting: highest multiple of the frequency of a peak at which its harmonics are sought."""


class _Motion(NamedTuple):
    """A mode's motion along its shape: its transform (k,) from `first` [Hz] to `last`, its power, and how many
    independent values it has."""

    transform: Complex
    first: float
    last: float
    power: float
    freedom: float


def with_bound_motions(modes: Sequence[OperationalMode], frequency: Array, values: Complex) -> list[OperationalMode]:
    """Add a reason to each mode that is the image of a stronger one, and to harmonics of a machine.

    Parameters
    ----------
    frequency, values
        Transforms (F, n) of the record at their frequencies (F,) [Hz].
    """
    motions = [_motion_of(mode, frequency, values) for mode in modes]
    grounds: list[dict[str, Doubt]] = [{} for _ in modes]
    for i, k in permutations(range(len(modes)), 2):
        low, high, one, other = modes[i].frequency.estimate, modes[k].frequency.estimate, motions[i], motions[k]
        if one.last < other.first and one.power > other.power and _go_together(other, one):
            text = f"it is an image of the mode at {low:.4g} Hz: readings were taken more slowly and filled in"
            grounds[k].setdefault("image", Doubt("image", text))
        if _phase_is_bound(one, other, round(high / low), float(frequency[1])):
            text = f"load or mode: its phase is locked to that of the peak at {low:.4g} Hz, as for harmonics"
            grounds[k].setdefault("load", Doubt("load", text))
            if other.power > NEGLIGIBLE_SHARE**2 * one.power:
                text = f"load or mode: the phase of the peak at {high:.4g} Hz is locked to its own, as for harmonics"
                grounds[i].setdefault("load", Doubt("load", text))
    return [replace(mode, grounds=(*mode.grounds, *new.values())) for mode, new in zip(modes, grounds, strict=True)]


def _phase_is_bound(one: _Motion, other: _Motion, order: int, step: float) -> bool:
    """True if the phase of a motion times an order is that of another motion, but for a constant."""
    if not 2 <= order <= MAX_HARMONIC or one.first * order > other.last or other.first > one.last * order:
        return False
    length = 2 * order * max(len(one.transform), len(other.transform))
    first, second = (np.fft.ifft(motion.transform, length) for motion in (one, other))
    size = np.maximum(np.abs(first), 1e-300)
    shift = (order * one.first - other.first) / step  # the transforms begin at their first bins
    multiplied = size * (first / size) ** order * np.exp(2j * np.pi * shift * np.arange(length) / length)
    power = np.abs(np.fft.fft(multiplied)) ** 2
    freedom = 2.0 * min(one.freedom, other.freedom, float(power.sum() ** 2 / np.sum(power**2)))
    bound = _coherence_bound(freedom, FALSE_ALARM_PROBABILITY)
    whole = float(np.sum(np.abs(multiplied) ** 2) * np.sum(np.abs(second) ** 2))
    return bool(np.abs(np.vdot(multiplied, second)) ** 2 > bound * whole)


def _coherence_bound(freedom: float, probability: float) -> float:
    """Squared coherence of series with so many independent values that chance exceeds with some probability."""
    return float(1.0 - probability ** (1.0 / max(freedom - 1.0, 1e-3)))


def _motion_of(mode: OperationalMode, frequency: Array, values: Complex) -> _Motion:
    step = float(frequency[1])
    half = max(int(MOTION_HALF_WIDTHS * mode.half_width / step), MIN_MOTION_BINS)
    middle = round(mode.frequency.estimate / step)
    bins = np.arange(max(middle - half, 1), min(middle + half, len(frequency)))
    along = values[bins] @ mode.shape.conj()
    power = np.abs(along) ** 2
    freedom = float(power.sum() ** 2 / max(np.sum(power**2), 1e-300))
    return _Motion(along, float(frequency[bins[0]]), float(frequency[bins[-1]]), float(power.sum()), freedom)


def _go_together(one: _Motion, other: _Motion) -> bool:
    """True if the product of two motions, or of one and the conjugate of the other, is a sinusoid."""
    freedom = min(one.freedom, other.freedom)
    length = 2 * max(len(one.transform), len(other.transform))
    first, second = (np.fft.ifft(motion.transform, length) for motion in (one, other))
    bound = _coherence_bound(freedom, MODEL_CHANGE_PROBABILITY / length)
    whole = float(np.sum(np.abs(first) ** 2) * np.sum(np.abs(second) ** 2))
    lines = [np.abs(np.fft.fft(first * turned, 4 * length)).max() ** 2 for turned in (second, second.conj())]
    return bool(max(lines) > bound * whole)
