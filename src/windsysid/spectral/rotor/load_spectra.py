"""Spectra of the loads on a turning rotor, as sources that are independent from frequency to frequency.

A load model has sources Z with (two-sided) spectra S_s, and a constant matrix U that puts them on the degrees of
freedom at all harmonics: the generalised loads are w = U Z. Sources are independent but for pairs (the force and the
moment that one eddy exerts on a blade).
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.kernels.jit import compiled
from windsysid.loads.statistics import Statistic, load_groups, moved_loads
from windsysid.mechanics.model import Coordinate, MechanicalModel
from windsysid.spectral.transforms.lifted import Complex
from windsysid.statespace.gauss_markov import GaussMarkov

__all__ = ["BandLoads", "BroadbandLoads", "SourceSpectra", "Sources", "WindLoads", "WindRotor", "coherence_table"]


class SourceSpectra(NamedTuple):
    """Spectra of the sources at B base frequencies.

    Attributes
    ----------
    own
        Of every source (B, s) [unit²/Hz].
    cross
        Between source i and source i + pairs, i < pairs (B, pairs); no columns where all are independent.
    """

    own: Array
    cross: Array


class Sources(Protocol):
    """A load model in the frequency domain."""

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Its statistics."""

    @property
    def placement(self) -> Complex:
        """U ((2K+1) n, s)."""

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Spectra for values of the statistics, at every n-th base frequency from the n//2-th on."""

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Their derivatives to the logarithm of every statistic, one after the other (n, B, …)."""


DIFFERENCE_STEP = 1e-4
"""Numerical: step of a logarithm for central differences."""


def slopes_by_differences(sources: Sources, values: Mapping[str, float], every: int) -> SourceSpectra:
    """`Sources.slopes` of sources whose spectra are no simple functions of their statistics."""
    found = []
    for name in [s.name for s in sources.statistics]:
        up, down = (
            sources.spectra({**values, name: values[name] * math.exp(sign * DIFFERENCE_STEP)}, every)
            for sign in (1.0, -1.0)
        )
        found.append([(a - b) / (2.0 * DIFFERENCE_STEP) for a, b in zip(up, down, strict=True)])
    return SourceSpectra(*(np.array(part) for part in zip(*found, strict=True)))


def _side_by_side(driven: Sequence[str], loads: Sequence[str], harmonics: int) -> Complex:
    """U of loads that are independent and each drive one of a model's loads, at all harmonics."""
    placement = np.zeros((harmonics * len(loads), len(driven) * harmonics), dtype=np.complex128)
    for i, load in enumerate(driven):
        for k in range(harmonics):
            placement[k * len(loads) + loads.index(load), i * harmonics + k] = 1.0
    return placement


class BroadbandLoads:
    """First-order Gauss–Markov loads, as a turbine file lists them, on degrees of freedom of their own."""

    def __init__(self, loads: Sequence[GaussMarkov], model: MechanicalModel, frequency: Array) -> None:
        """`frequency` (B, 2K+1) [Hz] are the signed frequencies."""
        self.loads = [load for load in loads if not load.harmonic]
        self.statistics = load_groups(self.loads, model)
        self._model, self._frequency = model, frequency
        self.placement = _side_by_side([load.load for load in self.loads], model.loads, frequency.shape[1])

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """2σ²τ / (1 + (2πfτ)²) each."""
        frequency = self._frequency[every // 2 :: every]
        own = [
            2.0 * load.rms**2 * load.time_constant / (1.0 + (2.0 * np.pi * frequency * load.time_constant) ** 2)
            for load in moved_loads(self.statistics, values, self.loads, self._model)
        ]
        return SourceSpectra(np.concatenate(own, axis=1), np.empty((len(frequency), 0)))

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """By central differences."""
        return slopes_by_differences(self, values, every)


STATIONS = 6
"""Setting: stations along a blade at which the wind acts."""

MAX_WIND_HARMONIC = 12
"""Setting: highest harmonic of the wind in azimuth."""

RING_POINTS = 96
"""Numerical: points on a ring over which coherence is averaged."""

EDDY_MOMENT_FACTOR = 1.2
"""Setting: factor on the wind's mean lever for small eddies, in moment and in squared force over squared moment."""


class WindRotor(NamedTuple):
    """A rotor in the wind: how many blades, hinges [m] from the hub, wind loads at `lever` [m] from these and of
    `moment` rms [N·m] on a blade, the rotor's frequency and the structure's highest [Hz]."""

    blades: int
    hinge: float
    lever: float
    rotor_hz: float
    moment: float
    fastest: float


class WindLoads:
    """Wind on a turning rotor: turbulence frozen in space, with the coherence of IEC 61400-1, cut by the blades.

    On a ring the wind is a Fourier series in azimuth, u(r, θ, t) = Σ_n a_n(r, t) e^{inθ} with independent coefficients.
    A blade at θ_i = ψ + φ_i reads it where it is, so that its force G_i and its moment F_i about the link are Σ_n a_n
    e^{in(ψ + φ_i)}; the terms n that leave the same remainder p of n/N reach the blades in the same proportion, and
    together have at the frequency f_k the spectrum Σ_n S_n(f_k − nΩ),

        S_n^{ab}(f) = 2σ²T_c (1 + 6|f|T_c)^{−5/3} Σ_rs w^a_r w^b_s ⟨e^{−κ d_rs(θ)} cos nθ⟩,    κ = a √(f² +
        (0.12/T_c)²),

    with weights w^F ∝ r^p (r − d) and w^G ∝ r^p along the blade. In a wind V a gust changes the force in the rotor's
    plane by ½ρc (C_lα V + C_l Ωr) per m/s, so that p lies between 0 and 1 where the chord c is the same all along.
    Small eddies that one blade meets alone push with ε²/f_e (1 + (f/f_e)²)^{−5/3}, at a lever of their own. The forces
    push the hub by −Σ_i G_i sin θ_i sideways and Σ_i G_i cos θ_i up.
    """

    def __init__(self, freedoms: Sequence[Coordinate], rotor: WindRotor, base: Array, orders: NDArray[np.intp]) -> None:
        """`freedoms` are the model's (n,), `base` (B,) [Hz] and `orders` (2K+1,) the lifted frequencies."""
        blades, hinge, lever, rotor_hz, moment, fastest = rotor
        self._blades, self._rotor_hz = blades, rotor_hz
        reach = int(orders[-1]) + 1
        self._orders = np.arange(-reach, reach + 1)
        self._base = base
        self._shifted = base[:, None] + rotor_hz * np.arange(-reach - MAX_WIND_HARMONIC, reach + MAX_WIND_HARMONIC + 1)
        tip = hinge + 1.5 * lever
        self._radii = hinge + (np.arange(STATIONS) + 0.5) / STATIONS * (tip - hinge)
        self._hinge = hinge
        speed = 2.0 * math.pi * rotor_hz * tip / 5.0
        length = 8.1 * 0.7 * min(60.0, 2.0 * tip)
        self.statistics = (
            Statistic("load_rms_wind", "N*m", moment, spread=1.5, kind="level"),
            Statistic("load_wind_time", "s", length / speed, spread=0.7),
            Statistic("load_decay", "s/m", 12.0 / speed, spread=0.5),
            Statistic("load_power", "1", 0.4, spread=0.8),
            Statistic("load_lever", "m", lever, spread=0.3),
            Statistic("load_rms_eddies", "N*m", 0.1 * moment, spread=3.0, kind="level"),
            Statistic("load_eddies_frequency", "Hz", fastest, spread=1.5),
            Statistic("load_eddies_lever", "1", 1.0, spread=0.3),
        )
        self.placement = _wind_placement(freedoms, blades, orders, self._orders)
        self._terms = lru_cache(maxsize=4)(self._coherent)
        self._parts = lru_cache(maxsize=16)(self._turbulence)

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Of force G and moment F, classes p = 0 … N − 1, harmonics −K−1 … K+1."""
        time, decay, power = values["load_wind_time"], values["load_decay"], values["load_power"]
        per_force = 1.0 / values["load_lever"]
        size = values["load_rms_wind"] ** 2
        force, both, moment = self._parts(time, decay, power, every)
        corner = values["load_eddies_frequency"]
        f = self._base[every // 2 :: every, None] + self._rotor_hz * self._orders
        own = values["load_rms_eddies"] ** 2 / corner * (1.0 + (f / corner) ** 2) ** (-5.0 / 3.0) / self._blades
        own = np.tile(own, self._blades)
        outer = per_force / values["load_eddies_lever"] / EDDY_MOMENT_FACTOR
        G = size * per_force**2 * force + EDDY_MOMENT_FACTOR * outer**2 * own
        GF = size * per_force * both + outer * own
        return SourceSpectra(np.concatenate([G, size * moment + own], axis=1), GF)

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """By central differences."""
        return slopes_by_differences(self, values, every)

    def _turbulence(self, time: float, decay: float, power: float, every: int) -> tuple[Array, Array, Array]:
        """Spectra GG, GF and FF of all sources (B, N (2K+3)) for σ = 1 and forces of 1 N per N·m."""
        grid, terms = self._terms(power)
        f = np.abs(self._shifted[every // 2 :: every])
        kappa = decay * np.hypot(f, 0.12 / time)
        place = np.clip((np.log(kappa) - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.001)
        level = 2.0 * time * (1.0 + 6.0 * f * time) ** (-5.0 / 3.0)
        out = np.zeros((3, len(f), self._blades, len(self._orders)))
        _classes()(level, place, terms, out)
        force, both, moment = out.reshape(3, len(f), -1)
        return force, both, moment

    def _coherent(self, power: float) -> tuple[Array, Array]:
        """ln κ (g,), and Σ_rs w_r w_s ⟨e^{−κ d_rs(θ)} cos nθ⟩ of GG, GF and FF (g, 3, `MAX_WIND_HARMONIC` + 1)."""
        r = self._radii
        along = r**power
        outer = along * (r - self._hinge)
        weights = np.stack([along / along.sum(), outer / outer.sum()])
        grid, table = coherence_table(tuple(r.tolist()))
        pairs = np.einsum("cr,cs->crs", weights[[0, 0, 1]], weights[[0, 1, 1]])
        return grid, np.ascontiguousarray(np.einsum("crs,grsn->gcn", pairs, table, optimize=True))


@lru_cache(maxsize=1)
def _classes() -> Any:
    """The compiled loops of `WindLoads`."""
    matrix, cube = types.float64[:, ::1], types.float64[:, :, ::1]
    return compiled(_sum_classes, types.void(matrix, matrix, cube, types.float64[:, :, :, ::1]))


def _sum_classes(level: Any, place: Any, terms: Any, out: Any) -> None:
    """Spectra GG, GF and FF (3, B, N, slots) of the classes n mod N, summed over n; `terms` (g, 3, |n|) are taken at
    `place` of their grid for every frequency f_k − nΩ."""
    bins, blades, slots = out.shape[1], out.shape[2], out.shape[3]
    highest = terms.shape[2] - 1
    for b in range(bins):
        for n in range(-highest, highest + 1):
            for k in range(slots):
                at = k + highest - n
                below = int(place[b, at])
                part, size = place[b, at] - below, level[b, at]
                for i in range(3):
                    low = terms[below, i, abs(n)]
                    out[i, b, n % blades, k] += size * (low + part * (terms[below + 1, i, abs(n)] - low))


@lru_cache(maxsize=8)
def coherence_table(radii: tuple[float, ...]) -> tuple[Array, Array]:
    """ln κ (g,), and ⟨e^{−κ d(θ)} cos nθ⟩ for every two radii (g, r, r, `MAX_WIND_HARMONIC` + 1)."""
    r = np.array(radii)
    angle = 2.0 * np.pi * np.arange(RING_POINTS) / RING_POINTS
    squared = (r[:, None] - r) ** 2
    distance = np.sqrt(squared[..., None] + 4.0 * np.outer(r, r)[..., None] * np.sin(0.5 * angle) ** 2)
    grid = np.linspace(math.log(1e-3 / r[-1]), math.log(3e2 / r[-1]), 120)
    cosine = np.cos(np.outer(angle, np.arange(MAX_WIND_HARMONIC + 1))) / RING_POINTS
    return grid, np.exp(-np.exp(grid)[:, None, None, None] * distance) @ cosine


def _wind_placement(
    freedoms: Sequence[Coordinate], blades: int, orders: NDArray[np.intp], source_orders: NDArray[np.intp]
) -> Complex:
    """U from forces and moments, each by class and harmonic, to the generalised loads of all harmonics."""
    n, slots = len(freedoms), len(source_orders)
    count = blades * slots
    U = np.zeros((len(orders) * n, 2 * count), dtype=np.complex128)
    phase = 2.0 * np.pi * np.arange(blades) / blades
    for p in range(blades):
        shape = np.exp(1j * p * phase)
        ahead, behind = np.sum(shape * np.exp(1j * phase)), np.sum(shape * np.exp(-1j * phase))
        for k, order in enumerate(orders):
            slot = p * slots + int(order - source_orders[0])
            for j, freedom in enumerate(freedoms):
                row = k * n + j
                if freedom.blade:
                    U[row, count + slot] = shape[freedom.blade - 1]
                elif freedom.name in ("x", "y"):
                    factor = 0.5j if freedom.name == "x" else 0.5
                    sign = -1.0 if freedom.name == "x" else 1.0
                    U[row, slot - 1] += factor * ahead
                    U[row, slot + 1] += factor * sign * behind
    U[np.abs(U) < 1e-12] = 0.0
    return U


class BandLoads:
    """Loads of which nothing is known but that their spectra are smooth over a band: on every degree of freedom a level
    at either end, a power law between.

    Their statistics are spectral amplitudes (square roots of densities) in N/√Hz or N·m/√Hz.
    """

    def __init__(
        self, given: Mapping[str, Sequence[float]], freedoms: Sequence[Coordinate],
        bands: Sequence[tuple[float, float]], frequency: Array
    ) -> None:  # fmt: skip
        """`given` amplitudes of each load (2 bands: low, high, low …), the model's `freedoms` (n,), `bands` [Hz],
        signed `frequency` (B, 2K+1) [Hz]."""
        units = {freedom.load: freedom.load_unit for freedom in freedoms}
        self._bands, self._frequency, self._loads = bands, np.abs(frequency), list(given)
        self._known = dict[int, tuple[NDArray[np.intp], Array]]()
        ends = [f"{frequency:.3g}Hz" for band in bands for frequency in band]
        self.statistics = tuple(
            Statistic(f"{load.replace('load_', 'load_density_')}_{end}", f"{units[load]}/√Hz", float(value))
            for load, values in given.items()
            for end, value in zip(ends, values, strict=True)
        )
        self.placement = _side_by_side(list(given), list(units), frequency.shape[1])

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Power laws through the levels at the ends of each band; between bands the nearer one's."""
        amplitudes = np.log([values[s.name] for s in self.statistics]).reshape(len(self._loads), len(self._bands), 2)
        which, part = self._parts(every)
        own = [np.exp(2.0 * (level[which, 0] + part * (level[which, 1] - level[which, 0]))) for level in amplitudes]
        return SourceSpectra(np.concatenate(own, axis=1), np.empty((len(which), 0)))

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """2 S, as much as the end of a band has of each frequency."""
        spectra, (which, part) = self.spectra(values, every).own, self._parts(every)
        bins, count = which.shape
        own = np.zeros((len(self._loads), len(self._bands), 2, bins, len(self._loads), count))
        for i in range(len(self._loads)):
            S = 2.0 * spectra[:, i * count : (i + 1) * count]
            for band in range(len(self._bands)):
                own[i, band, 0, :, i] = np.where(which == band, (1.0 - part) * S, 0.0)
                own[i, band, 1, :, i] = np.where(which == band, part * S, 0.0)
        return SourceSpectra(own.reshape(len(self.statistics), bins, -1), np.empty((len(self.statistics), bins, 0)))

    def _parts(self, every: int) -> tuple[NDArray[np.intp], Array]:
        """Index of each frequency's band, and its position from the low to the high end, 0 … 1."""
        if every in self._known:
            return self._known[every]
        frequency = self._frequency[every // 2 :: every]
        middles = [math.sqrt(a[1] * b[0]) for a, b in zip(self._bands[:-1], self._bands[1:], strict=True)]
        which = np.searchsorted(middles, frequency)
        low, high = (np.log([band[end] for band in self._bands])[which] for end in (0, 1))
        with np.errstate(divide="ignore"):
            part = np.clip((np.log(frequency) - low) / (high - low), -1.0, 2.0)
        self._known[every] = which, part
        return which, part
