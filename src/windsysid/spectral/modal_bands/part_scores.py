"""Scores of the parts of a band, over frequencies and over time, which widen the intervals of its modes.

A band's log-likelihood is a sum over its frequencies, and each segment of the record has one of its own. Where the
model is true, the scores of parts scatter as their Fisher information says (`windsysid.checks.dispersion`). Loads that
change during the record, a frequency that varies with the temperature, and a load spectrum or a skirt that the model
lacks raise the scatter for the quantities that they affect.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.dispersion import PartScores, expected_factor, log_density_ratio
from windsysid.checks.limits import PRIOR_ODDS_OF_MISFIT
from windsysid.spectral.modal_bands.model import row_scores, scores
from windsysid.spectral.modal_bands.model_order import BandFit
from windsysid.spectral.modal_bands.scoring import prior_slopes
from windsysid.spectral.transforms.dft import Band, band_data
from windsysid.spectral.transforms.limits import MIN_BAND_BINS

__all__ = ["SEGMENTS", "BandWidening", "Segments", "part_scores", "wander_ratio", "widening_of"]

SEGMENTS = (8, 4, 2)
"""Setting: numbers of segments of a record; the first whose segments have enough bins in a band is used."""

Segments = Sequence[Sequence[tuple[Array, Complex]]]
"""Frequencies (F,) [Hz] and transforms (F, n) of the segments of a record, for each of `SEGMENTS`."""


class BandWidening(NamedTuple):
    """Factor on a standard deviation, the axis along which most of it was found, and where [s] or [Hz]."""

    factor: float = 1.0
    over: str = ""
    place: float = 0.0

    @property
    def cause(self) -> str:
        """Cause of the widening, as a clause."""
        if self.over == "time":
            return f"segments of the record contradict each other, most around {self.place:.4g} s"
        if self.over == "level":
            return "the level of its load varies"
        return f"the spectrum differs from that of the model, most around {self.place:.4g} Hz"


def part_scores(found: BandFit, segments: Segments, samples: int, rate: float) -> list[PartScores]:
    """Compute the scores of a band over its frequencies, and over segments of the record if these have enough bins."""
    modes, band = found.fit.modes, found.band
    pull, precision = prior_slopes(modes)
    gradient, fisher = row_scores(modes, band)
    whole = PartScores(
        "frequency", band.frequency, -gradient / band.factor, fisher / band.factor, np.diag(precision), -pull
    )
    parts = _segments_in(found, segments, samples, rate)
    if not parts:
        return [whole]
    each = [scores(modes, part) for part in parts]
    return [
        whole,
        whole._replace(
            over="time",
            places=(np.arange(len(parts)) + 0.5) * samples / rate / len(parts),
            gradients=np.array([-one.gradient / part.factor for one, part in zip(each, parts, strict=True)]),
            information=np.array([one.fisher / part.factor for one, part in zip(each, parts, strict=True)]),
        ),
    ]


def widening_of(parts: Sequence[PartScores], at: int) -> BandWidening:
    """Widening of the interval of one unknown of a band: the larger one over time and over frequencies."""
    found = BandWidening()
    quantity = np.eye(1, len(parts[0].pull), at)[0]
    for one in parts:
        seen = one.dispersion(quantity)
        factor = 1.0 if seen is None else float(np.sqrt(expected_factor(seen)))
        if seen is not None and factor > found.factor:
            found = BandWidening(factor, one.over, seen.place)
    return found


def wander_ratio(parts: Sequence[PartScores], at: int) -> float:
    """Density of the scatter of one unknown of a band over time if it wanders, as the frequency of a machine does, over
    that of a mode's, of which few do."""
    over_time = [one.dispersion(np.eye(1, len(one.pull), at)[0]) for one in parts if one.over == "time"]
    chance = PRIOR_ODDS_OF_MISFIT / (1.0 + PRIOR_ODDS_OF_MISFIT)
    return math.prod(1.0 / (chance + (1.0 - chance) * math.exp(-log_density_ratio(one))) for one in over_time if one)


def _segments_in(found: BandFit, segments: Segments, samples: int, rate: float) -> list[Band]:
    """Data of the segments in a band, for the largest number of segments with enough bins."""
    back = np.linalg.pinv(found.directions)
    for parts in segments:
        bins = _bins_in(found, len(parts), parts[0][0])
        if len(bins) >= MIN_BAND_BINS:
            return [band_data(values[bins] @ back.T, bins, samples // len(parts), rate) for _, values in parts]
    return []


def _bins_in(found: BandFit, count: int, frequency: Array) -> NDArray[np.int64]:
    """Bins of one of `count` segments in a band, without those where most bins of the record are left out."""
    number = np.arange(len(frequency))
    used = np.bincount(np.round(found.bins / count).astype(int), minlength=len(number))[: len(number)]
    inside = (number * count >= found.bins[0]) & (number * count <= found.bins[-1])
    return np.flatnonzero(inside & (2 * used > count))
