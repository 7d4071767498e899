"""Likelihoods of parts of a record that have coefficients of their own: its halves, and classes of its blades.

Levels of loads are those of each part. Scores at the common mode do not show a resonance that has moved by more than
its width, and refits of short parts stay at the common summit; so the stiffness is varied over the whole band.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    MIN_RIVAL_PROBABILITY,
    NEGLIGIBLE_SHARE,
    PRIOR_ODDS_OF_MISFIT,
)
from windsysid.checks.widening import mixture_factor
from windsysid.results.finding import Finding
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.scoring import SpectralMode, find_in_stages
from windsysid.spectral.rotor_bands.build import PosedBands
from windsysid.spectral.rotor_bands.channels import Row
from windsysid.spectral.rotor_bands.mode_locations import ModeLocation
from windsysid.spectral.rotor_bands.model import COMPARISON_TOLERANCE, BandModel, RotorBand, RotorBandFit
from windsysid.statespace.parameter import Parameter

__all__ = ["doubt_classes", "doubt_halves", "rival_in_bands"]

STIFFNESS_STEP = 0.01
"""Setting: step between the factors on the blades' stiffness that are tried, in the logarithm."""

CLASS_FREEDOM = 2.0
"""Setting: unknowns that a single resonance informs, its frequency and its damping."""


def doubt_halves(halves: Sequence[BandModel], found: RotorBandFit, parameters: Sequence[Parameter]) -> list[Finding]:
    """Return a rival explanation for the stiffness of all blades, and for each of the support, if it may differ between
    the halves of a record: the value of the half that is farther from the fit, and the posterior probability of two
    values instead of one. The likelihood is integrated over a grid, as that of a short half has several summits."""
    std, doubts = np.sqrt(np.diag(np.linalg.inv(found.mode.evaluation.information))), list[Finding]()
    starts = [_with_own_levels(half, found, std) for half in halves]
    of_blades = _springs(halves[0].bands[0].model, parameters)
    springs = [of_blades, *([i] for i, q in enumerate(parameters) if q.kind == "stiffness" and i not in of_blades)]
    for which in filter(None, springs):
        steps, values = _profiles(halves, starts, which, blades=which == of_blades)
        far, chance = _of_two_values(steps, values)
        if mixture_factor([(far / std[which[0]], 1.0, chance)]) > 1.0 + NEGLIGIBLE_SHARE:
            names = tuple(parameters[i].name for i in which)
            data = {"change": far, "chance": chance, "shifts": dict.fromkeys(names, far)}
            doubts.append(Finding("halves_disagree_in_bands", "reason", data, names))
    return doubts


def _of_two_values(steps: Array, values: Array) -> tuple[float, float]:
    """The mean step that is farther from 0, and the probability of two values instead of one, by steps (S,) and −ln of
    the posterior (2, S) of either half; in logarithms, as no step may be possible in both halves."""
    from scipy.special import expit, logsumexp, softmax

    means = softmax(-values, axis=1) @ steps
    log_ratio = logsumexp(-values, axis=1).sum() - logsumexp(-values.sum(axis=0)) - math.log(len(steps))
    return means[int(np.argmax(np.abs(means)))], float(expit(math.log(PRIOR_ODDS_OF_MISFIT) + log_ratio))


def _with_own_levels(half: BandModel, found: RotorBandFit, std: Array) -> Array:
    """Unknowns (n,) of a half with the coefficients of the fit, with their standard deviations, and levels of its
    own."""
    start, (mean, spread), theta = half.start_from(found.mode.point, found.model), half.prior, half.unknowns
    known = mean.copy(), spread.copy()
    known[0][theta.but("statistics")] = start[theta.but("statistics")]
    known[1][theta.but("statistics")] = std[found.model.unknowns.but("statistics")]
    return _search(half, start, known).point


def _profiles(
    halves: Sequence[BandModel], starts: Sequence[Array], which: Sequence[int], *, blades: bool
) -> tuple[Array, Array]:
    """Steps (S,) of the logarithm of stiffness, half a bin in frequency each, and −ln of the posterior (2, S) of either
    half: of the blades in their band, of the support, whose roll moves the blades, in all bands."""
    of = slice(0, 1) if blades else slice(None)
    band = halves[0].bands[of][-1]
    width = float(np.ptp(band.model.base) / band.model.base.mean()) / len(band.model.data)
    count = int(_reach(band.rows[0]) / width)
    steps, along = np.arange(-count, count + 1.0) * width, np.isin(np.arange(len(starts[0])), which)
    each = [[_misfit(half, of, at + step * along) for step in steps] for half, at in zip(halves, starts, strict=True)]
    return np.asarray(steps), np.array(each, dtype=np.float64)


def _misfit(model: BandModel, bands: slice, at: Array) -> float:
    """−ln of the posterior of the unknowns (n,), of some of the bands."""
    parts, (mean, spread) = zip(model.bands[bands], model.places()[bands], strict=True), model.prior
    off = (at - mean) / spread
    return sum(band.model.likelihood(at[own], slopes=False).value for band, own in parts) + 0.5 * float(off @ off)


def _springs(model: LiftedModel, parameters: Sequence[Parameter]) -> list[int]:
    """Indices of the blades' stiffness."""
    blades = {row.name for row in model.freedoms if row.blade}
    return [i for i, q in enumerate(parameters) if q.kind == "stiffness" and q.part in blades]


def _reach(row: Row) -> float:
    """Change of the logarithm of stiffness that moves a mode by half the band, as f² goes with stiffness."""
    return math.log(row.high / row.low)


def rival_in_bands(code: str, step: Array, std: Array, parameters: Sequence[Parameter]) -> Finding:
    """A reason with the step of the coefficients (n,) as a rival explanation; it names the longest of those that are
    logarithmic, over its standard deviation."""
    worst = max((i for i, q in enumerate(parameters) if q.logarithmic), key=lambda i: float(abs(step[i]) / std[i]))
    shifts = dict(zip((q.name for q in parameters), step.tolist(), strict=True))
    data = {"change": step[worst], "shifts": shifts, "chance": MIN_RIVAL_PROBABILITY}
    return Finding(code, "reason", data, (parameters[worst].name,))


def doubt_classes(posed: PosedBands, found: SpectralMode, parameters: Sequence[Parameter]) -> list[Finding]:
    """Return a reason if blades that vibrate together, or whirl, give another stiffness than all readings: that of the
    class that differs most. A mode at a frequency that the file cannot give changes little in the shape of a band."""
    from scipy.special import chdtrc

    band, where = posed.model.bands[0], posed.model.places()[0]
    which = _springs(band.model, parameters)
    worst, doubts = FALSE_ALARM_PROBABILITY, list[Finding]()
    for i, place in _rows_of_classes(posed) if which else ():
        change, ratio = _shift(BandModel((_only(band, i),)), found, where, which)
        chance = np.count_nonzero(~band.model.left_out[:, i]) * float(chdtrc(CLASS_FREEDOM, max(ratio, 0.0)))
        if chance < worst:
            names = tuple(parameters[j].name for j in which)
            data = {"change": change, "modes": [place.name]}
            worst, doubts = chance, [Finding("class_disagrees_in_bands", "reason", data, names)]
    return doubts


def _rows_of_classes(posed: PosedBands) -> list[tuple[int, ModeLocation]]:
    """Rows of the blades' band that show one class, and its mode."""
    shapes = [posed.combined[row.combination].shape for row in posed.model.bands[0].rows]
    places = {place.shape: place for place in posed.places if place.shape is not None}
    return [(i, places[shape]) for i, shape in enumerate(shapes) if shape in places]


def _shift(
    alone: BandModel, found: SpectralMode, places: NDArray[np.intp], which: Sequence[int]
) -> tuple[float, float]:
    """Change of the stiffness in the logarithm if one row alone determines it, and the likelihood ratio."""
    (band,), (mean, spread) = alone.bands, alone.prior
    theta, levels = alone.unknowns.but("statistics"), alone.unknowns.of("statistics")
    std = np.sqrt(np.diag(np.linalg.inv(found.evaluation.information)))[places]
    known = mean.copy(), spread.copy()
    known[0][theta], known[1][theta] = found.point[places][theta], std[theta]
    whole = _search(alone, found.point[places], known)

    def value(at: Array) -> float:
        off = (at[levels] - mean[levels]) / spread[levels]
        return band.model.likelihood(at, slopes=False).value + 0.5 * float(off @ off)

    row = band.rows[int(np.flatnonzero(~band.model.left_out.all(axis=0))[0])]
    count = int(_reach(row) / STIFFNESS_STEP)
    points = {}
    for step in range(-count, count + 1):
        points[step] = whole.point.copy()
        points[step][which] += step * STIFFNESS_STEP
    best = min(points, key=lambda step: value(points[step]))
    if best == 0:
        return 0.0, 0.0
    at = points[best]
    other = _search(alone, at, (mean, spread)).point
    change = float(np.mean(other[which] - whole.point[which]))
    return change, 2.0 * (value(whole.point) - value(other))


def _only(band: RotorBand, row: int) -> RotorBand:
    """The band with one row, without what the taper adds, which is known only where the resonances are."""
    model: LiftedModel = band.model
    others = np.arange(model.left_out.shape[1]) != row
    out = model.left_out | others
    grid = model.place if model.window is not None else model.place._replace(left_out=model.place.left_out | others)
    data = np.where(out[:, :, None], 0.0, model.data)
    return band._replace(model=model._replace(data=data, place=grid, left_out=out, smear=None))


def _search(model: BandModel, start: Array, prior: tuple[Array, Array]) -> SpectralMode:
    return find_in_stages(model.likelihood, start, prior, ((1.0, 1),), tolerance=COMPARISON_TOLERANCE)
