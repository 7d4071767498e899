"""The likelihood of cross-spectra under equations of one's own, with its gradient and Fisher's information.

Unknowns are θ, and η: logarithms of factors on the noise of every reading and then on every load. Rows of P = mean Y Yᴴ
that count as N are explained by S = t tᴴ + noise, t = T h (Whittle's likelihood; `windsysid.spectral.lti.system`):

    J = c_h⁻¹ Σ N [ln det S + tr S⁻¹ P],     g_a = c_h⁻¹ Σ N tr A_a (1 − L⁻¹ P L⁻ᴴ),     F_ab = c_h⁻¹ Σ N tr A_a A_b

with S = L Lᴴ. Every derivative is A_a = L⁻¹ ∂S/∂u_a L⁻ᴴ = Σ_j p_j q_jᴴ + q_j p_jᴴ over the vectors of a, so that

    tr A_a A_b = 2 Re Σ_jk (q_jᴴ p_k)(q_kᴴ p_j) + (q_jᴴ q_k)(p_kᴴ p_j).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.mechanics.compile import CompiledModel
from windsysid.spectral.lti.system import LinearSystem, is_stable, linearise, low_rank, resolve
from windsysid.spectral.rotor.load_filters import LoadShape
from windsysid.spectral.transforms.cross_spectra import CrossSpectra, FixedBlock, PooledBins, pool
from windsysid.spectral.transforms.dft import WINDOW_BINS, window_weights
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns

__all__ = ["LinearModel"]

DIFFERENCE_STEP = 1e-4
"""Numerical: step of central differences in standard deviations of the prior, or in units if these are wider than 1."""

BINS_PER_POOL = 3.0
"""Setting: bins in the distance to the nearest pole for each bin of a pool that shares one spectrum."""

MAX_POOL_WIDTH = 0.03
"""Setting: largest width of a pool over its frequency if resonances are not widened."""

MAX_NUMBERS = 2_000_000
"""Numerical: complex numbers in memory at once."""


class LinearModel(NamedTuple):
    """Equations, sensors and loads as a spectrum of the unknowns.

    Attributes
    ----------
    compiled, given
        The equations with the readings, and all parameters (n_p,).
    inputs, loads_at, start
        The working point: constant inputs and loads, and where the state is looked for.
    parameters
        What θ stands for.
    noise, drift
        Of each reading: one-sided density of the white noise as given [unit²/Hz], and drift²/(2π²) (m,), over f².
    loads
        The load models.
    levels
        Prior standard deviations of η (n_η,): of the noise and the loads; none where levels are as given.
    blur
        By how much a finite record widens every resonance [rad/s]. It is as good as an added damping, and leaves little
        for `smear`.
    """

    compiled: CompiledModel
    given: Array
    inputs: Array
    loads_at: Array
    start: Array
    parameters: tuple[Parameter, ...]
    noise: Array
    drift: Array
    loads: tuple[LoadShape, ...]
    levels: Array
    blur: float = 0.0

    @property
    def unknowns(self) -> Unknowns:
        """Names of the unknowns; those of η are noise of each reading, then the level of each load."""
        levels = [f"noise_{i + 1}" for i in range(len(self.noise))] + [f"level_{i + 1}" for i in range(len(self.loads))]
        return Unknowns(tuple(q.name for q in self.parameters), (), tuple(levels) if len(self.levels) else ())

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the unknowns (n,)."""
        mean, std = np.array([q.prior for q in self.parameters]).T
        return np.concatenate([mean, np.zeros(len(self.levels))]), np.concatenate([std, self.levels])

    def poles(self, unknowns: Array) -> Complex:
        """Of the equations and the loads [rad/s]."""
        own = np.linalg.eigvals(self._systems(unknowns[None]).A[0])
        return np.concatenate([own, *(load.poles for load in self.loads)]).astype(np.complex128)

    def stable(self, unknowns: Array) -> bool:
        """Test whether the equations have a stationary vibration there."""
        poles = np.linalg.eigvals(self._systems(unknowns[None]).A[0])
        return is_stable(np.asarray(poles, dtype=np.complex128))

    def natural_frequencies(self, points: Array) -> Array:
        """Logarithms of |λ| of what oscillates, rising, at sets of unknowns (V, n or more): (V, least number)."""
        found = []
        for A in self._systems(points).A:
            poles = np.linalg.eigvals(A)
            found.append(np.sort(np.log(np.abs(poles[poles.imag > 1e-6 * np.abs(poles)]))))
        least = min(len(logarithms) for logarithms in found)
        return np.array([logarithms[:least] for logarithms in found])

    def rows(self, spectra: CrossSpectra, unknowns: Array, widening: float = 0.0) -> PooledBins:
        """Bins pooled where the spectrum at the unknowns is smooth."""
        block = spectra.last
        s = (1j + widening) * 2.0 * np.pi * block.frequency + self.blur
        poles = self.poles(unknowns)
        distance = np.min([np.abs(s - pole) for pole in poles], axis=0) / (2.0 * np.pi)
        step = block.rate / block.samples
        return pool(
            spectra,
            np.minimum(distance / BINS_PER_POOL, max(MAX_POOL_WIDTH, widening / BINS_PER_POOL) * block.frequency)
            / step,
        )

    def likelihood(
        self, rows: PooledBins, factor: float, unknowns: Array, smear: Complex | None = None, widening: float = 0.0
    ) -> tuple[float, Array, Array]:
        """J, g (n,) and F (n, n) of rows of which `factor` count as one, without the prior.

        Parameters
        ----------
        smear
            What a finite record adds to S (K, m, m).
        widening
            Share of the frequency by which all resonances are made wider: far from the truth a peak then meets its own.

        Raises
        ------
        LinAlgError
            Where there is no stationary vibration, or a spectrum is not positive definite.
        """
        known, m = self.unknowns, len(self.noise)
        n, theta = len(known.parameters), unknowns[known.of("parameters")]
        steps = DIFFERENCE_STEP * np.minimum(self.prior[1][known.of("parameters")], 1.0)
        points = np.concatenate([theta + np.diag(steps), theta - np.diag(steps), theta[None]])
        systems = self._systems(points)
        block = systems.block
        slopes = low_rank((block[:n] - block[n : 2 * n]) / (2.0 * steps[:, None, None]))
        at = LinearSystem(*(matrix[-1:] for matrix in systems))
        sources = [load.rank for load in self.loads]
        owner = slopes.owner
        if len(self.levels):
            noise_places, load_places = np.split(known.places("statistics"), [m])
            owner = np.concatenate([owner, np.repeat(load_places, sources), noise_places])
        indicator = (np.arange(len(unknowns))[:, None] == owner).astype(np.float64)
        J, g, F = 0.0, np.zeros(len(owner)), np.zeros((len(owner), len(owner)))
        size = max(1, MAX_NUMBERS // max(1, len(owner) ** 2, len(at.A[0]) ** 2))
        for first in range(0, len(rows.frequency), size):
            some = slice(first, first + size)
            frequency, counts = rows.frequency[some], rows.counts[some]
            L, R, t = self._parts(at, frequency, unknowns, widening)
            noise = self._noise(frequency, unknowns)
            S = t @ _h(t) + noise[1][:, :, None] * np.eye(m)
            if smear is not None:
                S = S + smear[some]
            L_inv: Complex = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.complex128)
            shown = np.asarray(L_inv @ rows.power[some] @ _h(L_inv))
            logarithms = np.log(np.einsum("kii->ki", L_inv).real).sum(axis=1)
            J += float(counts @ (np.einsum("kii->k", shown).real - 2.0 * logarithms))
            p, q = [L_inv @ (L @ slopes.left)], [L_inv @ (t @ (_h(R) @ slopes.right))]
            if len(self.levels):
                levels = [L_inv @ t, np.asarray(L_inv * np.sqrt(noise[0])[:, None, :])]
                p, q = [*p, *levels], [*q, *levels]
            P, Q = np.concatenate(p, axis=2), np.concatenate(q, axis=2)
            g += 2.0 * np.einsum("k,kmj,kmj->j", counts, Q.conj(), P - shown @ P).real
            weighted = counts[:, None, None] * _h(Q)
            QP = weighted @ P
            F += 2.0 * np.einsum("kij,kji->ij", QP, _h(Q) @ P).real
            F += 2.0 * np.einsum("kij,kji->ij", weighted @ Q, _h(P) @ P).real
        return J / factor, indicator @ g / factor, indicator @ F @ indicator.T / factor

    def spectrum(self, frequency: Array, unknowns: Array) -> Complex:
        """S (K, m, m), one-sided [unit²/Hz]."""
        size = max(1, MAX_NUMBERS // max(1, len(self.compiled.states)) ** 2)
        at = self._systems(unknowns[None, self.unknowns.of("parameters")])
        parts = []
        for first in range(0, len(frequency), size):
            some = frequency[first : first + size]
            t = self._parts(at, some, unknowns, 0.0)[2]
            parts.append(t @ _h(t) + self._noise(some, unknowns)[1][:, :, None] * np.eye(len(self.noise)))
        return np.concatenate(parts)

    def smear(self, spectra: CrossSpectra, rows: PooledBins, unknowns: Array) -> Complex:
        """The mean of what the taper's window makes of S at the bins of each row, over S in the row's middle.

        Rows of many bins are far from any resonance: there S hardly bends within the window, and its mean is taken.
        """
        number = np.diff(rows.first)
        step = spectra.last.rate / spectra.last.samples
        points, weights = np.polynomial.legendre.leggauss(3)
        places = rows.frequency[:, None] + 0.5 * step * number[:, None] * points
        middle, sharp = self.spectrum(rows.frequency, unknowns), self._replace(blur=0.0)
        around = sharp.spectrum(places.ravel(), unknowns).reshape(len(number), 3, *middle.shape[1:])
        mean = np.einsum("g,kgij->kij", 0.5 * weights, around)
        near = np.flatnonzero(number <= 2.0 * WINDOW_BINS / BINS_PER_POOL)
        for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1):
            if len(run):
                mean[run] = sharp._windowed(spectra.last, rows.first[run[0] : run[-1] + 2], unknowns)
        return np.asarray(mean - middle)

    def _windowed(self, block: FixedBlock, first: NDArray[np.int64], unknowns: Array) -> Complex:
        """Means over rows, which begin at bins `first` (K + 1,) and follow each other, of S smoothed by the window."""
        bins = block.bins[first[0] : first[-1]]
        fine, starts, weights = window_weights(block.samples, block.rate, bins)
        S = self.spectrum(fine, unknowns)
        smooth = np.zeros((len(bins), *S.shape[1:]), dtype=np.complex128)
        for w in range(weights.shape[1]):
            smooth += weights[:, w, None, None] * S[starts + w]
        return np.asarray(np.add.reduceat(smooth, first[:-1] - first[0], axis=0) / np.diff(first)[:, None, None])

    def _systems(self, theta: Array) -> LinearSystem:
        """At sets of unknowns (V, n_θ or more)."""
        p = np.tile(self.given, (len(theta), 1))
        for i, q in enumerate(self.parameters):
            p[:, self.compiled.parameters.index(q.name)] = q.physical(theta[:, i])
        return linearise(self.compiled, p, self.inputs, self.loads_at, self.start)

    def _parts(
        self, at: LinearSystem, frequency: Array, unknowns: Array, widening: float
    ) -> tuple[Complex, Complex, Complex]:
        """[C X | 1], [X G ; 1] h and T h at frequencies (K,)."""
        m = len(self.noise)
        s = np.asarray((1j + widening) * 2.0 * np.pi * frequency + self.blur)
        left, right, T = resolve(at, s)
        factor = np.exp(unknowns[self.unknowns.of("statistics")][m:]) if len(self.levels) else np.ones(len(self.loads))
        driven = [
            np.sqrt(2.0) * f * load(np.asarray(2j * np.pi * frequency))
            for load, f in zip(self.loads, factor, strict=True)
        ]
        h = np.concatenate(driven, axis=2)
        one = np.broadcast_to(np.eye(m), (len(s), m, m))
        return np.concatenate([left, one], axis=2), np.concatenate([right @ h, h], axis=1), T @ h

    def _noise(self, frequency: Array, unknowns: Array) -> tuple[Array, Array]:
        """Density of the white noise, and of white noise and drift (K, m)."""
        m = len(self.noise)
        level = self.noise * (np.exp(2.0 * unknowns[self.unknowns.of("statistics")][:m]) if len(self.levels) else 1.0)
        white = np.broadcast_to(level, (len(frequency), m))
        return white, white + self.drift / frequency[:, None] ** 2


def _h(matrix: Complex) -> Complex:
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)))
