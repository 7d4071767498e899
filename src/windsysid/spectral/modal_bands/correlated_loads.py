"""Correlated modal loads: detection by a score test, and a model with shapes that vary over the band.

A gust on all storeys, or motion of the ground, drives a mode and the rest of the structure at once. The motion d of the
rest is coherent with that of the mode, φ h + d, and distorts the spectrum unless d is small: a frequency can be ten
standard deviations off. A model with shapes that vary over the band, Φ + Ψ (f/f_j − 1), describes it
(`windsysid.spectral.modal_bands.model`). The fit without Ψ is tested by its score, gᵀ F⁻¹ g for the derivatives g to Ψ
with all other unknowns eliminated, χ² with as many degrees of freedom if loads are independent (Rao, Proc. Camb. Phil.
Soc. 44, 1948, https://doi.org/10.1017/S0305004100023987).
"""

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import MODEL_CHANGE_PROBABILITY, STRONG_LOG_ODDS
from windsysid.spectral.modal_bands.model import Modes, with_real_elements
from windsysid.spectral.modal_bands.scoring import COARSE_TOLERANCE, ModalFit, evidence, score, slopes
from windsysid.spectral.modal_bands.start import add_mode, modes_at
from windsysid.spectral.transforms.dft import Band

__all__ = ["are_shared", "fit_shared"]

MIN_INFORMATION_SHARE = 1e-8
"""Numerical: smallest information on a direction of Ψ over the largest."""

MAX_STEPS, MAX_STEPS_OF_MORE_MODES = 60, 40
"""Numerical: largest number of steps of a search from each start, and with one mode more."""

MAX_MODES = 3
"""Setting: largest number of modes under correlated loads: Ψ replaces further modes."""


def are_shared(fit: ModalFit, band: Band) -> bool:
    """True if the load of any mode of a fit without Ψ also drives other modes."""
    from scipy.special import chdtrc

    modes = fit.modes.let_drift()
    m, r = modes.shape.shape
    found, weight = slopes(modes, band)
    n = modes.size - modes.drifting
    solved = np.linalg.solve(found.fisher[:n, :n], np.column_stack([found.fisher[:n, n:], found.gradient[:n]]))
    information = found.fisher[n:, n:] - np.diag(weight[-modes.drifting :]) - found.fisher[n:, :n] @ solved[:, :-1]
    gradient = found.gradient[n:] - found.fisher[n:, :n] @ solved[:, -1]
    for j in range(r):
        own = j * m + np.concatenate([np.arange(m), m * r + np.arange(m)])
        sizes, ways = np.linalg.eigh(information[np.ix_(own, own)])
        seen = sizes > MIN_INFORMATION_SHARE * sizes[-1]
        if chdtrc(seen.sum(), np.sum((ways[:, seen].T @ gradient[own]) ** 2 / sizes[seen])) < MODEL_CHANGE_PROBABILITY:
            return True
    return False


def fit_shared(plain: ModalFit, band: Band, bins: int, most: int) -> ModalFit | None:
    """The most evident fit with Ψ of at most `most` modes, from several starts: the fit without Ψ, its strongest mode
    alone, and that mode with the shapes that the directions of the readings show; None where the fit without Ψ is more
    evident."""
    modes = plain.modes
    strongest = int(np.argmax(np.linalg.norm(modes.shape, axis=0) / modes.damping))
    f, zeta = float(modes.frequency[strongest]), float(modes.damping[strongest])
    starts = [_from_directions(f, zeta, band), modes_at([(f, zeta)], band).let_drift()]
    fits = [score(start, band, max_steps=MAX_STEPS) for start in starts]
    if len(modes.frequency) > 1:
        fits.append(score(modes.let_drift(), band, max_steps=MAX_STEPS))
    last = min(fits[:2], key=lambda fit: evidence(fit, bins))
    for _ in range(2, min(most, MAX_MODES) + 1):
        more = score(
            add_mode(last.modes, band).let_drift(), band, max_steps=MAX_STEPS_OF_MORE_MODES, tolerance=COARSE_TOLERANCE
        )
        fits.append(more)
        if evidence(more, bins) > evidence(last, bins) - 2.0 * STRONG_LOG_ODDS:
            break
        last = more
    best = min(fits, key=lambda fit: evidence(fit, bins))
    return best if evidence(best, bins) < evidence(plain, bins) else None


def _from_directions(f: float, zeta: float, band: Band) -> Modes:
    """A mode at f with the Φ and Ψ along which the readings stand at every frequency. Under one load they are Φ + Ψ x
    but for a factor, x = f/f_j − 1, so that what is across is least."""
    power, m = band.power, band.power.shape[1]
    x = band.frequency / f - 1.0
    size = np.einsum("kii->k", power).real
    across = size[:, None, None] * np.eye(m) - power
    moments = [np.tensordot(band.counts * x**order, across, 1) for order in range(3)]
    scale = np.concatenate([np.ones(m), np.full(m, 1.0 / np.sqrt(np.mean(x**2)))])
    both = scale[:, None] * np.block([[moments[0], moments[1]], [moments[1], moments[2]]]) * scale
    least = scale * np.linalg.eigh(both)[1][:, 0]
    along = least[:m] + x[:, None] * least[m:]
    square = np.sum(np.abs(along) ** 2, axis=1)
    expected: Array = square / (4.0 * (x**2 + zeta**2))
    level = np.sqrt(band.counts @ size / (band.counts @ expected))
    outside = np.eye(m) - along[:, :, None] * along.conj()[:, None, :] / square[:, None, None]
    rest = np.tensordot(band.counts, outside @ power @ outside, 1) / band.counts.sum()
    rest = 0.5 * (rest + rest.conj().T) + (1e-6 * np.trace(rest).real + 1e-9 * np.mean(size)) * np.eye(m)
    shape, drift = level * least[:m, None], level * least[m:, None]
    whole = np.eye(1, dtype=np.complex128)
    return with_real_elements(
        Modes(np.array([f]), np.array([zeta]), shape, whole, 0.0, np.linalg.cholesky(rest), 0.0, drift)
    )
