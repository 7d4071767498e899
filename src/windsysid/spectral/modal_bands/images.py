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
from windsysid.spectral.modal_bands.limits import (
    IMAGE_FALSE_ALARM_PROBABILITY,
    MAX_NONLINEAR_SHARE,
    MIN_MOTION_FREEDOM,
    MODE_FALSE_ALARM_PROBABILITY,
)
from windsysid.spectral.oma.mode import Doubt, OperationalMode

__all__ = ["with_harmonics", "with_images"]

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


def with_images(modes: Sequence[OperationalMode], frequency: Array, values: Complex) -> list[OperationalMode]:
    """Add a reason to each mode that is the image of a stronger one.

    Parameters
    ----------
    frequency, values
        Transforms (F, n) of the record at their frequencies (F,) [Hz].
    """
    motions = [_motion_of(mode, frequency, values) for mode in modes]
    checked = []
    for mode, motion in zip(modes, motions, strict=True):
        origins = (
            other.frequency.estimate
            for other, its in zip(modes, motions, strict=True)
            if its.last < motion.first and its.power > motion.power and _go_together(motion, its)
        )
        origin = next(origins, None)
        if origin is not None:
            text = f"it is an image of the mode at {origin:.4g} Hz: readings were taken more slowly and filled in"
            mode = replace(mode, grounds=(*mode.grounds, Doubt("image", text)))
        checked.append(mode)
    return checked


def with_harmonics(modes: Sequence[OperationalMode], frequency: Array, values: Complex) -> list[OperationalMode]:
    """Add a reason to each mode whose phase is bound to that of another one: both are harmonics of a machine.

    `frequency` and `values` are as in `with_images`.
    """
    motions = [_motion_of(mode, frequency, values) for mode in modes]
    grounds: dict[int, Doubt] = {}
    for i, k in permutations(range(len(modes)), 2):
        first, higher, order = modes[i], modes[k], round(modes[k].frequency.estimate / modes[i].frequency.estimate)
        if 2 <= order <= MAX_HARMONIC and _phase_is_bound(motions[i], motions[k], order, float(frequency[1])):
            text = f"its phase is locked to that of the peak at {first.frequency.estimate:.4g} Hz, as for harmonics"
            grounds.setdefault(k, Doubt("load", f"load or mode: {text}"))
            if motions[k].power > MAX_NONLINEAR_SHARE * motions[i].power:
                peak = f"the peak at {higher.frequency.estimate:.4g} Hz"
                text = f"the phase of {peak} is locked to its own, as for harmonics"
                grounds.setdefault(i, Doubt("load", f"load or mode: {text}"))
    return [
        replace(mode, grounds=(*mode.grounds, grounds[i])) if i in grounds else mode for i, mode in enumerate(modes)
    ]


def _phase_is_bound(one: _Motion, other: _Motion, order: int, step: float) -> bool:
    """True if the phase of a motion times an order is that of another motion, but for a constant."""
    if one.first * order > other.last or other.first > one.last * order:
        return False
    length = 2 * order * max(len(one.transform), len(other.transform))
    first, second = (np.fft.ifft(motion.transform, length) for motion in (one, other))
    size = np.maximum(np.abs(first), 1e-300)
    shift = (order * one.first - other.first) / step  # the transforms begin at their first bins
    multiplied = size * (first / size) ** order * np.exp(2j * np.pi * shift * np.arange(length) / length)
    power = np.abs(np.fft.fft(multiplied)) ** 2
    freedom = 2.0 * min(one.freedom, other.freedom, float(power.sum() ** 2 / np.sum(power**2)))
    if freedom < MIN_MOTION_FREEDOM:
        return False
    bound = 1.0 - MODE_FALSE_ALARM_PROBABILITY ** (1.0 / (freedom - 1.0))
    whole = float(np.sum(np.abs(multiplied) ** 2) * np.sum(np.abs(second) ** 2))
    return bool(np.abs(np.vdot(multiplied, second)) ** 2 > bound * whole)


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
    if freedom < MIN_MOTION_FREEDOM:
        return False
    length = 2 * max(len(one.transform), len(other.transform))
    first, second = (np.fft.ifft(motion.transform, length) for motion in (one, other))
    bound = 1.0 - (IMAGE_FALSE_ALARM_PROBABILITY / length) ** (1.0 / (freedom - 1.0))
    whole = float(np.sum(np.abs(first) ** 2) * np.sum(np.abs(second) ** 2))
    lines = [np.abs(np.fft.fft(first * turned, 4 * length)).max() ** 2 for turned in (second, second.conj())]
    return bool(max(lines) > bound * whole)
