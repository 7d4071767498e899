"""Record, turbine and unknowns of an identification in the frequency domain, parked or turning."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.loads.narrow_band import narrow_band_statistics
from windsysid.loads.statistics import Statistic, noise_groups
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.sensors import Sensor
from windsysid.spectral.rotor.load_spectra import Sources
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.narrow_band_spectra import NarrowBandBeside
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.lifted import Lifted, lift
from windsysid.spectral.transforms.rotating_frame import TurnedBlock
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["MIN_START_DAMPING", "Posed", "RotorQuestion", "damped_start"]

MIN_START_DAMPING = 0.3
"""Setting: smallest damping at the start of a search in standard deviations of its prior."""


class RotorQuestion(NamedTuple):
    """A record, its turbine and the parameters to identify in the frequency domain.

    Attributes
    ----------
    turbine, parameters
        The turbine with the degrees of freedom that the sensors see, and the parameters to identify.
    sensors, readings, rate
        Instruments, and what they read without gaps (T, m) at `rate` [Hz].
    inputs, compiled
        The model's inputs (T, n_u), and the model with these sensors.
    loads
        The turbine file's, those that were measured left out.
    sums, turned
        What blocks of it say together, where it came in pieces: readings and inputs are then those of the last; and the
        same of a rotor that is read in bands.
    lifts
        Where the results of `lifted` are kept, by number of harmonics; None to keep none.
    """

    turbine: Turbine
    sensors: tuple[Sensor, ...]
    readings: Array
    rate: float
    inputs: Array
    compiled: CompiledModel
    parameters: tuple[Parameter, ...]
    loads: tuple[GaussMarkov, ...]
    sums: BlockSums[Lifted] | None = None
    turned: BlockSums[TurnedBlock] | None = None
    lifts: dict[int, Lifted] | None = None

    @property
    def size(self) -> int:
        """Degrees of freedom."""
        return len(self.turbine.model.coordinates)

    @property
    def azimuth(self) -> Array:
        """ψ (T,) [rad]; zero where the model has no rotor."""
        return self._input("rotor_azimuth")

    @property
    def speed(self) -> Array:
        """Ω (T,) [rad/s]; zero where the model has no rotor."""
        return self._input("rotor_speed")

    def _input(self, name: str) -> Array:
        names = self.turbine.model.inputs
        return self.inputs[:, names.index(name)] if name in names else np.zeros(len(self.inputs))

    @property
    def centres(self) -> Array:
        """All parameters (n_p,), those that are identified at the centres of their priors."""
        centres = {q.name: q.centre for q in self.parameters}
        values = self.turbine.values
        return np.array([centres.get(name, values.get(name, 0.0)) for name in self.compiled.parameters])

    @property
    def at_centres(self) -> Turbine:
        """Turbine with the identified coefficients at the centres of the priors."""
        return self.turbine.with_values({q.name: q.centre for q in self.parameters})

    @property
    def narrowest(self) -> float:
        """Half of the least half-power width of a mode, c/(4π m) [Hz], with the turbine file's damping."""
        turbine = self.turbine
        widths = [turbine.damping(name) / turbine.inertia(name) for name in turbine.model.coordinates]
        return max(0.0, 0.5 * min(widths) / (2.0 * math.pi))

    @property
    def has_lag(self) -> bool:
        """True if the blades' mean lag angle matters: a rotor on a hub that moves."""
        rotor = self.turbine.model.rotor
        return rotor is not None and rotor.lag == "free" and rotor.x == "free"

    @property
    def halves(self) -> "tuple[RotorQuestion, RotorQuestion]":
        """The questions of either half of the readings."""
        half = len(self.readings) // 2
        first, second = (
            self._replace(readings=self.readings[part], inputs=self.inputs[part], lifts=None)
            for part in (slice(0, half), slice(half, 2 * half))
        )
        return first, second

    def frequency(self, name: str) -> float:
        """Natural frequency of a degree of freedom at the centres of the priors [Hz]."""
        return self.at_centres.natural_frequency(name) / (2.0 * math.pi)

    def lifted(self, harmonics: int) -> Lifted:
        """The record's lifted spectrum; of several blocks the last's."""
        if self.sums is not None:
            return self.sums.last
        lifts = {} if self.lifts is None else self.lifts
        if harmonics not in lifts:
            lifts[harmonics] = lift(self.readings, self.azimuth, self.rate, harmonics)
        return lifts[harmonics]

    def with_narrow_band(self, broad: Sources, frequency: Array) -> NarrowBandBeside:
        """Broad loads at signed frequencies (B, 2K+1) [Hz], and a narrow-band one on the support."""
        narrow = narrow_band_statistics(self.turbine, self.loads)
        return NarrowBandBeside(broad, narrow, self.turbine.model, self.compiled.loads, frequency)

    def noise(self, frequency: Array, entries: NDArray[np.intp]) -> tuple[tuple[Statistic, ...], Array]:
        """Statistics of the sensors' noise, and its density as given on every entry (n, F, e)."""
        statistics = noise_groups(self.sensors)
        names = [s.name for s in statistics]
        given = np.zeros((len(statistics), *frequency.shape, len(self.sensors)))
        w = 2.0 * np.pi * np.abs(frequency)
        w = np.maximum(w, np.min(w[w > 0.0], initial=math.inf))  # a random walk in a record has no more at zero
        for i, sensor in enumerate(self.sensors):
            density = np.full(frequency.shape, sensor.noise**2 / self.rate)
            if sensor.drift:
                density += sensor.drift**2 / w**2
            given[names.index(noise_groups([sensor])[0].name), :, :, i] = density
        return statistics, np.ascontiguousarray(given.reshape(len(statistics), len(frequency), -1)[:, :, entries])


class Posed(NamedTuple):
    """The model of a question's spectrum, with the start of its search.

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


def damped_start(turbine: Turbine, parameters: Sequence[Parameter], mean: Array, std: Array) -> Array:
    """The prior's mean (n,), with damping that is not negative. A spectrum says |c| and not c: from the wrong side the
    search ends at the mirror image."""
    start = mean.copy()
    for i, q in enumerate(parameters):
        if q.kind == "damping" and q.part in turbine.model.coordinates and not q.logarithmic:
            start[i] = max(start[i], MIN_START_DAMPING * std[i])
    return start
