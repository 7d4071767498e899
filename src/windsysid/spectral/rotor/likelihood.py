"""The likelihood of a lifted spectrum, with its gradient and Fisher's information.

The vectors Y of active entries are independent complex Gaussian with covariance S(b; u), u the unknowns (Whittle's
likelihood); g neighbouring bins share one S. With S = L Lᴴ, y = L⁻¹ Y and whitened derivatives A_a = L⁻¹ ∂S/∂u_a L⁻ᴴ,

    J = c_h⁻¹ Σ_b [g ln det S + Σ yᴴ y],      g_a = c_h⁻¹ Σ_b [g tr A_a − Σ yᴴ A_a y],      F_ab = c_h⁻¹ Σ_b g tr A_a
    A_b.

S = T U S_s Uᴴ Tᴴ + N with the transfer T = R D⁻¹, sources S_s that U places and noise N. With Q = D⁻¹ U S_s Uᴴ Tᴴ a
parameter of the mechanics gives dS = (dR − T dD) Q + h.c., of which only the degrees of freedom that it acts on have to
be multiplied out; a load gives dS = T U dS_s Uᴴ Tᴴ. A reading that comes κ late is turned by e^{−iωκ}, which gives
dS = −iω (S − N) + h.c. in its rows.

What a finite record shows is S smoothed by the window |H|² of its taper (Sykulski et al., Biometrika 106, 2019,
https://doi.org/10.1093/biomet/asy071). Where a resonance is as narrow as a few bins, S and its derivatives are smoothed
on a finer grid; where it is narrower than a bin, the bins b, c have the joint covariance Σ_f S(f) H(b − f) H(c − f)*.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.spectral.rotor.harmonic_transfer import MatrixHarmonics
from windsysid.spectral.rotor.kernel_dense import add_up_dense, elements_of, entries_at, places_of, spectra_dense
from windsysid.spectral.rotor.kernel_sparse import MAX_LOOP_ENTRIES, add_up, spectra
from windsysid.spectral.rotor.load_spectra import SourceSpectra
from windsysid.spectral.transforms.lifted import Complex

__all__ = [
    "Ingredients", "Likelihood", "ModelSpectrum", "Slopes", "SpectrumGrid", "spectrum_of_bins", "whittle",
    "whittle_by_bins", "whittle_given", "whittle_of_many",
]  # fmt: skip


class SpectrumGrid(NamedTuple):
    """Frequencies of B spectra.

    Attributes
    ----------
    base, orders, rotor_hz
        Frequencies as `windsysid.spectral.transforms.lifted.Lifted` has them.
    entries
        Which of the (2K+1) r entries of the lifted vector are used (e,).
    left_out
        Those that are not, bin by bin (B, e): nothing is said of them, and they have unit variance.
    """

    base: Array
    orders: NDArray[np.intp]
    rotor_hz: float
    entries: NDArray[np.intp]
    left_out: NDArray[np.bool_]


class Slopes(NamedTuple):
    """Derivatives of a spectrum's ingredients.

    Attributes
    ----------
    mechanics
        Of the matrices, one set for each mechanical unknown.
    sources
        Of the sources' spectra (n, B, …), one for each unknown of the loads.
    noise
        Of the noise (n, B, e), one for each unknown of the sensors.
    late
        By how much the readings of every entry are later (c, e) [s] with each unknown of the clocks.
    """

    mechanics: MatrixHarmonics
    sources: SourceSpectra
    noise: Array
    late: Array


class ModelSpectrum(NamedTuple):
    """S (B, e, e) and its derivatives (n, B, e, e)."""

    spectrum: Complex
    slopes: Complex


class Likelihood(NamedTuple):
    """J of some bins, its gradient g (n,), and Fisher's information F (n, n)."""

    value: float
    gradient: Array
    information: Array


class Ingredients(NamedTuple):
    """Terms of spectra at B places.

    Attributes
    ----------
    place, matrices
        Where they are taken, and one set of the model's matrices.
    placement, sources
        U ((2K+1) n, s) and the spectra S_s.
    noise, late
        Spectral density of the noise of every entry (B, e) [unit²/Hz], and by how much its readings are late (e,) [s].
    slopes, more
        Derivatives, of no unknowns where they are not needed, and additional spectra (B, e, e), which are added to S;
        None for none.
    """

    place: SpectrumGrid
    matrices: MatrixHarmonics
    placement: Complex
    sources: SourceSpectra
    noise: Array
    slopes: Slopes
    more: Complex | None
    late: Array

    @property
    def is_on_time(self) -> bool:
        """True if no clock has a lag or a tolerance of it."""
        return not self.late.any() and not len(self.slopes.late)


def spectrum_of_bins(of: Ingredients) -> ModelSpectrum:
    """S and its derivatives."""
    bins, entries = of.place.left_out.shape
    if entries > MAX_LOOP_ENTRIES and not len(of.slopes.noise) + of.slopes.mechanics.mechanics.shape[1]:
        S = np.empty((bins, entries, entries), dtype=np.complex128)
        spectra_dense(_many_entries(of), S)
        return ModelSpectrum(S, np.empty((0, *S.shape), dtype=np.complex128))
    found = _by_loops(of if of.is_on_time else of._replace(noise=np.zeros_like(of.noise)))
    found = found if of.is_on_time else _delayed(found, of)
    return found if of.more is None else found._replace(spectrum=found.spectrum + of.more)


def _delayed(signal: ModelSpectrum, of: Ingredients) -> ModelSpectrum:
    """Spectra of readings on time and without noise, turned by e^{−iωκ}, with noise and the derivatives to lateness."""
    place, rows = of.place, of.matrices.readings.shape[3]
    turn = -2j * np.pi * (place.base[:, None] + place.rotor_hz * place.orders[place.entries // rows])
    phase = np.exp(turn * of.late)
    across = phase[:, :, None] * phase[:, None, :].conj()
    S, A = signal.spectrum * across, signal.slopes * across
    moved, halves = of.slopes.mechanics.mechanics.shape[1], [(turn * one)[:, :, None] * S for one in of.slopes.late]
    A = np.concatenate([A[:moved], *((half + _h(half))[None] for half in halves), A[moved:]])
    S[:, range(S.shape[1]), range(S.shape[1])] += np.where(place.left_out, 0.0, of.noise)
    return ModelSpectrum(S, A)


def whittle(data: Complex, counts: Array, model: ModelSpectrum) -> Likelihood:
    """J, g and F for c_h = 1 of the entries (B, e, g), of which the first `counts` (B,) columns are bins and the others
    are 0.

    Raises
    ------
    LinAlgError
        Where a spectrum is not positive definite.
    """
    if data.shape[1] <= MAX_LOOP_ENTRIES:
        g, F = np.zeros(len(model.slopes)), np.zeros((len(model.slopes), len(model.slopes)))
        J = add_up()(model.spectrum, model.slopes, data, counts, g, F)
        if not np.isfinite(J):
            raise np.linalg.LinAlgError("a spectrum is not positive definite")
        return Likelihood(float(J), g, F)
    L_inv = _whitener(model.spectrum)
    logarithms = np.log(np.einsum("bii->bi", L_inv).real).sum(axis=1)
    value = float(-2.0 * counts @ logarithms + np.sum(np.abs(L_inv @ data) ** 2))
    gradients, informations = whittle_by_bins(data, counts, model)
    return Likelihood(value, gradients.sum(axis=0), informations.sum(axis=0))


def whittle_by_bins(data: Complex, counts: Array, model: ModelSpectrum) -> tuple[Array, Array]:
    """g (B, n) and F (B, n, n) of each of the B bins, for c_h = 1; arguments as of `whittle`."""
    L_inv = _whitener(model.spectrum)
    y, A = L_inv @ data, np.moveaxis(L_inv @ model.slopes @ _h(L_inv), 0, 1)
    shown = counts[:, None, None] * np.eye(data.shape[1]) - y @ _h(y)
    F = counts[:, None, None] * np.einsum("bnij,boji->bno", A, A, optimize=True).real
    return np.einsum("bnij,bji->bn", A, shown).real, F


def whittle_given(data: Complex, covariance: NDArray[Any], slopes: NDArray[Any], given: int) -> Likelihood:
    """J, g and F for c_h = 1 of entries (N,) with a covariance (N, N) and its derivatives (n, N, N), given the first
    ones. With S = L Lᴴ, y = L⁻¹ Y and A_a as above, that of the entry i given those before it is

        J = ln L_ii² + |y_i|²,    g_a = A_ii (1 − |y_i|²) − 2 Re y_i* Σ_j A_ij y_j,
        F_ab = A_ii B_ii + 2 Re Σ_j A_ij B_ij*

    with j < i (Vecchia, J. R. Statist. Soc. B 50, 1988).

    Raises
    ------
    LinAlgError
        Where the covariance is not positive definite.
    """
    L_inv = _whitener(covariance)
    y, own = L_inv @ data, L_inv[given:]
    squares = np.square(y[given:].real) + np.square(y[given:].imag)
    value = float(np.sum(squares) - 2.0 * np.sum(np.log(np.diagonal(own, given).real)))
    A = own @ slopes @ _h(L_inv)
    diagonal, before = np.diagonal(A, given, 1, 2).real, np.tril(A, given - 1)
    gradient = diagonal @ (1.0 - squares) - 2.0 * (before @ y @ np.conj(y[given:])).real
    flat = before.reshape(len(A), own.size).view(np.float64)
    return Likelihood(value, gradient, diagonal @ diagonal.T + 2.0 * flat @ flat.T)


def whittle_of_many(of: Ingredients, data: Complex, counts: Array) -> Likelihood:
    """`whittle` of `spectrum_of_bins` with its slopes, for spectra of many entries: by loops over one place at a time.

    Raises
    ------
    LinAlgError
        Where a spectrum is not positive definite.
    """
    moved, sources, noise, late = of.slopes
    n = moved.mechanics.shape[1] + len(late) + len(sources.own) + len(noise)
    g, F = np.zeros(n), np.zeros((n, n))
    given = (*(part for X in moved for part in (X, elements_of(X))), late, *sources, noise)
    data = np.ascontiguousarray(data)
    J = add_up_dense(_many_entries(of), [np.ascontiguousarray(array) for array in given], data, counts, g, F)
    if not np.isfinite(J):
        raise np.linalg.LinAlgError("a spectrum is not positive definite")
    return Likelihood(J, g, F)


def _many_entries(of: Ingredients) -> list[NDArray[Any]]:
    """Arguments of loops over spectra of many entries."""
    place = of.place
    omega = 2.0 * np.pi * (place.base[:, None] + place.rotor_hz * place.orders)
    nothing = np.empty((0, 0, 0), dtype=np.complex128)
    given = (
        *(part for X in of.matrices for part in (X, elements_of(X))), omega, place.entries,
        entries_at(place.entries, len(place.orders), of.matrices.readings.shape[3]), place.left_out, of.late,
        *places_of(of.placement), *of.sources, of.noise, nothing if of.more is None else of.more,
    )  # fmt: skip
    return [np.ascontiguousarray(array) for array in given]


def _by_loops(of: Ingredients) -> ModelSpectrum:
    """Spectra and derivatives of readings on time, without additional spectra."""
    place, matrices, slopes = of.place, of.matrices, of.slopes
    bins, entries = place.left_out.shape
    count = slopes.mechanics.mechanics.shape[1] + len(slopes.sources.own) + len(slopes.noise)
    S = np.empty((bins, entries, entries), dtype=np.complex128)
    A = np.empty((count, *S.shape), dtype=np.complex128)
    omega = 2.0 * np.pi * (place.base[:, None] + place.rotor_hz * place.orders)
    given = (
        matrices.mechanics[:, 0], matrices.readings[:, 0], *slopes.mechanics, omega, place.entries, place.left_out,
        of.placement, *of.sources, *slopes.sources, of.noise, slopes.noise,
    )  # fmt: skip
    spectra()(*(np.ascontiguousarray(array) for array in given), S, A)
    return ModelSpectrum(S, A)


def _whitener(spectrum: NDArray[Any]) -> NDArray[Any]:
    """L⁻¹ of S = L Lᴴ (…, e, e)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(spectrum)))


def _h(matrix: Complex) -> Complex:
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)))
