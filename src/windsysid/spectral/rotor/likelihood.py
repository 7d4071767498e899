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
on a finer grid; where it is narrower than a bin, all bins b, c have the joint covariance Σ_f S(f) H(b − f) H(c − f)*.
"""

from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.spectral.rotor.harmonic_transfer import MatrixHarmonics, coupled
from windsysid.spectral.rotor.kernel_dense import add_up_dense, elements_of, entries_at, places_of, spectra_dense
from windsysid.spectral.rotor.kernel_sparse import MAX_LOOP_ENTRIES, add_up, spectra
from windsysid.spectral.rotor.load_spectra import SourceSpectra
from windsysid.spectral.transforms.lifted import Complex

__all__ = [
    "Ingredients", "Likelihood", "ModelSpectrum", "Slopes", "SpectrumGrid", "spectrum_of_bins", "whittle",
    "whittle_by_bins", "whittle_of_many",
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
    """S (B, e, e) and its derivatives (n, B, e, e), which are whitened where `whitener` L⁻¹ (B, e, e) is there."""

    spectrum: Complex
    slopes: Complex
    whitener: Complex | None


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
        Derivatives, and what comes to S besides (B, e, e); None for none.
    """

    place: SpectrumGrid
    matrices: MatrixHarmonics
    placement: Complex
    sources: SourceSpectra
    noise: Array
    slopes: Slopes | None
    more: Complex | None
    late: Array

    @property
    def is_on_time(self) -> bool:
        """True if no clock has a lag or a tolerance of it."""
        return not self.late.any() and (self.slopes is None or not len(self.slopes.late))


def spectrum_of_bins(of: Ingredients, *, whiten: bool) -> ModelSpectrum:
    """S and its derivatives.

    `whiten` hands the derivatives back whitened, which costs less than to whiten them later; where there are few
    entries it does not, and they are not.
    """
    bins, entries = of.place.left_out.shape
    if entries <= MAX_LOOP_ENTRIES and of.is_on_time:
        return _few_entries(of)
    if of.slopes is None and entries > MAX_LOOP_ENTRIES:
        S = np.empty((bins, entries, entries), dtype=np.complex128)
        spectra_dense(_many_entries(of), S)
        return ModelSpectrum(S, np.empty((0, *S.shape), dtype=np.complex128), None)
    response = _respond(of)
    if of.slopes is None:
        S = response.spectrum
        return ModelSpectrum(S, np.empty((0, *S.shape), dtype=np.complex128), None)
    L_inv = _whitener(response.spectrum) if whiten else None
    return ModelSpectrum(response.spectrum, _differentiate(of, of.slopes, response, L_inv), L_inv)


class _Response(NamedTuple):
    """Response of the entries to the sources.

    Attributes
    ----------
    transfer, placed
        T (B, e, (2K+1) n), and T U (B, e, s).
    driven
        Q = D⁻¹ U S_s Uᴴ Tᴴ (B, (2K+1) n, e).
    signal, spectrum
        T U S_s Uᴴ Tᴴ and S (B, e, e).
    turn, phase
        −iω of every entry (B, e), and e^{−iωκ} (B, e, 1); None where nothing is late.
    """

    transfer: Complex
    placed: Complex
    driven: Complex
    signal: Complex
    spectrum: Complex
    turn: Complex
    phase: Complex | None


def _respond(of: Ingredients) -> _Response:
    """The response of the entries at every place."""
    place, matrices = of.place, of.matrices
    bins, entries = place.left_out.shape
    D = coupled(matrices.mechanics[:, 0], place.base, place.orders, place.rotor_hz)
    R = coupled(matrices.readings[:, 0], place.base, place.orders, place.rotor_hz)
    size = D.shape[1] * D.shape[2]
    seen = R.reshape(bins, -1, size)[:, place.entries]
    seen[place.left_out] = 0.0
    turn = -2j * np.pi * (place.base[:, None] + place.rotor_hz * place.orders[place.entries // R.shape[2]])
    phase = np.exp(turn * of.late)[:, :, None] if of.late.any() else None
    if phase is not None:
        seen *= phase
    inverse = np.asarray(np.linalg.inv(D.reshape(bins, size, size)), dtype=np.complex128)
    T = seen @ inverse
    T_s = T @ of.placement
    driven = times_sources(T_s, of.sources)
    signal = driven @ _h(T_s)
    S = signal.copy()
    S[:, range(entries), range(entries)] += np.where(place.left_out, 1.0, of.noise)
    if of.more is not None:
        S += of.more
    return _Response(T, T_s, inverse @ (of.placement @ _h(driven)), signal, S, turn, phase)


def _differentiate(of: Ingredients, slopes: Slopes, response: _Response, L_inv: Complex | None) -> Complex:
    """The derivatives of S (n, B, e, e), whitened where L⁻¹ is there."""
    T, T_s, Q = response.transfer, response.placed, response.driven
    if L_inv is not None:
        T, T_s, Q = L_inv @ T, L_inv @ T_s, Q @ _h(L_inv)
    moved = slopes.mechanics.mechanics.shape[1]
    halves = chain(
        (_mechanical(slopes.mechanics, a, of.place, T, Q, L_inv, response.phase) for a in range(moved)),
        (_whitened((response.turn * later)[:, :, None] * response.signal, L_inv) for later in slopes.late),
    )
    wholes = chain(
        (half + _h(half) for half in halves),
        (times_sources(T_s, SourceSpectra(*slope)) @ _h(T_s) for slope in zip(*slopes.sources, strict=True)),
        (_of_noise(np.where(of.place.left_out, 0.0, density), L_inv) for density in slopes.noise),
    )
    count = moved + len(slopes.late) + len(slopes.sources.own) + len(slopes.noise)
    A = np.empty((count, *response.spectrum.shape), dtype=np.complex128)
    for a, whole in enumerate(wholes):
        A[a] = whole
    return A


def _whitened(matrix: Complex, L_inv: Complex | None) -> Complex:
    """L⁻¹ M L⁻ᴴ where L⁻¹ is there."""
    return matrix if L_inv is None else np.asarray(L_inv @ matrix @ _h(L_inv))


def _of_noise(density: Array, L_inv: Complex | None) -> Complex:
    """The diagonal matrices of densities (B, e), whitened where L⁻¹ is there."""
    if L_inv is None:
        return np.asarray(density[:, :, None] * np.eye(density.shape[1]), dtype=np.complex128)
    return np.asarray((L_inv * density[:, None, :]) @ _h(L_inv))


def whittle(data: Complex, counts: Array, model: ModelSpectrum) -> Likelihood:
    """J, g and F for c_h = 1 of the entries (B, e, g), of which the first `counts` (B,) columns are bins and the others
    are 0.

    Raises
    ------
    LinAlgError
        Where a spectrum is not positive definite.
    """
    if data.shape[1] <= MAX_LOOP_ENTRIES and model.whitener is None:
        g, F = np.zeros(len(model.slopes)), np.zeros((len(model.slopes), len(model.slopes)))
        J = add_up()(model.spectrum, model.slopes, data, counts, g, F)
        if not np.isfinite(J):
            raise np.linalg.LinAlgError("a spectrum is not positive definite")
        return Likelihood(float(J), g, F)
    L_inv = _whitener(model.spectrum) if model.whitener is None else model.whitener
    y = L_inv @ data
    logarithms = np.log(np.einsum("bii->bi", L_inv).real).sum(axis=1)
    value = float(-2.0 * counts @ logarithms + np.sum(np.abs(y) ** 2))
    A = model.slopes if model.whitener is not None else L_inv @ model.slopes @ _h(L_inv)
    if not len(A):
        return Likelihood(value, np.empty(0), np.empty((0, 0)))
    shown = counts[:, None, None] * np.eye(data.shape[1]) - y @ _h(y)
    flat = np.ascontiguousarray(A).reshape(len(A), -1).view(np.float64)  # tr AB = Σ A_ij conj(B_ij) for Hermitian B
    weighted = (flat.reshape(len(A), len(counts), -1) * counts[:, None]).reshape(len(A), -1)
    return Likelihood(value, flat @ np.ascontiguousarray(shown).view(np.float64).ravel(), weighted @ flat.T)


def whittle_by_bins(data: Complex, counts: Array, model: ModelSpectrum) -> tuple[Array, Array]:
    """g (B, n) and F (B, n, n) of each of the B bins, for c_h = 1; arguments as of `whittle`."""
    L_inv = _whitener(model.spectrum)
    y, A = L_inv @ data, np.moveaxis(L_inv @ model.slopes @ _h(L_inv), 0, 1)
    shown = counts[:, None, None] * np.eye(data.shape[1]) - y @ _h(y)
    F = counts[:, None, None] * np.einsum("bnij,boji->bno", A, A, optimize=True).real
    return np.einsum("bnij,bji->bn", A, shown).real, F


def whittle_of_many(of: Ingredients, data: Complex, counts: Array) -> Likelihood:
    """`whittle` of `spectrum_of_bins` with its slopes, for spectra of many entries: by loops over one place at a time.

    Raises
    ------
    LinAlgError
        Where a spectrum is not positive definite.
    """
    assert of.slopes is not None
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


def _few_entries(of: Ingredients) -> ModelSpectrum:
    """`spectrum_of_bins` for spectra of few entries on time: by loops."""
    place, matrices, slopes = of.place, of.matrices, of.slopes
    bins, entries = place.left_out.shape
    if slopes is None:
        slopes = Slopes(
            MatrixHarmonics(matrices.mechanics[:, :0], matrices.readings[:, :0]),
            SourceSpectra(*(part[None][:0] for part in of.sources)),
            of.noise[None][:0],
            np.empty((0, entries)),
        )
    count = slopes.mechanics.mechanics.shape[1] + len(slopes.sources.own) + len(slopes.noise)
    S = np.empty((bins, entries, entries), dtype=np.complex128)
    A = np.empty((count, *S.shape), dtype=np.complex128)
    omega = 2.0 * np.pi * (place.base[:, None] + place.rotor_hz * place.orders)
    given = (
        matrices.mechanics[:, 0], matrices.readings[:, 0], *slopes.mechanics, omega, place.entries, place.left_out,
        of.placement, *of.sources, *slopes.sources, of.noise, slopes.noise,
    )  # fmt: skip
    spectra()(*(np.ascontiguousarray(array) for array in given), S, A)
    return ModelSpectrum(S if of.more is None else S + of.more, A, None)


def times_sources(matrix: Complex, sources: SourceSpectra) -> Complex:
    """Matrices (B, e, s) times the covariance of the sources."""
    out = np.asarray(matrix * sources.own[:, None, :])
    pairs = sources.cross.shape[1]
    if pairs:
        out[..., :pairs] += matrix[..., pairs : 2 * pairs] * sources.cross[:, None, :]
        out[..., pairs : 2 * pairs] += matrix[..., :pairs] * sources.cross[:, None, :]
    return out


def _mechanical(
    slopes: MatrixHarmonics, which: int, place: SpectrumGrid, T: Complex, Q: Complex, L_inv: Complex | None,
    phase: Complex | None,
) -> Complex:  # fmt: skip
    """(dR − T dD) Q of one mechanical unknown (B, e, e), T and Q being whitened where L⁻¹ is there; `phase` (B, e, 1)
    is what late clocks make of readings."""
    dM, dR = slopes.mechanics[:, which], slopes.readings[:, which]
    bins, count, n = len(place.base), len(place.orders), dM.shape[-1]
    half = np.zeros((bins, Q.shape[-1], Q.shape[-1]), dtype=np.complex128)
    left, right = T.reshape(bins, -1, count, n), Q.reshape(bins, count, n, -1)
    if dM.any():
        rows, columns = np.flatnonzero(dM.any(axis=(0, 1, 3))), np.flatnonzero(dM.any(axis=(0, 1, 2)))
        sub = coupled(dM[:, :, rows][..., columns], place.base, place.orders, place.rotor_hz)
        sub = sub.reshape(bins, count * len(rows), count * len(columns))
        before = left[..., rows].reshape(bins, -1, count * len(rows))
        half -= before @ sub @ right[:, :, columns].reshape(bins, count * len(columns), -1)
    if dR.any():
        columns = np.flatnonzero(dR.any(axis=(0, 1, 2)))
        sub = coupled(dR[..., columns], place.base, place.orders, place.rotor_hz)
        sub = sub.reshape(bins, -1, count * len(columns))[:, place.entries]
        sub[place.left_out] = 0.0
        if phase is not None:
            sub *= phase
        seen = sub @ right[:, :, columns].reshape(bins, count * len(columns), -1)
        half += seen if L_inv is None else L_inv @ seen
    return half


def _whitener(spectrum: Complex) -> Complex:
    """L⁻¹ of S = L Lᴴ (B, e, e)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(spectrum)), dtype=np.complex128)


def _h(matrix: Complex) -> Complex:
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)))
