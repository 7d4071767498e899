"""Scores of a fit over frequencies, from the spectrum of its standardised innovations.

A filter of equations that do not change with time makes innovations Z(f) = H(f; θ) Y(f) of readings Y. With the
derivatives M_a = ∂H/∂θ_a H⁻¹ and G_a = M_a + M_aᴴ, Whittle's likelihood has at each frequency

    score_a = tr G_a (I − Z Zᴴ),        information_ab = tr G_a G_b,

Z normalised to the covariance I. H is the response to an impulse in each reading, of filters at neighbouring unknowns
(`windsysid.identification.estimate.scoring`). The impulse is differenced twice, which cancels in M, so that states with
infinite memory, such as a bias, leave no truncated tail.
"""

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.dispersion import PartScores
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.estimate.fitted.linearisation import Linearisation
from windsysid.identification.estimate.fitted.spectra import spectra_of_filter
from windsysid.identification.estimate.scoring import DIFFERENCE_STEP_SIGMAS, neighbours
from windsysid.results.estimate import FittedSpectrum
from windsysid.signals.inputs import TURNING

__all__ = ["scores_over_frequency"]

IMPULSE = (1.0, -2.0, 1.0)
"""Numerical: an impulse, differenced twice."""

MIN_READ_SHARE = 0.9
"""Setting: share of the readings of a channel below which a spectrum with gaps is no estimate."""

MAX_FREQUENCY_RANGES = 128
"""Setting: ranges of frequency of equal information into which bins are joined, so that memory is bounded."""


def scores_over_frequency(at: Linearisation, precision: Array) -> tuple[PartScores, tuple[FittedSpectrum, ...]] | None:
    """Scores of a fit over frequencies, under a prior precision (n, n), and the spectra of its readings; None if the
    equations change with time, loads are measured, a channel has gaps, or the record is too short."""
    z, steps = at.innovations, at.steps  # of samples with a reading
    samples, m = z.shape
    read = np.mean(z != 0.0, axis=0)
    if not _is_time_invariant(at) or samples < 4 * (m + 1) * len(IMPULSE) or read.min() < MIN_READ_SHARE:
        return None
    whitening, slopes = _log_slopes(at, samples, m)
    spectrum = np.fft.rfft(z, axis=0)[1:-1] / np.sqrt(samples * read)
    power = np.eye(m) - spectrum[:, :, None] * spectrum[:, None, :].conj()
    gradients = np.einsum("fnij,fji->fn", slopes, power).real
    information = np.einsum("fnij,foji->fno", slopes, slopes).real
    share = np.einsum("fno,on->f", information, np.linalg.inv(information.sum(axis=0) + precision))
    label = (MAX_FREQUENCY_RANGES * (np.cumsum(share) - 0.5 * share) / share.sum()).astype(int)
    first = np.unique(label, return_index=True)[1]
    frequency = np.arange(1, len(share) + 1) / (samples * steps * (at.time[1] - at.time[0]))
    spectra = spectra_of_filter(whitening, slopes, at.cov, frequency, at.problem.sensors)
    scores = PartScores(
        "frequency",
        np.add.reduceat(frequency * share, first) / np.add.reduceat(share, first),
        np.add.reduceat(gradients, first),
        np.add.reduceat(information, first),
        precision,
        precision @ (at.problem.wide_prior[0] - at.unknowns),
    )
    return scores, spectra


def _is_time_invariant(at: Linearisation) -> bool:
    """Test whether no blade moves, the nacelle does not yaw, no load is measured, and samples are equidistant."""
    if any(freedom.blade for freedom in at.problem.turbine.model.freedoms):
        return False
    names = at.problem.model.compiled.inputs
    known = [i for i in range(at.inputs.shape[1]) if i >= len(names) or names[i] not in TURNING]
    steps = np.diff(at.time)
    return bool(np.ptp(at.inputs[:, known], axis=0).max(initial=0.0) == 0.0 and np.ptp(steps) < 1e-3 * steps.mean())


def _log_slopes(at: Linearisation, samples: int, m: int) -> tuple[Complex, Complex]:
    """H and G at the frequencies between zero and the highest (F, m, m), (F, n, m, m)."""
    widths = DIFFERENCE_STEP_SIGMAS * np.sqrt(np.diag(at.cov))
    models = [at.problem.build(one) for one in neighbours(at.unknowns, widths)]
    silent = np.full(at.readings.shape, np.nan)
    silent[:: at.steps] = 0.0
    struck, apart = silent.copy(), samples // (m + 1)
    for reading in range(m):
        for k, size in enumerate(IMPULSE):
            struck[((reading + 1) * apart + k) * at.steps, reading] = size
    before, after = (run_bank(bank_of(models), at.inputs, of)[1].whitened[:: at.steps] for of in (silent, struck))
    response = [
        np.fft.rfft((after - before)[(reading + 1) * apart :][:apart], n=samples, axis=0)[1:-1] for reading in range(m)
    ]
    H = np.moveaxis(np.stack(response, axis=2), -1, 1)
    M = (H[:, 1:] - H[:, :1]) @ np.linalg.inv(H[:, :1]) / widths[:, None, None]
    impulse = np.fft.rfft(np.array(IMPULSE), n=samples)[1:-1]
    return H[:, 0] / impulse[:, None, None], np.asarray(M + np.conj(np.swapaxes(M, -1, -2)))
