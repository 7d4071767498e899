"""Goodness of fit of narrow bands.

Levels of loads are learned, so that the size of a whole band says nothing. What can be wrong is its shape (parts of
each row), its steadiness (energy of the halves), and the coefficients: each half of the record must give the same, and
so must bands of two thirds of the width, which hold less of what the model may not have. Two estimates from the same
data of which one uses less differ by the difference of their covariances (Hausman, Econometrica 46, 1978,
https://doi.org/10.2307/1913827). One that differs by more is a rival explanation.
"""

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.errors import RecordError
from windsysid.results.finding import Finding
from windsysid.spectral.rotor.check import RangePower, misshapen, parts_of, unexplained, unsteady
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.spectral.rotor_bands.build import PosedBands, pose_bands
from windsysid.spectral.rotor_bands.likelihood_ratio import doubt_classes, doubt_halves, rival_in_bands
from windsysid.spectral.rotor_bands.limits import MIN_BLADES_FREEDOM, MIN_SUPPORT_FREEDOM
from windsysid.spectral.rotor_bands.model import BandModel, RotorBandFit
from windsysid.spectral.transforms.rotating_frame import combine_groups
from windsysid.statespace.parameter import Parameter

__all__ = ["judge_bands"]

PART_COUNTS = (3, 8)
"""Setting: numbers of parts of a band: wide ones show a wrong level, narrow ones a resonance at another place."""

NARROW_SHARE, MAX_REMAINING_SHARE = 0.65, 0.1
"""Setting: width of the narrower bands over that of the bands, and remaining share of a covariance if they contain as
much, since levels at the ends of a band are estimated anew. A step of less than a standard deviation is no finding."""


def judge_bands(
    question: RotorQuestion, posed: PosedBands, fit: RotorBandFit, wide: RotorBandFit
) -> tuple[list[Finding], tuple[PartScores, ...]]:
    """Reasons against a result, and the scores of parts of the record at the fit with tolerances (`wide`)."""
    posed, found = posed._replace(model=fit.model), fit.mode
    doubts = [*posed.doubts, *_short(posed)]
    if not (found.converged and wide.mode.converged):
        doubts.append(Finding("search_not_converged", "reason", {"steps": found.steps}))
    thirds, eighths = zip(*_parts(posed, found.point), strict=True)
    doubts += (unexplained(chain.from_iterable(thirds)) or misshapen(eighths, FALSE_ALARM_PROBABILITY))[:3]
    try:
        halves = _halves(question, posed, fit)
        narrow = pose_bands(question, posed.places, posed.spectra, width=NARROW_SHARE).model
    except RecordError:
        return [*doubts, Finding("too_short_for_stationarity", "reason")], ()
    if len(halves) < 2:
        return [*doubts, Finding("one_block", "reason")], ()
    doubts += unsteady(*(_energies(posed, piece, found.point) for piece in halves))[:2]
    models = [half.model for half in halves]
    try:
        doubts += doubt_classes(posed, found, question.parameters)
        doubts += doubt_halves(models, fit, question.parameters)
        doubts += _narrower(narrow, fit, question.parameters)
        return doubts, _scores(wide, models, posed.spectra.duration)
    except np.linalg.LinAlgError:
        return [*doubts, Finding("segments_without_spectrum", "reason")], ()


def _halves(question: RotorQuestion, posed: PosedBands, fit: RotorBandFit) -> list[PosedBands]:
    """The problem of either half of the record, as it is at a fit; of one block none."""
    if question.turned is not None:
        read = [combine_groups(question.turned, groups) for groups in question.turned.halves() or ()]
        halves = [pose_bands(question, posed.places, half) for half in read]
    else:
        halves = [pose_bands(half, posed.places) for half in question.halves]
    starts = [half.model.start_from(fit.mode.point, fit.model) for half in halves]
    return [half._replace(model=half.model.smeared_at(at)) for half, at in zip(halves, starts, strict=True)]


def _scores(wide: RotorBandFit, halves: Sequence[BandModel], duration: float) -> tuple[PartScores, ...]:
    """Scores over frequencies, and over the halves of a record of a duration [s]."""
    at, (mean, spread) = wide.mode.point, wide.model.prior
    precision = np.diag(spread**-2.0)
    whole = PartScores("frequency", *wide.model.scores(at), precision, precision @ (mean - at))
    models = [half.with_inexact(wide.model.bands[0].model.inexact) for half in halves]
    parts = [model.likelihood(model.start_from(at, wide.model)) for model in models]
    _, slopes, information = (np.array(each) for each in zip(*parts, strict=True))
    places = (np.arange(len(parts)) + 0.5) * duration / len(parts)
    return whole, whole._replace(over="time", places=places, gradients=-slopes, information=information)


def _narrower(narrow: BandModel, fit: RotorBandFit, parameters: Sequence[Parameter]) -> list[Finding]:
    """Test whether narrower bands give another stiffness than the bands."""
    from scipy.special import chdtri

    again, n = narrow.fit(narrow.start_from(fit.mode.point, fit.model)).mode, len(parameters)
    step, which = again.point[:n] - fit.mode.point[:n], [i for i, q in enumerate(parameters) if q.logarithmic]
    known, less = (np.linalg.inv(one.evaluation.information)[:n, :n] for one in (fit.mode, again))
    std = np.sqrt(np.diag(known).clip(1e-300))
    values, vectors = np.linalg.eigh((less - (1.0 - MAX_REMAINING_SHARE) * known)[np.ix_(which, which)])
    size = float(np.sum((vectors.T @ step[which]) ** 2 / np.maximum(values, 1e-3 * values.max())))
    if not np.any(np.abs(step) > std, where=np.isin(np.arange(n), which)):
        return []
    far = size > float(chdtri(len(which), FALSE_ALARM_PROBABILITY))
    return [rival_in_bands("narrower_bands_disagree", step, std, parameters)] if far else []


def _short(posed: PosedBands) -> list[Finding]:
    """Test whether resonances are narrower in the record than those whose bands were validated."""
    spectra, doubts = posed.spectra, list[Finding]()
    for of_blades, least in ((True, MIN_BLADES_FREEDOM), (False, MIN_SUPPORT_FREEDOM)):
        widths = [p.ratio * p.frequency for p in posed.places if (p.shape is not None) == of_blades]
        counts = [2.0 * np.pi * width * spectra.duration / spectra.overlap for width in widths]
        if counts and min(counts) < least:
            data = {"part": "blades" if of_blades else "support", "count": min(counts), "least": least}
            code = "narrow_resonance_in_bands" if spectra.recent is None else "narrow_resonance_in_bands_of_pieces"
            doubts.append(Finding(code, "reason", data))
    return doubts


def _parts(posed: PosedBands, unknowns: Array) -> list[tuple[list[RangePower], ...]]:
    """Mean squares of the parts of each row's band, for each number of `PART_COUNTS`."""
    found = []
    for (band, _, rows), place in zip(posed.model.bands, posed.model.places(), strict=True):
        S = np.einsum("bii->bi", band.spectrum(unknowns[place]).spectrum).real
        power = _power(band)
        f = band.base
        for i, row in enumerate(rows):
            label, overlap = posed.combined[row.combination].label, band.overlap / band.blocks
            edges = [np.linspace(row.low, row.high * 1.000001, count + 1).tolist() for count in PART_COUNTS]
            found.append(
                tuple(
                    parts_of(power[:, i], S[:, i], f, label, list(pairwise(own)), overlap, MIN_BLADES_FREEDOM)
                    for own in edges
                )
            )
    return found


def _power(band: LiftedModel) -> Array:
    """|Y|² (B, e), the mean of all blocks, NaN where nothing is said."""
    return np.where(band.left_out, np.nan, np.sum(np.abs(band.data) ** 2, axis=2) / band.blocks)


def _energies(whole: PosedBands, piece: PosedBands, unknowns: Array) -> list[RangePower]:
    """Statistics of a part of the record, with the expectation of the whole, row by row."""
    found = []
    for (of, _, _), (band, _, rows), place in zip(
        whole.model.bands, piece.model.bands, whole.model.places(), strict=True
    ):
        S = np.einsum("bii->bi", of.spectrum(unknowns[place]).spectrum).real
        for i, row in enumerate(rows):
            expected = np.interp(band.base, of.base, S[:, i])
            power = _power(band)[:, i]
            label = piece.combined[row.combination].label
            every = [(row.low, row.high * 1.000001)]
            overlap = band.overlap / band.blocks
            found += parts_of(power, expected, band.base, label, every, overlap, MIN_BLADES_FREEDOM)
    return found
