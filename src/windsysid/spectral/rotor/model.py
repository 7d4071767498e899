"""The lifted spectrum of a record as a function of the unknowns: coefficients, mean lag angle, statistics of loads and
noise."""

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.loads.statistics import Statistic, to_logarithms, values_of
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.model import Coordinate
from windsysid.mechanics.rotor import MEAN_LAG, MEAN_LAG_STD
from windsysid.spectral.rotor.harmonic_transfer import (
    MIN_RELATIVE_CHANGE,
    MatrixHarmonics,
    affine_matrices,
    element_sizes,
    equal_lag,
    matrix_harmonics,
    without_rounding,
)
from windsysid.spectral.rotor.kernel_sparse import MAX_LOOP_ENTRIES
from windsysid.spectral.rotor.likelihood import (
    Ingredients,
    Likelihood,
    ModelSpectrum,
    Slopes,
    SpectrumGrid,
    spectrum_of_bins,
    whittle,
    whittle_by_bins,
    whittle_given,
    whittle_of_many,
)
from windsysid.spectral.rotor.load_spectra import Sources, SourceSpectra
from windsysid.spectral.transforms.dft import taper
from windsysid.spectral.transforms.lifted import Complex
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import BlockName, Unknowns

__all__ = ["GRID_FACTOR", "Inexact", "LiftedModel", "finer_bins", "taper_weights"]

MECHANICAL: tuple[BlockName, ...] = ("parameters", "lag", "tolerances")
"""Unknowns of the matrices."""

DIFFERENCE_STEP = 1e-4
"""Numerical: step for central differences of a logarithm, of a damping ratio; in standard deviations of its prior."""

MAX_NUMBERS = 400_000
"""Numerical: complex numbers of derivatives in memory at once."""

GRID_FACTOR = 2
"""Numerical: bins of the grid on which spectra are smoothed per bin of the record: the taper's window is exact on
it."""

WINDOW_BINS = 8
"""Numerical: bins on either side over which the taper's window is summed; 2 % of a Tukey window's power lies beyond."""

MAX_JOINT_BINS, MAX_JOINT_ENTRIES, EARLIER_SHARE = 48, 160, 1 / 3
"""Numerical: largest number of bins, and of entries, of one joint covariance, whose cost per entry grows with their
squared number; and share of its bins that are in the one before, too, and are conditioned on."""

NEIGHBOUR_SHARE = 0.25
"""Setting: share of the bins over which neighbours are compared."""


Matrices = tuple[MatrixHarmonics, MatrixHarmonics]
"""A model's matrices at its unknowns, and their derivatives to the mechanical ones."""


class Inexact(NamedTuple):
    """Instruments and masses that are known within tolerances only: τ, in standard deviations of those.

    Attributes
    ----------
    parameters
        By how much each τ moves all parameters (n_τ, n_p).
    late
        By how much it makes each reading later (n_τ, m) [s]; the clocks come last.
    names
        Names of the tolerances (n_τ,).
    """

    parameters: Array
    late: Array
    names: tuple[str, ...] = ()

    @property
    def clocks(self) -> int:
        """Number of clock lags."""
        return int(self.late.any(axis=1).sum())


EXACT = Inexact(np.empty((0, 0)), np.empty((0, 0)))
"""Setting: instruments and masses exactly as stated in the files."""


class JointWeights(NamedTuple):
    """Pairs b ≤ c of bins (P,) that the taper's window links, w_b w_c of each at places of the finer grid (P, F),
    sparse, and the number of bins."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    products: Any
    bins: int

    @classmethod
    def of(cls, weights: Array) -> "JointWeights":
        """Pairs of the bins whose weights (F, B) overlap."""
        from scipy.sparse import csr_array, triu

        each = csr_array(weights.T)
        rows, columns = (np.asarray(pair, dtype=np.intp) for pair in triu(abs(each) @ abs(each).T).nonzero())
        return cls(rows, columns, each[rows].multiply(each[columns]).tocsr(), weights.shape[1])

    def covariances(self, spectra: NDArray[Any]) -> Iterator[tuple[int, int, NDArray[Any]]]:
        """Covariance matrices Σ_f S(f) w_b(f) w_c(f) (n, N e, N e) from spectra on the grid (n, F, e, e), for groups of
        bins: the first, which of them have not been in a group before, and the matrices."""
        n, F, e, _ = spectra.shape
        flat = np.ascontiguousarray(np.swapaxes(spectra, 0, 1)).reshape(F, -1)
        pairs = (self.products @ flat.view(np.float64)).view(flat.dtype).reshape(-1, n, e, e)
        most, first, known = min(MAX_JOINT_BINS, max(2, MAX_JOINT_ENTRIES // e)), 0, 0
        while known < self.bins:
            size = min(most, self.bins - first)
            at = (self.rows >= first) & (self.columns < first + size)
            row, column = self.rows[at] - first, self.columns[at] - first
            C = np.zeros((n, size, e, size, e), dtype=pairs.dtype)
            C[:, row, :, column] = C[:, column, :, row] = pairs[at]
            yield first, known - first, C.reshape(n, size * e, size * e)
            known = first + size
            first = known - int(EARLIER_SHARE * most)


class LiftedModel(NamedTuple):
    """Record in the frequency domain, and the arguments of its likelihood.

    Attributes
    ----------
    data
        Active entries Y (B, e, g): up to g neighbouring bins share a spectrum; columns beyond are 0.
    place
        Where spectra are taken: at the bins, or, where they are smoothed, on a finer grid.
    window, joint
        Weights (F, B), sparse or dense: the smoothed spectra at the bins are sums of the F on the finer grid; and those
        with which bins are correlated. None where nothing is smoothed, and for independent bins.
    smear
        What the taper's window adds to the spectra, where it is taken as known (B, e, e); None where it is not, or
        where `window` smooths.
    left_out
        Entries of which nothing is said, bin by bin (B, e); `data` is 0 there.
    overlap
        c_h.
    combine
        The readings' combinations (r, m) that are the entries of one harmonic.
    compiled, freedoms, given
        The model with its readings, its degrees of freedom, and all its parameters (n_p,).
    inputs
        Its inputs but for azimuth and speed (n_u,).
    parameters, lag, inexact
        Elements of θ, whether the mean lag angle is an unknown, and elements of τ.
    sources
        The loads, at the frequencies of `place`.
    noise, noise_given
        Statistics of the sensors' noise, and the spectral density of each, as given, on every entry (n, F, e)
        [unit²/Hz]; they add up.
    shared
        How many bins share each spectrum (B,); None where all g do.
    blocks
        Of how many blocks `data` are: of more than one they are no bins but what has the same products Y Yᴴ.
    recent, gusts
        Where there are several, the bins of the last, and how much larger c_h is for what changes between them.
    """

    data: Complex
    place: SpectrumGrid
    window: Any
    smear: Complex | None
    left_out: NDArray[np.bool_]
    overlap: float
    combine: Complex
    compiled: CompiledModel
    freedoms: tuple[Coordinate, ...]
    given: Array
    inputs: Array
    parameters: tuple[Parameter, ...]
    lag: bool
    sources: Sources
    noise: tuple[Statistic, ...]
    noise_given: Array
    shared: Array | None = None
    blocks: float = 1.0
    recent: Complex | None = None
    gusts: float = 1.0
    inexact: Inexact = EXACT
    joint: JointWeights | None = None

    @property
    def unknowns(self) -> Unknowns:
        """Names of the unknowns."""
        numbers = len(self.inexact.names) - self.inexact.clocks
        return Unknowns(
            tuple(q.name for q in self.parameters),
            (MEAN_LAG,) * self.lag,
            tuple(s.name for s in self.statistics),
            self.inexact.names[:numbers],
            self.inexact.names[numbers:],
        )

    @property
    def counts(self) -> Array:
        """Number of bins that share each spectrum (B,)."""
        return np.full(len(self.data), float(self.data.shape[2])) if self.shared is None else self.shared

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Statistics of η."""
        return (*self.sources.statistics, *self.noise)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the unknowns."""
        known = [q.prior for q in self.parameters] + [(0.0, MEAN_LAG_STD)] * self.lag
        known += [(0.0, s.spread) for s in self.statistics]
        known += [(0.0, 1.0)] * len(self.inexact.late)
        mean, spread = np.array(known).T
        return mean, spread

    def split_statistics(self, unknowns: Array) -> tuple[Array, Array]:
        """η of the loads, and η of the noise."""
        eta = unknowns[self.unknowns.of("statistics")]
        loads = len(self.sources.statistics)
        return eta[:loads], eta[loads:]

    def likelihood(
        self, unknowns: Array, every: int = 1, *, slopes: bool = True, matrices: Matrices | None = None
    ) -> Likelihood:
        """J, g, F without the prior; of every n-th bin, as much as all of them would be.

        `matrices` are those at the unknowns, where they are known.

        Raises
        ------
        LinAlgError
            Where a spectrum is not positive definite.
        """
        if self.joint is not None:
            return self._ordered(self._joint_parts(self.joint, unknowns, matrices, slopes=slopes), 1.0, slopes=slopes)
        if self.window is not None:
            J, g, F = whittle(self.data, self.counts, self.spectrum(unknowns, slopes=slopes, matrices=matrices))
            return Likelihood(J / self.overlap, g / self.overlap, F / self.overlap)
        share = float(self.counts.sum() / self.counts[every // 2 :: every].sum()) / self.overlap
        return self._ordered(self._parts(unknowns, every, matrices, slopes=slopes), share, slopes=slopes)

    def _parts(self, unknowns: Array, every: int, matrices: Matrices | None, *, slopes: bool) -> Iterator[Likelihood]:
        """J, g and F of every n-th bin, a few of them at a time."""
        if slopes and len(self.place.entries) > MAX_LOOP_ENTRIES:
            for at, of in self._ingredients(unknowns, every, matrices, slopes=True):
                yield whittle_of_many(of, self.data[at], self.counts[at])
            return
        for at, model in self._spectra(unknowns, every, matrices, slopes=slopes):
            yield whittle(self.data[at], self.counts[at], model)

    def _ordered(self, parts: Iterable[Likelihood], share: float, *, slopes: bool) -> Likelihood:
        """Sum of parts that count as a share, with derivatives in the order of the unknowns."""
        value, gradient, information = (sum(each) for each in zip(*parts, strict=True))
        at = self._from_kernels() if slopes else slice(0)
        return Likelihood(share * value, share * gradient[at], share * information[at][:, at])

    def _joint_parts(
        self, joint: JointWeights, unknowns: Array, matrices: Matrices | None, *, slopes: bool
    ) -> Iterator[Likelihood]:
        """J, g and F of groups of bins given those before; entries that nothing links are apart."""
        parts = self._spectra(unknowns, 1, matrices, slopes=slopes)
        S = np.concatenate([np.concatenate([part.spectrum[None], part.slopes]) for _, part in parts], axis=1)
        for some in _linked(np.asarray(S.any(axis=(0, 1)))):
            of, e = S[:, :, some[:, None], some], len(some)
            moved = np.flatnonzero(of.any(axis=(1, 2, 3)))  # the first is S, and no derivative
            at = moved[1:] - 1
            for first, given, C in joint.covariances(of[moved] if of.imag.any() else of[moved].real):
                y = self.data[first : first + C.shape[1] // e, some].ravel()
                found, g, F = whittle_given(y, C[0], C[1:], given * e), np.zeros(len(S) - 1), np.zeros([len(S) - 1] * 2)
                g[at], F[np.ix_(at, at)] = found.gradient, found.information
                yield Likelihood(found.value, g, F)

    def scores(self, unknowns: Array) -> tuple[Array, Array]:
        """Gradient (P, n) and Fisher information (P, n, n) of the log-likelihood of each c_h neighbouring bins, which
        count as one."""
        g, F = whittle_by_bins(self.data, self.counts, self.spectrum(unknowns, slopes=True))
        first = np.arange(0, len(g), math.ceil(self.overlap))
        return -np.add.reduceat(g, first) / self.overlap, np.add.reduceat(F, first) / self.overlap

    def _from_kernels(self) -> NDArray[np.intp]:
        """Index of each unknown in the derivatives of the kernels, which have the statistics last (n,)."""
        return np.argsort(self.unknowns.places(*MECHANICAL, "clocks", "statistics"))

    def spectrum(self, unknowns: Array, *, slopes: bool = False, matrices: Matrices | None = None) -> ModelSpectrum:
        """S (B, e, e) of all bins, smoothed where it has to be, and its derivatives (n, B, e, e)."""
        parts = self._spectra(unknowns, 1, matrices, slopes=slopes)
        order = self._from_kernels() if slopes else slice(0)
        if self.window is None:
            whole = np.concatenate([np.concatenate([S[None], A]) for _, (S, A) in parts], axis=1)
            return ModelSpectrum(whole[0], whole[1:][order])
        found = np.zeros((1 + slopes * len(unknowns), *self.data.shape[:2], self.data.shape[1]), dtype=np.complex128)
        for at, (S, A) in parts:
            weights = self.window[at]
            near = np.flatnonzero(weights.sum(axis=0))
            found[:, near] += _smoothed(np.concatenate([S[None], A]), weights[:, near])
        return self._masked(found[0], found[1:][order])

    def _masked(self, S: Complex, A: Complex) -> ModelSpectrum:
        """S and its derivatives, entries that are left out with unit variance."""
        if self.left_out.any():
            kept = ~self.left_out[:, :, None] & ~self.left_out[:, None, :]
            S, A = S * kept, A * kept
            every = range(len(self.place.entries))
            S[:, every, every] += self.left_out
        return ModelSpectrum(S, A)

    def powers(self, unknowns: Array) -> tuple[Array, Array, Array]:
        """|Y|² of every entry (B g, e), NaN where nothing is said of it, S, and its unsigned frequency [Hz]; of several
        blocks their mean."""
        S = np.einsum("bii->bi", self.spectrum(unknowns).spectrum).real
        order = self.place.orders[self.place.entries // self.combine.shape[0]]
        frequency = np.abs(self.base[:, None] + self.place.rotor_hz * order)
        if self.recent is not None:
            mean = np.sum(np.abs(self.data) ** 2, axis=2) / self.counts[:, None]
            bins = np.round(self.counts / self.blocks).astype(np.intp)
            return np.repeat(mean, bins, axis=0), np.repeat(S, bins, axis=0), np.repeat(frequency, bins, axis=0)
        beyond = np.arange(self.data.shape[2]) >= self.counts[:, None]
        found = np.where(self.left_out[:, :, None] | beyond[:, None, :], np.nan, np.abs(self.data) ** 2)
        alike = self.data.shape[2]
        power = np.swapaxes(found, 1, 2).reshape(-1, found.shape[1])
        return power, np.repeat(S, alike, axis=0), np.repeat(frequency, alike, axis=0)

    def likeness(self, spectrum: Complex) -> float:
        """c_h as the record has it, under S (B, e, e): that of the taper, or more."""
        return self.gusts * max(self.overlap, 1.0 + 2.0 * self.shared_by_neighbours(spectrum)[0])

    def shared_by_neighbours(self, spectrum: Complex) -> tuple[float, int]:
        """Σ |M_d|² under S (B, e, e), and how many numbers tell it.

        Loads that grow and fall with the gusts make neighbouring bins alike, as a taper does: with the power P(t) of
        what whitens to y, the mean M_d of y_b* y_{b+d} is the d-th Fourier coefficient of P over its mean, and c_h = T
        ∫P² / (∫P)² = 1 + 2 Σ |M_d|². Chance adds 1/(number of products) to each.
        """
        data = self.data if self.recent is None else self.recent
        y = np.linalg.solve(np.linalg.cholesky(spectrum), data)
        columns = np.arange(data.shape[2]) < np.round(self.counts / self.blocks)[:, None]
        bins = np.swapaxes(y, 1, 2)[columns]
        used = np.broadcast_to(~self.left_out[:, None], (*columns.shape, y.shape[1]))[columns]
        bins = np.where(used, bins, 0.0)
        shared = 0.0
        for d in range(1, int(NEIGHBOUR_SHARE * len(bins)) + 1):
            products = int(np.count_nonzero(used[:-d] & used[d:]))
            if products:
                shared += abs(np.vdot(bins[:-d], bins[d:]) / products) ** 2 - 1.0 / products
        return float(shared), int(np.count_nonzero(used))

    @property
    def base(self) -> Array:
        """Base frequencies (B,) of the data [Hz]."""
        if self.window is None:
            return self.place.base
        return np.asarray(self.window.T @ self.place.base)

    def _spectra(
        self, unknowns: Array, every: int, matrices: Matrices | None, *, slopes: bool
    ) -> Iterator[tuple[NDArray[np.intp], ModelSpectrum]]:
        """S and its derivatives at every n-th place, a few of them at a time."""
        for at, of in self._ingredients(unknowns, every, matrices, slopes=slopes):
            yield at, spectrum_of_bins(of)

    def _ingredients(
        self, unknowns: Array, every: int, matrices: Matrices | None, *, slopes: bool
    ) -> Iterator[tuple[NDArray[np.intp], Ingredients]]:
        """Terms of spectra at every n-th place, for a few of them at a time."""
        bins = np.arange(every // 2, len(self.place.base), every)
        still, moved = self.matrices(unknowns, slopes=slopes) if matrices is None else matrices
        late, later = self._late(unknowns)
        of_loads, of_noise = self.split_statistics(unknowns)
        spectra, noise = self._levels(of_loads, of_noise, every)
        some = slice(None if slopes else 0)
        moved = MatrixHarmonics(*(X[:, some] for X in moved))
        steps = self._source_slopes(of_loads, every) if slopes else SourceSpectra(*(of[None][some] for of in spectra))
        densities = 2.0 * np.exp(2.0 * of_noise[some])[:, None, None] * self.noise_given[some]
        chunk = max(8, MAX_NUMBERS // (len(unknowns) * len(self.place.entries) ** 2))
        for first in range(0, len(bins), chunk):
            at, near = bins[first : first + chunk], slice(first, first + chunk)
            part = Slopes(moved, SourceSpectra(*(of[:, near] for of in steps)), densities[:, at], later[some])
            where = self.place._replace(base=self.place.base[at], left_out=self.place.left_out[at])
            own, more = SourceSpectra(*(of[near] for of in spectra)), None if self.smear is None else self.smear[at]
            yield at, Ingredients(where, still, self.sources.placement, own, noise[at], part, more, late)

    def _late(self, unknowns: Array) -> tuple[Array, Array]:
        """By how much the readings of every entry are late (e,) [s], and by how much more for each clock (c, e): what
        is combined has one clock."""
        clocks = unknowns[self.unknowns.of("clocks")]
        of = np.argmax(np.abs(self.combine), axis=1)[self.place.entries % len(self.combine)]
        late = self.inexact.late[len(self.inexact.late) - len(clocks) :]
        later = late[:, of] if len(clocks) else np.empty((0, len(of)))
        return np.asarray(clocks @ later), later

    def matrices(self, unknowns: Array, *, slopes: bool) -> Matrices:
        """The matrices at the unknowns, and their derivatives to the mechanical ones; affine ones have these anyway."""
        affine = self._affine()
        if affine is None:
            return self._by_differences(unknowns, slopes=slopes)
        values = np.array([q.physical(u) for q, u in zip(self.parameters, unknowns, strict=False)])
        to = np.array([p if q.logarithmic else q.scale for q, p in zip(self.parameters, values, strict=True)])
        origin, first, of_one = affine
        scale, off = to[:, None, None, None], (values - origin)[:, None, None, None]
        at = (X + np.sum(Y * off, axis=1, keepdims=True) for X, Y in zip(first, of_one, strict=True))
        return self._combined(MatrixHarmonics(*at)), self._combined(MatrixHarmonics(*(Y * scale for Y in of_one)))

    def _by_differences(self, unknowns: Array, *, slopes: bool) -> Matrices:
        """The matrices at the unknowns, and their derivatives to the mechanical ones by central differences."""
        places, known = self.unknowns.places(*MECHANICAL), self.unknowns.only(*MECHANICAL)
        mechanical, steps = unknowns[places], DIFFERENCE_STEP * self.prior[1][places]
        points = mechanical[None]
        if slopes:
            points = np.concatenate([points, mechanical + np.diag(steps), mechanical - np.diag(steps)])
        p = np.tile(self.given, (len(points), 1))
        for i, q in enumerate(self.parameters):
            p[:, self.compiled.parameters.index(q.name)] = q.physical(points[:, i])
        if known.tolerances:
            p += points[:, known.of("tolerances")] @ self.inexact.parameters[: len(known.tolerances)]
        lag = equal_lag(self.freedoms, 1.0)
        deflections = points[:, known.of("lag")] * lag if self.lag else np.zeros((len(points), len(lag)))
        found = matrix_harmonics(self.compiled, p, deflections, 2.0 * np.pi * self.place.rotor_hz, self.inputs)
        found, moved = self._combined(found), []
        at = MatrixHarmonics(*(X[:, :1] for X in found))
        for X, size in zip(found, element_sizes(at), strict=True):
            up, down = X[:, 1 : 1 + len(steps)], X[:, 1 + len(steps) :]
            change = without_rounding(up - down, MIN_RELATIVE_CHANGE * size) if slopes else X[:, :0]
            moved.append(change / (2.0 * steps[:, None, None, None]) if slopes else change)
        return at, MatrixHarmonics(*moved)

    def _affine(self) -> tuple[Array, MatrixHarmonics, MatrixHarmonics] | None:
        """The matrices as an affine function of the coefficients; None where they are none, or not of these alone."""
        if self.lag or len(self.inexact.names) or not self.parameters:
            return None
        steps = tuple((self.compiled.parameters.index(q.name), q.reference) for q in self.parameters)
        given, inputs = tuple(self.given.tolist()), tuple(self.inputs.tolist())
        return affine_matrices(self.compiled, given, steps, 2.0 * np.pi * self.place.rotor_hz, inputs)

    def _combined(self, found: MatrixHarmonics) -> MatrixHarmonics:
        return found._replace(readings=self.combine @ found.readings)

    def _levels(self, of_loads: Array, of_noise: Array, every: int) -> tuple[SourceSpectra, Array]:
        """Spectra of the sources, and of the noise of every entry (F, e)."""
        values = values_of(self.sources.statistics, of_loads)
        noise = np.tensordot(np.exp(2.0 * of_noise), self.noise_given, 1)
        return self.sources.spectra(values, every), np.asarray(noise)

    def _source_slopes(self, eta: Array, every: int) -> SourceSpectra:
        """Derivatives of the sources' spectra to their η, (n, F, …)."""
        statistics = self.sources.statistics
        found = self.sources.slopes(values_of(statistics, eta), every)
        factors = to_logarithms(statistics)
        if np.array_equal(factors, np.eye(len(factors))):
            return found
        return SourceSpectra(*(np.tensordot(factors.T, part, 1) for part in found))


def finer_bins(first: int, last: int, factor: int = GRID_FACTOR) -> Array:
    """The finer grid (F,) for the bins first … last, in bins."""
    return np.asarray(np.arange((first - WINDOW_BINS) * factor, (last + WINDOW_BINS) * factor + 1) / factor)


def taper_weights(samples: int, bins: NDArray[np.intp], factor: int = GRID_FACTOR) -> Array:
    """The transform (F, B) of the taper of so many samples, on the finer grid about each of `bins` (B,); their squares,
    the taper's window, add up to 1."""
    found = _transform(samples, factor)
    out = np.zeros(((bins[-1] - bins[0]) * factor + len(found), len(bins)))
    for column, place in enumerate(bins - bins[0]):
        out[factor * place : factor * place + len(found), column] = (-1.0) ** place * found
    return out


@lru_cache(maxsize=16)
def _transform(samples: int, factor: int) -> Array:
    """The transform of a taper of so many samples within `WINDOW_BINS`, of norm 1."""
    steps = np.arange(-WINDOW_BINS * factor, WINDOW_BINS * factor + 1)
    found = (np.fft.fft(taper(samples), factor * samples)[steps] * np.exp(1j * np.pi * steps / factor)).real
    return np.asarray(found / np.linalg.norm(found))


def _smoothed(fine: Complex, window: Any) -> Complex:
    """Matrices (n, B, e, e) that are sums of those on the finer grid (n, F, e, e) by the weights of a window (F, B),
    sparse or dense."""
    n, F, e, _ = fine.shape
    flat = np.ascontiguousarray(np.swapaxes(fine, 0, 1)).reshape(F, -1)
    return np.swapaxes((window.T @ flat.view(np.float64)).view(np.complex128).reshape(-1, n, e, e), 0, 1)


def _linked(pairs: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Groups of entries between which there is no spectrum; of those that have one (e, e) each is in one group."""
    from scipy.sparse.csgraph import connected_components

    count, group = connected_components(pairs)
    return [np.flatnonzero(group == each) for each in range(count)]
