"""Spectra of bins and their derivatives by products of matrices, as `windsysid` has them by loops."""

from itertools import chain
from typing import NamedTuple

import numpy as np

from windsysid.spectral.rotor.harmonic_transfer import MatrixHarmonics, coupled
from windsysid.spectral.rotor.likelihood import Ingredients, Slopes, SpectrumGrid
from windsysid.spectral.rotor.load_spectra import SourceSpectra
from windsysid.spectral.transforms.lifted import Complex


class Response(NamedTuple):
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


def respond(of: Ingredients) -> Response:
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
    return Response(T, T_s, inverse @ (of.placement @ _h(driven)), signal, S, turn, phase)


def differentiate(of: Ingredients, slopes: Slopes, response: Response) -> Complex:
    """The derivatives of S (n, B, e, e)."""
    T, T_s, Q = response.transfer, response.placed, response.driven
    moved = slopes.mechanics.mechanics.shape[1]
    halves = chain(
        (_mechanical(slopes.mechanics, a, of.place, T, Q, response.phase) for a in range(moved)),
        ((response.turn * later)[:, :, None] * response.signal for later in slopes.late),
    )
    wholes = chain(
        (half + _h(half) for half in halves),
        (times_sources(T_s, SourceSpectra(*slope)) @ _h(T_s) for slope in zip(*slopes.sources, strict=True)),
        (np.where(of.place.left_out, 0.0, density)[:, :, None] * np.eye(T.shape[1]) for density in slopes.noise),
    )
    count = moved + len(slopes.late) + len(slopes.sources.own) + len(slopes.noise)
    A = np.empty((count, *response.spectrum.shape), dtype=np.complex128)
    for a, whole in enumerate(wholes):
        A[a] = whole
    return A


def times_sources(matrix: Complex, sources: SourceSpectra) -> Complex:
    """Matrices (B, e, s) times the covariance of the sources."""
    out = np.asarray(matrix * sources.own[:, None, :])
    pairs = sources.cross.shape[1]
    if pairs:
        out[..., :pairs] += matrix[..., pairs : 2 * pairs] * sources.cross[:, None, :]
        out[..., pairs : 2 * pairs] += matrix[..., :pairs] * sources.cross[:, None, :]
    return out


def _mechanical(
    slopes: MatrixHarmonics, which: int, place: SpectrumGrid, T: Complex, Q: Complex, phase: Complex | None
) -> Complex:
    """(dR − T dD) Q of one mechanical unknown (B, e, e); `phase` (B, e, 1) is what late clocks make of readings."""
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
        half += sub @ right[:, :, columns].reshape(bins, count * len(columns), -1)
    return half


def _h(matrix: Complex) -> Complex:
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)))
