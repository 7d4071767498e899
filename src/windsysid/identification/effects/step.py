"""A step of a reading: a sensor that was touched, a supply that changed, a range that was switched."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.identification.effects.regression import RegressorEffect
from windsysid.identification.effects.score_test import RegressorCandidate
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn
from windsysid.identification.model.regressor import StepAt, Term

__all__ = ["Step", "likeliest_change"]

INDEPENDENT_PLACES = 39.0
"""Setting: as how many independent places the samples of a record count at which a step may be."""

MARGIN_SHARE = 0.02
"""Setting: share of the record at either end in which no step is looked for."""


class Step(RegressorEffect):
    """A constant from some time on in one channel."""

    code = "step"

    def candidates(self, at: Linearisation) -> Sequence[RegressorCandidate]:
        """One candidate for each channel, where the mean of its readings changes most: a structure that vibrates has no
        mean acceleration, and the sum of its readings stays small."""
        return [
            RegressorCandidate(
                self.code,
                sensor.channel,
                (RegressorColumn(row, StepAt(float(at.time[likeliest_change(at.readings[:, row])]))),),
                places=INDEPENDENT_PLACES,
            )
            for row, sensor in enumerate(at.problem.sensors)
            if not sensor.drift
        ]

    def describe(self, terms: Sequence[Term]) -> dict[str, Any]:
        """When, and how large."""
        (one,) = terms
        return {"size": one.size, "std": one.std, "time": one.wave.time if isinstance(one.wave, StepAt) else 0.0}


def likeliest_change(values: Array) -> int:
    """The sample of a record (T,) before and after which the means differ most, by chance alike; NaN are left out."""
    there = np.isfinite(values)
    counts = np.concatenate([[0], np.cumsum(there)])
    sums = np.concatenate([[0.0], np.cumsum(np.where(there, values - np.mean(values[there]), 0.0))])
    share = counts / counts[-1]
    inside = (share > MARGIN_SHARE) & (share < 1.0 - MARGIN_SHARE)
    off = np.abs(sums) / np.sqrt(np.where(inside, share * (1.0 - share), 1.0))
    return int(np.argmax(np.where(inside, off, -1.0)))
