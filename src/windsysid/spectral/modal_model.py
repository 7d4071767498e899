"""The spectrum of a few modes in a band, and its slopes.

    S(f) = Φ [D(f) ∘ C Cᴴ] Φᴴ + (f/f_c)^b L Lᴴ,        D_jk(f) = h_j(f) h_k(f)* (f/f_c)^a,
    h_j(f) = −r² / (1 − r² + 2 i ζ_j r),        r = f / f_j,

the response in acceleration of modes f_j, ζ_j with complex shapes Φ (m, r) to modal loads of the spectrum C Cᴴ
(f/f_c)^a, beside whatever else is in the band, L Lᴴ (f/f_c)^b: noise and the flanks of other modes, any Hermitian
matrix. C is lower triangular with ones on its diagonal, so that the size of a column of Φ carries the level of its
load, and one element of each column is real, since the phase of a column means nothing. D is convolved with the taper's
window (`windsysid.spectral.dft`).

A step δ of the unknowns has this order: ln f (r), ln ζ (r), Re Φ (m r, by columns), Im Φ (less the real elements), Re
and Im of C below its diagonal, a (where there is a mode), X, b. X is Hermitian, m² real numbers: L Lᴴ ← L exp(X) Lᴴ,
which is the same whatever the units of the channels are.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.dft import Band
from windsysid.spectral.modal_kernel import whitened_slopes

__all__ = ["Modes", "Scores", "advance", "coordinates", "responses", "scores", "spectrum", "with_real_elements"]


FLOOR = 1e-10
"""Least power of what else is in a band, each channel being scaled to a power of about 1."""


class Modes(NamedTuple):
    """The unknowns of a band.

    Attributes
    ----------
    frequency, damping
        (r,) [Hz], (r,) [1].
    shape
        Φ (m, r).
    load
        C (r, r).
    load_slope
        a.
    rest
        L (m, m).
    rest_slope
        b.
    """

    frequency: Array
    damping: Array
    shape: Complex
    load: Complex
    load_slope: float
    rest: Complex
    rest_slope: float

    @property
    def real(self) -> NDArray[np.int64]:
        """Which element of each shape is real (r,)."""
        return np.asarray(
            np.argmin(np.abs(self.shape.imag) / np.maximum(np.abs(self.shape), 1e-300), axis=0), dtype=np.int64
        )

    @property
    def size(self) -> int:
        """Number of unknowns."""
        m, r = self.shape.shape
        return int(2 * r + 2 * m * r - r + r * (r - 1) + (r > 0) + m * m + 1)


class Scores(NamedTuple):
    """Σ n (ln det S̄ + tr S̄⁻¹ P), its gradient (p,) and its expected second derivatives (p, p)."""

    cost: float
    gradient: Array
    fisher: Array


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
    return modes._replace(shape=phi, load=turn[:, None] * modes.load * turn.conj()[None])


def coordinates(modes: Modes) -> Array:
    """The unknowns of which a prior speaks: ln ζ (r), C (r (r − 1)), a and b, in the order of a step."""
    below = np.tril_indices(len(modes.load), -1)
    c = modes.load[below]
    slope = [modes.load_slope] if len(modes.frequency) else []
    return np.concatenate([np.log(modes.damping), c.real, c.imag, slope, [modes.rest_slope]])


def advance(modes: Modes, step: Array) -> Modes:
    """The modes after a step δ."""
    m, r = modes.shape.shape
    low, below = r * (r - 1) // 2, m * (m - 1) // 2
    sizes = [r, r, m * r, m * r - r, low, low, int(r > 0), m, below, below, 1]
    f, z, re, im, cr, ci, a, d, xr, xi, b = np.split(step, np.cumsum(sizes)[:-1])
    turned = np.ones((m, r), dtype=bool)
    turned[modes.real, range(r)] = False
    imaginary = np.zeros((r, m))
    imaginary[turned.T] = im
    load = modes.load.copy()
    load[np.tril_indices(r, -1)] += cr + 1j * ci
    x = np.diag(d).astype(np.complex128)
    x[np.tril_indices(m, -1)] = xr + 1j * xi
    sizes_x, directions = np.linalg.eigh(x)  # of its lower triangle
    grown = modes.rest @ directions * np.exp(0.5 * np.clip(sizes_x, -2.0, 2.0))
    rest = np.linalg.cholesky(grown @ grown.conj().T + FLOOR * np.eye(m))
    return Modes(
        modes.frequency * np.exp(f),
        modes.damping * np.exp(z),
        modes.shape + (re.reshape(r, m) + 1j * imaginary).T,
        load,
        modes.load_slope + float(a.sum()),
        rest,
        modes.rest_slope + float(b[0]),
    )


def spectrum(modes: Modes, band: Band) -> Complex:
    """S̄ (K, m, m) in the rows of the band."""
    h = responses(modes, band.fine)[0]
    return _spectrum(
        modes, _convolved(h[:, None] * h.conj()[None] * _tilt(band.fine, band, modes.load_slope), band), band
    )


def scores(modes: Modes, band: Band) -> Scores:
    """The likelihood of a band's data with its slopes."""
    m, _r = modes.shape.shape
    h, h_f, h_z = responses(modes, band.fine)
    turned = h.conj()[None] * _tilt(band.fine, band, modes.load_slope)
    whole = h[:, None] * turned
    bend = np.log(band.fine / _centre(band))
    d, d_f, d_z, d_a = (
        _convolved(each, band) for each in (whole, h_f[:, None] * turned, h_z[:, None] * turned, whole * bend)
    )
    k = len(band.frequency)
    tilt = _tilt(band.frequency, band, modes.rest_slope)
    bent = tilt * np.log(band.frequency / _centre(band))
    slopes, misfit = np.zeros((modes.size, k, m * m)), np.empty((k, m * m))
    cost = whitened_slopes()(
        band.power,
        d,
        d_f,
        d_z,
        d_a,
        _spectrum(modes, d, band),
        band.counts,
        tilt,
        bent,
        np.ascontiguousarray(modes.shape),
        modes.load,
        np.ascontiguousarray(modes.rest),
        modes.real,
        slopes,
        misfit,
    )
    flat = slopes.reshape(modes.size, -1)
    return Scores(cost, flat @ misfit.ravel(), flat @ flat.T)


def responses(modes: Modes, frequency: Array) -> tuple[Complex, Complex, Complex]:
    """h (r, F) and its derivatives to ln f and ln ζ."""
    ratio = frequency[None] / modes.frequency[:, None]
    zeta = modes.damping[:, None]
    x = ratio**2
    q: Complex = 1.0 - x + 2j * zeta * ratio
    h: Complex = -x / q
    by_ratio = -2.0 * ratio / q + x * (-2.0 * ratio + 2j * zeta) / q**2
    return h, -ratio * by_ratio, zeta * x * 2j * ratio / q**2


def _spectrum(modes: Modes, d: Complex, band: Band) -> Complex:
    """S̄ (K, m, m) from D convolved (K, r, r)."""
    modal = modes.shape @ (d * (modes.load @ modes.load.conj().T)) @ modes.shape.conj().T
    rest = modes.rest @ modes.rest.conj().T
    return np.ascontiguousarray(modal + _tilt(band.frequency, band, modes.rest_slope)[:, None, None] * rest)


def _convolved(values: Complex, band: Band) -> Complex:
    """Functions (r, r, F) at `fine` as their expectations (K, r, r) in the rows of the band."""
    columns = np.ascontiguousarray(values.transpose(2, 0, 1))
    if band.window is None:
        return columns
    if not columns.size:
        return np.empty((len(band.frequency), 0, 0), dtype=np.complex128)
    parts = columns.reshape(len(columns), -1).view(np.float64)  # real times real: the window is real
    return (band.window @ parts).view(np.complex128).reshape(-1, *columns.shape[1:])


def _centre(band: Band) -> float:
    return float(np.sqrt(band.frequency[0] * band.frequency[-1]))


def _tilt(frequency: Array, band: Band, slope: float) -> Array:
    return np.asarray((frequency / _centre(band)) ** slope)
