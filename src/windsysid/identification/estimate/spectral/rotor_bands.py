"""Identify a turning rotor of a real machine from spectra in bands around its modes.

The problem is built by `windsysid.spectral.rotor_bands.build`.
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification.estimate.fitted.spectra import joined_spectrum, spectra_of_model
from windsysid.identification.estimate.prior_conflict import find_held, one_by_one
from windsysid.loads.statistics import Statistic
from windsysid.results.estimate import FittedSpectrum
from windsysid.results.finding import Finding
from windsysid.scoring import covariance
from windsysid.spectral.rotor.model import Inexact
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.rotor_bands.build import PosedBands, centre_bands, search_bands
from windsysid.spectral.rotor_bands.check import judge_bands
from windsysid.spectral.rotor_bands.limits import BLADE_STIFFNESS_DISCREPANCY
from windsysid.spectral.rotor_bands.model import BandModel
from windsysid.statespace.unknowns import Unknowns

__all__ = ["SpectralEstimate", "read_in_bands"]


class SpectralEstimate(NamedTuple):
    """Estimate of the unknowns from spectra.

    Attributes
    ----------
    unknowns, cov, blocks
        Mode of the posterior (n,), its covariance (n, n), and the names of the unknowns.
    log_likelihood
        There.
    statistics, doubts, notes, held, spectra, scores
        As `windsysid.identification.model.fit.Outcome` has them.
    """

    unknowns: Array
    cov: Array
    blocks: Unknowns
    log_likelihood: float
    statistics: tuple[Statistic, ...]
    doubts: tuple[Finding, ...]
    notes: tuple[Finding, ...]
    held: tuple[str, ...]
    spectra: tuple[FittedSpectrum, ...] = ()
    scores: tuple[PartScores, ...] = ()


def read_in_bands(question: RotorQuestion, loads: str, inexact: Inexact | None = None) -> SpectralEstimate | None:
    """Coefficients and statistics from bands around the modes; with τ where instruments or masses are not exact. None
    where the modes cannot be separated.

    Raises
    ------
    RecordError, ConfigurationError, WindsysidError
        If the record is too short, loads of one kind are requested, or no spectrum fits.
    """
    if loads == "rotor-wind":
        raise ConfigurationError(
            "load model rotor-wind: bands around the modes of a real rotor have loads of their own; leave loads= out"
        )
    posed = search_bands(question)
    if posed is None:
        return None
    try:
        posed = centre_bands(question, posed, posed.model.near(posed.start))
        fit = posed.model.fit(posed.start)
        wide = fit if inexact is None else fit.model.admit(fit.mode.point, inexact)
        found = wide.mode
        cov = _with_discrepancy(question, covariance(found.evaluation.information))
    except np.linalg.LinAlgError:
        raise WindsysidError(
            "no spectrum of this model is positive: expected loads, noise and priors of the size of the record's; "
            "check units and the turbine file"
        ) from None
    doubts, scores = judge_bands(question, posed, fit, wide)
    mean, spread = wide.model.prior
    off = (found.point - mean) / spread
    return SpectralEstimate(
        found.point, cov, wide.model.unknowns, -(found.value - 0.5 * float(off @ off)), posed.model.statistics,
        tuple(doubts), _notes(posed, found.point, cov, wide.model.unknowns.of("lag").start),
        find_held(one_by_one(lambda u: -wide.model.likelihood(u)[0]), found.point, cov, question.parameters),
        _spectra(posed, wide.model, found.point, cov), scores,
    )  # fmt: skip


def _with_discrepancy(question: RotorQuestion, cov: Array) -> Array:
    """Covariance of the unknowns with the discrepancy between a bending blade and an equivalent hinge: an error of the
    stiffness that all blades share (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001,
    https://doi.org/10.1111/1467-9868.00294)."""
    blades = {freedom.name for freedom in question.turbine.model.freedoms if freedom.blade}
    springs = [i for i, q in enumerate(question.parameters) if q.logarithmic and q.part in blades]
    wide = cov.copy()
    wide[np.ix_(springs, springs)] += BLADE_STIFFNESS_DISCREPANCY**2
    return wide


def _spectra(posed: PosedBands, model: BandModel, unknowns: Array, cov: Array) -> tuple[FittedSpectrum, ...]:
    """Spectra of the rows of all bands, those of one combination of channels together."""
    found: dict[str, list[FittedSpectrum]] = {}
    for band, at in zip(model.bands, model.places(), strict=True):
        combined = [posed.combined[row.combination] for row in band.rows]
        labels = [(one.label, one.turns) for one in combined]
        for one in spectra_of_model(band.model, unknowns[at], cov[np.ix_(at, at)], labels):
            found.setdefault(one.channel, []).append(one)
    return tuple(joined_spectrum(parts) for parts in found.values())


def _notes(posed: PosedBands, unknowns: Array, cov: Array, lag: int) -> tuple[Finding, ...]:
    """Mean lag angle, loads, and where the modes were read."""
    hz = posed.spectra.rotor_hz
    modes = {p.name: p.frequency - (p.shape or 0) * hz for p in posed.places}
    return (
        Finding("lag_angle", "note", {"angle": unknowns[lag], "std": math.sqrt(cov[lag, lag])}),
        Finding("loads_in_bands", "note"),
        Finding("damping_is_total", "note"),
        Finding("bands_read", "note", {"modes": modes}),
    )
