"""Loads of a turning rotor in narrow bands: flanks of the humps that turning blades cut out of the wind, and a level.

The wind varies slowly, and blades cut through it n times a turn. A load of the class p of blades (`band_rows`)
therefore has its energy in humps at the harmonics n ≡ p (mod N) of the rotor, and the support, where it stands, at
multiples of N. Its flanks are those of the wind's term n (`windsysid.spectral.rotor.load_spectra.WindLoads`),

    g_n(δ) = (1 + 6|δ|T_c)^{−5/3} ΣΣ w_r w_s ⟨e^{−κd(θ)} cos nθ⟩,      δ = f − nΩ,  κ = a √(δ² + (0.12/T_c)²):

f^(−5/3) far away, and flatter near the harmonic the higher n is, since only small eddies differ so fast around the
rotor. T_c and a follow from a wind of a fifth of the tip's speed.

In a band S(f) = a + b g_n(f) + c g_{n+N}(f), with the humps below and above: three levels, all positive, all learned.
A power law would take the skirt of a peak for that of a mode. Where no peak is meant, S is a level at either end and a
straight line between.

A force on a blade pushes what carries it, too: the moment F_i about the link is a force F_i / lever along the tangent,
on the hub at k ± 1, and a moment F_i (1 + d / lever) on a roll (`windsysid.loads.rotor_forces`).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.model import Coordinate
from windsysid.spectral.rotor.load_spectra import MAX_WIND_HARMONIC, STATIONS, SourceSpectra, coherence_table
from windsysid.spectral.rotor_bands.channels import ABOUT_BLADES
from windsysid.spectral.transforms.lifted import Complex

__all__ = ["BandSource", "HumpLoads", "Wind", "blade_class", "hump_terms", "line_terms", "one_force", "wind_of"]

TIP_SPEED_RATIO = 5.0
"""Setting: tip-speed ratio; that of any real turbine gives nearly the same skirts."""


class Wind(NamedTuple):
    """Parameters of the skirts of rotationally sampled peaks.

    Attributes
    ----------
    memory, decay
        T_c [s] and a [s/m].
    grid, table
        ln κ (g,), and ΣΣ w_r w_s ⟨e^{−κd(θ)} cos nθ⟩ (g, n).
    """

    memory: float
    decay: float
    grid: Array
    table: Array

    def flank(self, off: Array, order: int) -> Array:
        """g_n at distances δ [Hz] from the harmonic."""
        kappa = self.decay * np.hypot(off, 0.12 / self.memory)
        shape = np.interp(np.log(kappa), self.grid, self.table[:, min(max(abs(order), 1), MAX_WIND_HARMONIC)])
        return np.asarray((1.0 + 6.0 * self.memory * np.abs(off)) ** (-5.0 / 3.0) * shape)


def wind_of(hinge_offset: float, lever: float, rotor_hz: float) -> Wind:
    """The wind on a rotor whose loads act at `lever` [m] from links `hinge_offset` [m] from the hub."""
    tip = hinge_offset + 1.5 * lever
    speed = 2.0 * math.pi * rotor_hz * tip / TIP_SPEED_RATIO
    radii = hinge_offset + (np.arange(STATIONS) + 0.5) / STATIONS * (tip - hinge_offset)
    weights = radii * (radii - hinge_offset)
    grid, table = coherence_table(tuple(radii.tolist()))
    contracted = np.einsum("r,s,grsn->gn", weights / weights.sum(), weights / weights.sum(), table)
    return Wind(8.1 * 0.7 * min(60.0, 2.0 * tip) / speed, 12.0 / speed, grid, contracted)


class BandSource(NamedTuple):
    """A load with a spectrum of its own in a band.

    Attributes
    ----------
    name, unit
        Of its statistics, and of its spectral amplitude.
    placement
        Where it pushes, all harmonics in turn (k n,).
    terms
        What its spectrum is the sum of, each at the frequencies of the model (t, F).
    given
        Spectral amplitude of each term where it is 1 [unit/√Hz], to begin with.
    """

    name: str
    unit: str
    placement: Complex
    terms: Array
    given: float


class HumpLoads:
    """Loads of a band, as `windsysid.spectral.rotor.load_spectra.Sources` have them: independent of each other."""

    def __init__(self, sources: Sequence[BandSource]) -> None:
        self._terms = [source.terms for source in sources]
        self.placement = np.column_stack([source.placement for source in sources])
        self.statistics = tuple(
            Statistic(f"load_density_{source.name}_{i}", source.unit, source.given)
            for source in sources
            for i in range(1, len(source.terms) + 1)
        )

    def spectra(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """Sums of the terms, each with the square of its amplitude."""
        squares = iter([values[s.name] ** 2 for s in self.statistics])
        own = [
            sum((next(squares) * term for term in terms), np.zeros(terms.shape[1]))[every // 2 :: every]
            for terms in self._terms
        ]
        return SourceSpectra(np.ascontiguousarray(np.array(own).T), np.empty((len(own[0]), 0)))

    def slopes(self, values: Mapping[str, float], every: int = 1) -> SourceSpectra:
        """2 S of each term."""
        squares = [values[s.name] ** 2 for s in self.statistics]
        bins = len(self._terms[0][0, every // 2 :: every])
        own = np.zeros((len(squares), bins, len(self._terms)))
        i = 0
        for source, terms in enumerate(self._terms):
            for term in terms:
                own[i, :, source] = 2.0 * squares[i] * term[every // 2 :: every]
                i += 1
        return SourceSpectra(own, np.empty((len(squares), bins, 0)))


def hump_terms(
    wind: Wind, frequency: Array, low: float, high: float, rotor_hz: float, first: int, blades: int
) -> Array:
    """1, and the flanks of the humps at n ≡ `first` (mod N) below and above the middle of a band (3, F); each is 1 in
    the middle of what it is between `low` and `high` [Hz]."""
    within = np.linspace(low, high, 101)
    n = first + blades * math.floor((0.5 * (low + high) / rotor_hz - first) / blades)
    terms = [np.ones_like(frequency)]
    for order in (n, n + blades):
        usual = float(np.median(wind.flank(within - order * rotor_hz, order)))
        terms.append(wind.flank(frequency - order * rotor_hz, order) / usual)
    return np.array(terms)


def line_terms(frequency: Array, low: float, high: float) -> Array:
    """A level at either end of a band and straight lines to nothing at the other (2, F)."""
    part = np.clip((frequency - low) / (high - low), 0.0, 1.0)
    return np.array([1.0 - part, part])


def blade_class(
    freedoms: Sequence[Coordinate], shape: int, blades: int, lever: float, hinge_offset: float, kappa: float
) -> Complex:
    """Loads of unit moments about the links of class p at k = 0, with the forces that come with them (5 n,)."""
    placement = np.zeros((len(ABOUT_BLADES), len(freedoms)), dtype=np.complex128)
    middle = len(ABOUT_BLADES) // 2
    turn = np.exp(2j * math.pi * np.arange(blades) / blades)
    moments = turn**shape / math.sqrt(blades)
    on_roll = (lever + hinge_offset) / lever * moments.sum()
    for j, freedom in enumerate(freedoms):
        if freedom.blade:
            placement[middle, j] = moments[freedom.blade - 1]
        elif freedom.name == "roll":
            placement[middle, j] = on_roll
        else:
            for side, towards in ((1, turn), (-1, turn.conj())):
                share = 0.5j * side if freedom.name == "x" else 0.5
                placement[middle + side, j] = share * np.sum(towards * moments) / lever
            if freedom.name == "x":
                placement[middle, j] += kappa * on_roll
    placement[np.abs(placement) < 1e-12 * np.abs(placement).max()] = 0.0
    return placement.ravel()


def one_force(freedoms: Sequence[Coordinate], name: str, orders: NDArray[np.intp], order: int) -> Complex:
    """Load of a unit load on one degree of freedom at one of the harmonics (k n,)."""
    placement = np.zeros((len(orders), len(freedoms)), dtype=np.complex128)
    placement[orders.tolist().index(order), [freedom.name for freedom in freedoms].index(name)] = 1.0
    return placement.ravel()
