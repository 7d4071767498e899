"""Spectral model of a few modes in a band, with its derivatives.

    S(f) = Φ_f [D(f) ∘ C Cᴴ] Φ_fᴴ + (f/f_c)^b L Lᴴ,        D_jk(f) = h_j(f) h_k(f)* (f/f_c)^a,
    h_j(f) = −r² / (1 − r² + 2 i ζ_j r),        r = f / f_j,        Φ_f = Φ + Ψ diag(f/f_j − 1),

the response in acceleration of modes f_j, ζ_j with complex shapes Φ (m, r) to modal loads of the spectrum C Cᴴ
(f/f_c)^a, plus the background, L Lᴴ (f/f_c)^b: noise and the skirts of other modes, any Hermitian
matrix. Where the load of a mode drives the rest of the structure too, as wind and the ground do, the motion d that it
makes there adds to φ h. Near the mode h is nearly 1/(2 (f/f_j − 1 − i ζ_j)), so that φ h + d is h times
φ − 2 i ζ_j d + 2 d (f/f_j − 1): Ψ = 2 d. Where every mode has a load of its own, Ψ is 0 and no unknown.

C is lower triangular with ones on its diagonal, so that the size of a column of Φ carries the level of its load, and
one element of each column is real, since the phase of a column means nothing. D is convolved with the taper's window
(`windsysid.spectral.transforms.dft`).

A step δ of the unknowns has this order: ln f (r), ln ζ (r), Re Φ (m r, by columns), Im Φ (less the real elements), Re
and Im of C below its diagonal, a (where there is a mode), X, b, Re and Im of Ψ by columns where it is unknown. X is
Hermitian, m² real numbers: L Lᴴ ← L exp(X) Lᴴ, which is the same whatever the units of the channels are.

A rival model (`windsysid.spectral.modal_bands.varying_shapes`) has T S Tᴴ in place of S, T = 1 + Σ K_q (ln f/f_c)^q,
the K_q being lower triangular without their diagonals, and columns of L with slopes b + k of their own, k being kept in
the diagonal of the first K. Between X and b, k (m − 1), Re K_q and Im K_q follow.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.modal_bands.kernel import whitened_slopes
from windsysid.spectral.transforms.dft import Band

__all__ = [
    "SLOPE_STD", "Modes", "Scores", "advance", "coordinates", "height_of", "prominence", "responses", "row_scores",
    "scores", "spectrum", "tilt_of", "with_real_elements",
]  # fmt: skip


SLOPE_STD = 8.0
"""Setting: prior standard deviation of the slope b of the background."""

MIN_BACKGROUND_POWER = 1e-10
"""Numerical: smallest power of the background, each channel being scaled to a power of about 1."""


class Modes(NamedTuple):
    """The unknowns of a band.

    Attributes
    ----------
    frequency, damping
        (r,) [Hz], (r,) [1].
    shape, drift
        Φ (m, r), and Ψ (m, r), None where shapes are the same all over the band, and Ψ is no unknown.
    load, load_slope
        C (r, r) and a.
    rest, rest_slope
        L (m, m) and b.
    mix
        K_q (Q, m, m); None where channels are not mixed, and they are no unknowns.
    """

    frequency: Array
    damping: Array
    shape: Complex
    load: Complex
    load_slope: float
    rest: Complex
    rest_slope: float
    drift: Complex | None = None
    mix: Complex | None = None

    def shapes(self, frequency: Array) -> Complex:
        """Φ + Ψ (f/f_j − 1) at some frequencies (K, m, r)."""
        if self.drift is None:
            return np.broadcast_to(self.shape, (len(frequency), *self.shape.shape))
        away = frequency[:, None] / self.frequency - 1.0
        return np.asarray(self.shape + away[:, None] * self.drift)

    def let_drift(self) -> "Modes":
        """These modes with Ψ as an unknown."""
        return self._replace(drift=np.zeros_like(self.shape))

    @property
    def real(self) -> NDArray[np.int64]:
        """Index of the real element of each shape (r,)."""
        return np.asarray(
            np.argmin(np.abs(self.shape.imag) / np.maximum(np.abs(self.shape), 1e-300), axis=0), dtype=np.int64
        )

    @property
    def size(self) -> int:
        """Number of unknowns."""
        m, r = self.shape.shape
        return int(2 * r + 2 * m * r - r + r * (r - 1) + (r > 0) + m * m + 1) + self.mixing + self.drifting

    @property
    def drifting(self) -> int:
        """Number of unknowns of Ψ."""
        return 0 if self.drift is None else 2 * self.drift.size

    @property
    def mixing(self) -> int:
        """Number of unknowns of K_q."""
        return 0 if self.mix is None else len(self.mix) * (self.mix[0].size - len(self.rest)) + len(self.rest) - 1

    def mixing_at(self, height: Array) -> Complex:
        """T (K, m, m) at ln f/f_c (K,)."""
        mix = np.zeros((0, *self.rest.shape)) if self.mix is None else np.tril(self.mix, -1)
        return np.asarray(np.eye(len(self.rest)) + np.tensordot(height[:, None] ** np.arange(1, len(mix) + 1), mix, 1))


class Scores(NamedTuple):
    """Σ n (ln det S̄ + tr S̄⁻¹ P), its gradient (p,) and its expected second derivatives (p, p)."""

    cost: float
    gradient: Array
    fisher: Array


def prominence(modes: Modes, j: int, band: Band) -> float:
    """Power of mode j at its natural frequency over the background, in the direction of the largest ratio."""
    at, others = modes.frequency[j : j + 1], np.arange(len(modes.frequency)) != j
    h = responses(modes, at)[:, 0]
    driven = h[:, None] * (modes.load @ modes.load.conj().T) * h.conj() * tilt_of(at, band, modes.load_slope)
    around, along = modes.shapes(at)[0][:, others], modes.shape[:, j]
    rest = modes.rest @ modes.rest.conj().T * tilt_of(at, band, modes.rest_slope)
    rest = rest + around @ driven[np.ix_(others, others)] @ around.conj().T
    return float((along.conj() @ np.linalg.solve(rest, along)).real * driven[j, j].real)


def with_real_elements(modes: Modes) -> Modes:
    """The columns of Φ turned so that the largest element of each is real; C turns with them."""
    phi = modes.shape
    if not phi.shape[1]:
        return modes
    largest = np.argmax(np.abs(phi), axis=0)
    element = phi[largest, range(len(largest))]
    turn = element / np.abs(element)
    phi = phi / turn[None]
    phi[largest, range(len(largest))] = np.abs(element)
    drift = None if modes.drift is None else modes.drift / turn[None]
    return modes._replace(shape=phi, load=turn[:, None] * modes.load * turn.conj()[None], drift=drift)


def coordinates(modes: Modes) -> Array:
    """The unknowns of which a prior speaks: ln ζ (r), C (r (r − 1)), a, b, Re and Im Ψ, in the order of a step."""
    _, rows, columns, *_ = _parts(*modes.shape.shape)
    c = modes.load[rows, columns]
    slope = [modes.load_slope] if len(modes.frequency) else []
    psi = np.empty(0) if modes.drift is None else modes.drift.T.ravel()
    return np.concatenate([np.log(modes.damping), c.real, c.imag, slope, [modes.rest_slope], psi.real, psi.imag])


def advance(modes: Modes, step: Array) -> Modes:
    """The modes after a step δ."""
    m, r = modes.shape.shape
    ends, *at = _parts(m, r, 0 if modes.mix is None else len(modes.mix))
    fixed, psi = step[: modes.size - modes.drifting], step[modes.size - modes.drifting :]
    f, z, re, im, cr, ci, a, d, xr, xi, k, ks, b = np.split(fixed, ends)
    turned = np.ones((m, r), dtype=bool)
    turned[modes.real, range(r)] = False
    imaginary = np.zeros((r, m))
    imaginary[turned.T] = im
    load = modes.load.copy()
    load[at[0], at[1]] += cr + 1j * ci
    x = np.diag(d).astype(np.complex128)
    x[at[2], at[3]] = xr + 1j * xi
    sizes_x, directions = np.linalg.eigh(x)  # of its lower triangle
    grown = modes.rest @ directions * np.exp(0.5 * np.clip(sizes_x, -2.0, 2.0))
    mix = modes.mix
    if mix is not None:
        mix = mix.copy()
        mix[0] += np.diag(np.append(0.0, k))
        mix[:, at[2], at[3]] += ks[: len(ks) // 2].reshape(len(mix), -1) + 1j * ks[len(ks) // 2 :].reshape(len(mix), -1)
    rest = np.linalg.cholesky(grown @ grown.conj().T + MIN_BACKGROUND_POWER * np.eye(m))
    return Modes(
        modes.frequency * np.exp(f),
        modes.damping * np.exp(z),
        modes.shape + (re.reshape(r, m) + 1j * imaginary).T,
        load,
        modes.load_slope + float(a.sum()),
        rest,
        modes.rest_slope + float(b[0]),
        None if modes.drift is None else modes.drift + (psi[: m * r] + 1j * psi[m * r :]).reshape(r, m).T,
        mix,
    )


def spectrum(modes: Modes, band: Band) -> Complex:
    """S̄ (K, m, m) in the rows of the band."""
    h = responses(modes, band.fine)
    d = band.expected((h[:, None] * h.conj()[None] * tilt_of(band.fine, band, modes.load_slope)).transpose(2, 0, 1))
    phi = modes.shapes(band.frequency)
    modal = phi @ (d * (modes.load @ modes.load.conj().T)) @ phi.conj().transpose(0, 2, 1)
    height = height_of(band.frequency, band)
    slopes = modes.rest_slope + (np.zeros(len(phi[0])) if modes.mix is None else np.diagonal(modes.mix[0]).real)
    root, turn = modes.rest * np.exp(0.5 * height[:, None] * slopes)[:, None], modes.mixing_at(height)
    return np.asarray(turn @ (modal + root @ root.conj().transpose(0, 2, 1)) @ turn.conj().transpose(0, 2, 1))


def scores(modes: Modes, band: Band) -> Scores:
    """The likelihood of a band's data with its slopes."""
    cost, slopes, misfit = _whitened(modes, band)
    flat = slopes.reshape(modes.size, -1)
    return Scores(cost, flat @ misfit.ravel(), flat @ flat.T)


def row_scores(modes: Modes, band: Band) -> tuple[Array, Array]:
    """Gradient (K, p) and expected second derivatives (K, p, p) of each row of a band."""
    _, slopes, misfit = _whitened(modes, band)
    rows = np.ascontiguousarray(slopes.transpose(1, 0, 2))
    return np.einsum("kpi,ki->kp", rows, misfit), rows @ rows.transpose(0, 2, 1)


def _whitened(modes: Modes, band: Band) -> tuple[float, Array, Array]:
    """The likelihood, the whitened derivatives (p, K, m²) of the spectrum, and the whitened misfit (K, m²)."""
    k, m, _ = band.power.shape
    slopes, misfit = np.zeros((modes.size, k, m * m)), np.empty((k, m * m))
    cost = whitened_slopes()(
        band.power, band.counts, band.frequency, band.fine, band.first, band.window, modes.frequency, modes.damping,
        np.ascontiguousarray(modes.shape), np.ascontiguousarray(modes.load), np.ascontiguousarray(modes.rest),
        np.array([_centre(band), modes.load_slope, modes.rest_slope]),
        np.empty((m, 0), dtype=np.complex128) if modes.drift is None else np.ascontiguousarray(modes.drift),
        np.empty((0, m, m), dtype=np.complex128) if modes.mix is None else np.ascontiguousarray(modes.mix), modes.real,
        slopes, misfit,
    )  # fmt: skip
    return float(cost), slopes, misfit


def responses(modes: Modes, frequency: Array) -> Complex:
    """h (r, F)."""
    ratio = frequency[None] / modes.frequency[:, None]
    x = ratio**2
    return np.asarray(-x / (1.0 - x + 2j * modes.damping[:, None] * ratio))


def tilt_of(frequency: Array, band: Band, slope: float) -> Array:
    """(f/f_c)^slope (F,)."""
    return np.asarray((frequency / _centre(band)) ** slope)


def height_of(frequency: Array, band: Band) -> Array:
    """ln f/f_c (F,)."""
    return np.asarray(np.log(frequency / _centre(band)))


def _centre(band: Band) -> float:
    return float(np.sqrt(band.frequency[0] * band.frequency[-1]))


@lru_cache(maxsize=64)
def _parts(m: int, r: int, order: int = 0) -> tuple[NDArray[np.int64], ...]:
    """Ends of the parts of a step, and the places below the diagonals of C and of X."""
    low, below = r * (r - 1) // 2, m * (m - 1) // 2
    sizes = [r, r, m * r, m * r - r, low, low, int(r > 0), m, below, below, (order > 0) * (m - 1), 2 * order * below, 1]
    return (np.cumsum(sizes)[:-1], *np.tril_indices(r, -1), *np.tril_indices(m, -1))
