"""Likelihood of free decays: damped sinusoids with common frequencies and damping ratios in white noise.

Channel c of a record reads at the times t after the release

    y_c(t) = Σ_j Re[a_cj exp(λ_j t)] + p_c + q_c t + e_c(t),        λ_j = ω_j (−ζ_j + i √(1 − ζ_j²)),

with white noise e of the variance σ_c². Amplitudes, offsets, trends and variances are each channel's own in each
record, and are eliminated in closed form (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973,
https://doi.org/10.1137/0710036). With the residual maker P⊥ of the basis, the profile likelihood −½ Σ T ln RSS_c has
the scores J⊥ᵀ e / σ², J⊥ = P⊥ ∂y/∂θ, and the information J⊥ᵀ J⊥ / σ² for θ = (ln f, ln ζ). ln ζ has the prior of
ambient vibration. Scores of parts of the record, in time and over frequencies, tell where noise is not white or modes
do not stay the same (`checks.dispersion`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.dispersion import PartScores
from windsysid.modal.decays.limits import MAX_DAMPING, MIN_NOISE, TIME_PARTS
from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR

__all__ = ["Decay", "DecayFit", "Projection", "fit_decays", "misfit", "part_scores", "project"]

MAX_STEPS, MAX_STEP, STEP_TOLERANCE = 60, 0.5, 1e-3
"""Numerical: iterations, largest step of a logarithm, and the step in standard deviations at which they end."""

MIN_DAMPING_FACTOR, POOR_GAIN, GOOD_GAIN = 1e-3, 0.25, 0.75
"""Numerical: damping of the steps over the information after one that failed, at least, and ratios of the gain of a
step to the predicted one below which it rises, and above which it falls."""

BLOCK_EDGES = np.array([0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0])
"""Numerical: edges of frequency blocks around a mode, in half-widths, one bin at least."""


class Decay(NamedTuple):
    """Readings (T, n) of one record from the release on, at a rate [Hz]."""

    values: Array
    rate: float

    @property
    def time(self) -> Array:
        """(T,) [s], 0 at the release."""
        return np.arange(len(self.values)) / self.rate


class Projection(NamedTuple):
    """One record with given modes.

    Attributes
    ----------
    amplitude
        (r, n) complex a_cj.
    residual, noise, floor
        (T, n) e, (n,) σ², and the smallest σ² that is believed.
    slopes
        (T, 4 r): P⊥ applied to Re and −Im of t λ exp(λt), and of t ∂λ/∂ln ζ exp(λt).
    triangle, basis
        R (p, p) and Q (T, p) of the basis.
    """

    amplitude: Complex
    residual: Array
    noise: Array
    floor: Array
    slopes: Array
    triangle: Array
    basis: Array

    def weights(self) -> Array:
        """(n, 4 r, 2 r): from `slopes` to J⊥ of each channel."""
        r, n = self.amplitude.shape
        found = np.zeros((n, 4 * r, 2 * r))
        for k in range(2 * r):
            found[:, 2 * k, k], found[:, 2 * k + 1, k] = self.amplitude[k % r].real, self.amplitude[k % r].imag
        return found

    def information(self, gram: Array, products: Array) -> tuple[Array, Array]:
        """Scores (2 r,) and information (2 r, 2 r) from `slopes`ᵀ `slopes` (4 r, 4 r) and `slopes`ᵀ e (4 r, n)."""
        w = self.weights() / np.sqrt(self.noise)[:, None, None]
        gradient = np.einsum("cik,ic,c->k", w, products, 1.0 / np.sqrt(self.noise))
        return gradient, np.einsum("cik,ij,cjl->kl", w, gram, w)


class DecayFit(NamedTuple):
    """Maximum of the posterior: ln f and ln ζ of the modes (2 r,), their covariance, each record's projection, and
    −2 ln of the profile likelihood."""

    theta: Array
    cov: Array
    records: tuple[Projection, ...]
    double_misfit: float

    @property
    def frequency(self) -> Array:
        """(r,) [Hz]."""
        return np.exp(self.theta[: len(self.theta) // 2])

    @property
    def damping(self) -> Array:
        """(r,) [1]."""
        return np.exp(self.theta[len(self.theta) // 2 :])


def poles(theta: Array) -> tuple[Complex, Complex]:
    """λ (r,) and ∂λ/∂ln ζ (r,) [1/s]."""
    r = len(theta) // 2
    omega, zeta = 2.0 * np.pi * np.exp(theta[:r]), np.exp(theta[r:])
    root = np.sqrt(1.0 - zeta**2)
    return omega * (-zeta + 1j * root), omega * zeta * (-1.0 - 1j * zeta / root)


def project(theta: Array, decay: Decay) -> Projection:
    """Eliminate the amplitudes of one record, by least squares."""
    t, (pole, slope) = decay.time, poles(theta)
    r = len(pole)
    waves = np.exp(pole * t[:, None])
    trend = np.column_stack([np.ones_like(t), t / t[-1] - 0.5])
    basis, triangle = np.linalg.qr(np.hstack([waves.real, -waves.imag, trend]))
    seen = basis.T @ decay.values
    residual = decay.values - basis @ seen
    solved = np.linalg.solve(triangle, seen)
    amplitude = solved[:r] + 1j * solved[r : 2 * r]
    freedom = max(len(t) - len(triangle) - len(theta) / max(decay.values.shape[1], 1), 1.0)
    floor = MIN_NOISE**2 * np.var(decay.values, axis=0) + 1e-300
    noise = np.sum(residual**2, axis=0) / freedom + floor
    turned = np.hstack([waves * pole, waves * slope]) * t[:, None]
    slopes = np.stack([turned.real, -turned.imag], axis=2).reshape(len(t), 4 * r)
    return Projection(amplitude, residual, noise, floor, slopes - basis @ (basis.T @ slopes), triangle, basis)


def misfit(projection: Projection) -> float:
    """−2 ln of the profile likelihood of a record: Σ T ln σ²."""
    return float(len(projection.residual) * np.sum(np.log(projection.noise)))


def _damping_after(gain: float, damped: float) -> float:
    """Damping after a step with a gain over the predicted one (Madsen, Nielsen & Tingleff 2004, Methods for non-linear
    least squares problems)."""
    if gain < POOR_GAIN:
        return max(4.0 * damped, MIN_DAMPING_FACTOR)
    return max(0.2 * damped, 1e-9) if gain > GOOD_GAIN else damped


def fit_decays(theta: Array, decays: Sequence[Decay], steps: int = MAX_STEPS) -> DecayFit:
    """Maximise the posterior of all records from a start value, by damped Gauss–Newton steps."""
    r, damped = len(theta) // 2, 1e-6
    precision, centre = np.zeros(2 * r), np.zeros(2 * r)
    precision[r:], centre[r:] = DAMPING_PRIOR[1] ** -2.0, DAMPING_PRIOR[0]

    def cost(at: Array) -> tuple[float, list[Projection]]:
        records = [project(at, decay) for decay in decays]
        return sum(map(misfit, records)) + float(precision @ (at - centre) ** 2), records

    lowest, records = cost(theta)
    for _ in range(steps):
        both = [one.information(one.slopes.T @ one.slopes, one.slopes.T @ one.residual) for one in records]
        gradient = sum(g for g, _ in both) - precision * (theta - centre)
        F = sum(f for _, f in both) + np.diag(precision)
        step = np.linalg.solve(F + damped * np.diag(np.diag(F)), gradient)
        step *= min(1.0, MAX_STEP / float(np.max(np.abs(step), initial=1e-300)))
        trial = theta + step
        trial[r:] = np.minimum(trial[r:], np.log(MAX_DAMPING))
        now, tried = cost(trial)
        gain = (lowest - now) / max(float(2.0 * step @ gradient - step @ F @ step), 1e-300)
        damped = _damping_after(gain, damped)
        if now <= lowest:
            theta, records, lowest = trial, tried, now
        if float(step @ F @ step) < STEP_TOLERANCE**2 or damped > 1e6:
            break
    cov = np.asarray(np.linalg.inv(F)) if r else np.empty((0, 0))
    return DecayFit(theta, cov, tuple(records), lowest)


def part_scores(fit: DecayFit, decays: Sequence[Decay]) -> list[PartScores]:
    """Scores and information of segments of the records, and of blocks of frequencies around the modes."""
    r = len(fit.theta) // 2
    precision = np.zeros(2 * r)
    precision[r:] = DAMPING_PRIOR[1] ** -2.0
    pull = -precision * (fit.theta - np.repeat([0.0, DAMPING_PRIOR[0]], r))
    found = []
    for over, parts in (("time", _time_parts(fit, decays)), ("frequency", _frequency_parts(fit, decays))):
        places, gradients, information = (np.array(each) for each in zip(*parts, strict=True))
        found.append(PartScores(over, places, gradients, information, np.diag(precision), pull))  # type: ignore[arg-type]
    return found


def _time_parts(fit: DecayFit, decays: Sequence[Decay]) -> list[tuple[float, Array, Array]]:
    found = []
    for one, decay in zip(fit.records, decays, strict=True):
        for rows in np.array_split(np.arange(len(decay.values)), TIME_PARTS):
            slopes, residual = one.slopes[rows], one.residual[rows]
            scores = one.information(slopes.T @ slopes, slopes.T @ residual)
            found.append((float(decay.time[rows].mean()), *scores))
    return found


def _frequency_parts(fit: DecayFit, decays: Sequence[Decay]) -> list[tuple[float, Array, Array]]:
    found = []
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(decay.values)
        slopes, residual = (np.fft.rfft(values, axis=0) for values in (one.slopes, one.residual))
        step = decay.rate / samples
        reach = BLOCK_EDGES[:, None] * np.maximum(fit.frequency * fit.damping, step)
        edges = np.unique(np.round(np.concatenate([fit.frequency - reach, fit.frequency + reach]).ravel() / step))
        inner = edges[(edges > 0) & (edges < len(slopes))].astype(int)
        for first, past in zip([0, *inner], [*inner, len(slopes)], strict=True):
            rows = slice(first, past)
            count = np.where((np.arange(first, past) == 0) | (2 * np.arange(first, past) == samples), 1.0, 2.0)
            seen = slopes[rows].conj().T * (count / samples)
            scores = one.information((seen @ slopes[rows]).real, (seen @ residual[rows]).real)
            found.append((0.5 * (first + past - 1) * step, *scores))
    return found
