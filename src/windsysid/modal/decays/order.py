"""Number of modes in free decays: one after the other is added, as long as the evidence rises.

The evidence is Schwarz's approximation (Ann. Statist. 6, 1978, https://doi.org/10.1214/aos/1176344136) with Whittle's
likelihood of the residuals, noise of any smooth spectrum: 2 Σ_f ln S̄(f), periodograms averaged over a few bins. So
coloured noise needs no modes, and in ambient vibration, whose resonances have many independent bins, a decay explains
too few of them.
"""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import STRONG_LOG_ODDS
from windsysid.modal.decays.likelihood import Decay, DecayFit, fit_decays, poles
from windsysid.modal.decays.limits import MAX_DAMPING, MAX_MODES, MIN_CYCLES
from windsysid.modal.decays.start import AVERAGED_BINS, realized_modes, residual_modes
from windsysid.signals.textbook import tukey
from windsysid.spectral.oma.limits import MAX_FREQUENCY_SHARE

__all__ = ["search_decays"]

TAPERED_SHARE = 0.04
"""Setting: share of a residual in the tapers at its beginning and end."""

MAX_TRIALS = 6
"""Setting: number of candidates that are fitted before the search ends."""

TRIAL_STEPS = 12
"""Setting: iterations of the fit of a candidate; those of its last fit follow."""


def search_decays(decays: Sequence[Decay], limits: tuple[float, float] | None = None) -> DecayFit:
    """Find the modes of free decays, between two frequencies [Hz] if these are given."""
    low = max(MIN_CYCLES * one.rate / len(one.values) for one in decays)
    high = min(MAX_FREQUENCY_SHARE * one.rate for one in decays)
    low, high = (max(low, limits[0]), min(high, limits[1])) if limits is not None else (low, high)
    known = [mode for one in decays for mode in realized_modes(one, high)]
    known += [mode for one in decays for mode in realized_modes(one, min(high, 1.5 * _strongest_range(one)))]
    best = fit_decays(np.empty(0), decays)
    while len(best.theta) < 2 * MAX_MODES:
        more = _with_one_more(best, decays, [*known, *residual_modes(best, decays)], (low, high))
        if more is None:
            break
        best = more
    return best


def _strongest_range(decay: Decay) -> float:
    """Highest frequency with a thousandth of the largest power [Hz]."""
    size = np.abs(np.fft.rfft(decay.values - decay.values.mean(axis=0), axis=0)).sum(axis=1)
    return float(max(np.flatnonzero(size > 0.03 * size.max())) * decay.rate / len(decay.values))


def _with_one_more(
    best: DecayFit, decays: Sequence[Decay], candidates: Sequence[tuple[float, float]], between: tuple[float, float]
) -> DecayFit | None:
    """Fit with the mode that explains most of the residual; None if the evidence does not rise."""
    inside = [mode for mode in candidates if between[0] <= mode[0] <= between[1]]
    gains = [_gain(best, decays, mode) for mode in inside]
    channels = sum(one.values.shape[1] for one in decays)
    samples = sum(len(one.values) for one in decays)
    needed = (2.0 + 2.0 * channels) * np.log(samples) + 2.0 * STRONG_LOG_ODDS
    for mode in _apart([inside[i] for i in np.argsort(gains)[::-1]])[:MAX_TRIALS]:
        more = fit_decays(_added(best.theta, mode), decays, TRIAL_STEPS)
        if _whittle(best) - _whittle(more) > needed and _is_possible(more, between):
            return fit_decays(more.theta, decays)
    return None


def _apart(candidates: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Candidates without those near an earlier one."""
    kept: list[tuple[float, float]] = []
    for f, z in candidates:
        if all(abs(f - g) > 0.3 * max(z * f, y * g) or abs(np.log(z / y)) > 0.7 for g, y in kept):
            kept.append((f, z))
    return kept


def _whittle(fit: DecayFit) -> float:
    """−2 ln of Whittle's likelihood of the residuals, with smooth spectra of their own.

    Tapered ends keep the skirts of modes that are still missing from covering what another one explains.
    """
    total = 0.0
    for one in fit.records:
        taper = tukey(len(one.residual), TAPERED_SHARE)[:, None]
        power = np.abs(np.fft.rfft(taper * one.residual, axis=0)[1:]) ** 2
        starts = np.arange(0, len(power), AVERAGED_BINS)
        count = np.diff(np.append(starts, len(power)))[:, None]
        mean = np.add.reduceat(power, starts, axis=0) / count + one.floor * len(one.residual)
        total += 2.0 * float(np.sum(count * np.log(np.maximum(mean, 1e-300))))
    return total


def _is_possible(fit: DecayFit, between: tuple[float, float]) -> bool:
    """True if frequencies and damping ratios are within their ranges, and no two modes are one."""
    f, z = fit.frequency, fit.damping
    inside = bool(np.all((f > between[0]) & (f < between[1]) & (z < 0.99 * MAX_DAMPING)))
    apart = np.abs(poles(fit.theta)[0][:, None] - poles(fit.theta)[0]) + np.eye(len(f)) * 1e9
    return inside and bool(np.all(apart > 1e-3 * (2.0 * np.pi * f * z)))


def _gain(best: DecayFit, decays: Sequence[Decay], mode: tuple[float, float]) -> float:
    """Fall of −2 ln of the likelihood by one mode more, the others fixed."""
    total = 0.0
    pole = poles(np.log(mode))[0][0]
    for one, decay in zip(best.records, decays, strict=True):
        wave = np.exp(pole * decay.time)
        both = np.column_stack([wave.real, wave.imag])
        both -= one.basis @ (one.basis.T @ both)
        basis = np.linalg.qr(both)[0]
        explained = np.sum((basis.T @ one.residual) ** 2, axis=0) / np.maximum(np.sum(one.residual**2, axis=0), 1e-300)
        total -= len(one.residual) * float(np.sum(np.log(np.maximum(1.0 - explained, 1e-12))))
    return total


def _added(theta: Array, mode: tuple[float, float]) -> Array:
    r = len(theta) // 2
    return np.concatenate([theta[:r], [np.log(mode[0])], theta[r:], [np.log(mode[1])]])
