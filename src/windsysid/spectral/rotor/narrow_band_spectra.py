"""Spectra of broad loads and of a narrow-band one next to them (`windsysid.loads.narrow_band`)."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from windsysid._types import Array
from windsysid.loads.narrow_band import FREQUENCY, WIDTH
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.model import MechanicalModel
from windsysid.spectral.rotor.load_spectra import Sources, SourceSpectra

__all__ = ["NarrowBandBeside", "narrow_density"]


class NarrowBandBeside:
    """Loads each of which drives a degree of freedom of its own, and a narrow-band process that adds to some of them.

    It is white noise through a second-order low-pass with natural frequency f₀ and damping ratio ζ, of the standard
    deviation σ: two-sided, S = σ² 2ζ / (π f₀) / |1 − (f/f₀)² + 2iζ f/f₀|².
    """

    def __init__(
        self, broad: Sources, narrow: Sequence[Statistic], model: MechanicalModel, loads: Sequence[str],
        frequency: Array
    ) -> None:  # fmt: skip
        """The `broad` loads at signed `frequency` (B, 2K+1) [Hz], the statistics of the narrow one, and the model's
        `loads` (n,)."""
        self._broad, self._frequency = broad, frequency
        self.statistics = (*broad.statistics, *narrow)
        self.placement = broad.placement
        driven = {one.name: one.load for one in model.freedoms}
        levels = [one for one in narrow if one.kind == "narrow-band level"]
        self._levels = [one.name for one in levels]
        orders = np.arange(frequency.shape[1]) * len(loads)
        self._columns = [
            np.argmax(np.abs(broad.placement[orders + loads.index(driven[one.of])]), axis=1) for one in levels
        ]

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Those of the broad loads, and the narrow one's next to them."""
        own, cross = self._broad.spectra(values, every)
        own = own.copy()
        shape = self._shape(values, every)[0]
        for level, columns in zip(self._levels, self._columns, strict=True):
            own[:, columns] += values[level] ** 2 * shape
        return SourceSpectra(own, cross)

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Those of the broad loads, and analytic ones of the narrow one."""
        own, cross = self._broad.slopes(values, every)
        shape, to_frequency, to_width = self._shape(values, every)
        more = np.zeros((2 + len(self._levels), *own.shape[1:]))
        for i, (level, columns) in enumerate(zip(self._levels, self._columns, strict=True)):
            power = values[level] ** 2 * shape
            more[0][:, columns], more[1][:, columns] = power * to_frequency, power * to_width
            more[2 + i][:, columns] = 2.0 * power
        nothing = np.zeros((len(more), *cross.shape[1:]))
        return SourceSpectra(np.concatenate([own, more]), np.concatenate([cross, nothing]))

    def _shape(self, values: Mapping[str, float], every: int) -> tuple[Array, Array, Array]:
        """The spectrum of a standard deviation of 1 (B, 2K+1), and the slopes of its logarithm to those of f₀ and ζ."""
        return narrow_density(self._frequency[every // 2 :: every], values[FREQUENCY], values[WIDTH])


def narrow_density(frequency: Array, own: float | Array, damping: float) -> tuple[Array, Array, Array]:
    """The two-sided spectrum of a narrow-band process of standard deviation 1 at frequencies [Hz], and the slopes of
    its logarithm to those of its natural frequency [Hz] and damping ratio."""
    ratio = (frequency / own) ** 2
    wide = 4.0 * damping**2 * ratio
    rest = (1.0 - ratio) ** 2 + wide
    to_own = -1.0 - (4.0 * ratio * (1.0 - ratio) - 2.0 * wide) / rest
    density = 2.0 * damping / (math.pi * own) / rest
    return np.asarray(density), np.asarray(to_own), np.asarray(1.0 - 2.0 * wide / rest)
