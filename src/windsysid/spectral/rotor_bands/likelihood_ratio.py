"""Likelihood ratios of parts of a record that have coefficients of their own: its halves, and classes of its blades.

Levels of loads are those of each part under both hypotheses. Refits of short parts are far from quadratic, so that a
difference of estimates is longer than its Fisher covariance lets expect; the ratio of likelihoods is not. Scores at the
common mode do not show a resonance that has moved by more than its width, and refits do.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MIN_RIVAL_PROBABILITY
from windsysid.results.finding import Finding
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.scoring import SpectralMode, find_in_stages
from windsysid.spectral.rotor_bands.build import PosedBands
from windsysid.spectral.rotor_bands.mode_locations import ModeLocation
from windsysid.spectral.rotor_bands.model import COMPARISON_TOLERANCE, BandModel, RotorBand, RotorBandFit
from windsysid.statespace.parameter import Parameter

__all__ = ["doubt_classes", "doubt_halves", "rival_in_bands"]

STIFFNESS_STEP = 0.01
"""Setting: step between the factors on the blades' stiffness that are tried, in the logarithm."""

CLASS_FREEDOM = 2.0
"""Setting: unknowns that a single resonance informs, its frequency and its damping."""


def doubt_halves(halves: Sequence[BandModel], found: RotorBandFit, parameters: Sequence[Parameter]) -> list[Finding]:
    """Return a reason if the halves of a record have other coefficients than all of it, with the farther shift of each
    coefficient as a rival explanation.

    The halves share the prior's information. The ratio is a sum of χ² of one degree of freedom each, weighted by the
    data's share of the information, and is approximated by its first two moments (Satterthwaite).
    """
    from scipy.special import chdtrc

    starts = [half.start_from(found.mode.unknowns, found.model) for half in halves]
    joint, known = BandModel(tuple(band for half in halves for band in half.bands)), halves[0].unknowns
    at, shared = np.zeros(joint.unknowns.size), known.but("statistics")
    at[joint.unknowns.but("statistics")] = starts[0][shared]
    at[joint.unknowns.of("statistics")] = np.concatenate([start[known.of("statistics")] for start in starts])
    same, ratio, steps = _search(joint, at, joint.prior), 0.0, []
    cov, scatter = np.zeros((2, len(shared), len(shared)))
    for half, start in zip(halves, starts, strict=True):
        mean, spread = half.prior
        spread[shared] *= math.sqrt(len(halves))
        own = _search(half, start, (mean, spread))
        C = np.linalg.inv(own.information)
        ratio -= 2.0 * own.value
        steps.append(own.unknowns[: len(parameters)] - found.mode.unknowns[: len(parameters)])
        cov += C[np.ix_(shared, shared)]
        scatter += (C - C @ np.diag(spread**-2.0) @ C)[np.ix_(shared, shared)]
    weights = np.linalg.solve(cov, scatter)
    first, second = float(np.trace(weights)), float(np.trace(weights @ weights))
    if chdtrc(first**2 / second, max(ratio + 2.0 * same.value, 0.0) * first / second) > FALSE_ALARM_PROBABILITY:
        return []
    away = np.where(np.abs(steps[0]) > np.abs(steps[1]), *steps)
    return [rival_in_bands("halves_disagree_in_bands", away, np.sqrt(np.diag(cov)), parameters)]


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
    blades = {row.name for row in band.model.freedoms if row.blade}
    which = [i for i, q in enumerate(parameters) if q.kind == "stiffness" and q.part in blades]
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
    std = np.sqrt(np.diag(np.linalg.inv(found.information)))[places]
    known = mean.copy(), spread.copy()
    known[0][theta], known[1][theta] = found.unknowns[places][theta], std[theta]
    whole = _search(alone, found.unknowns[places], known)

    def value(at: Array) -> float:
        off = (at[levels] - mean[levels]) / spread[levels]
        return band.model.likelihood(at, slopes=False).value + 0.5 * float(off @ off)

    row = band.rows[int(np.flatnonzero(~band.model.left_out.all(axis=0))[0])]
    count = int(math.log(row.high / row.low) / STIFFNESS_STEP)  # half the band, as f² goes with stiffness
    values = {}
    for step in range(-count, count + 1):
        at = whole.unknowns.copy()
        at[which] += step * STIFFNESS_STEP
        values[step] = value(at)
    best = min(values, key=values.__getitem__)
    if best == 0:
        return 0.0, 0.0
    at = whole.unknowns.copy()
    at[which] += best * STIFFNESS_STEP
    other = _search(alone, at, (mean, spread)).unknowns
    change = float(np.mean(other[which] - whole.unknowns[which]))
    return change, 2.0 * (value(whole.unknowns) - value(other))


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
