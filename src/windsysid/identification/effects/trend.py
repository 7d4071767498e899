"""Slow trends of a reading: temperature, settling of a filter, a turn of a mounting."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from windsysid.identification.effects.regression import RegressorEffect
from windsysid.identification.effects.score_test import RegressorCandidate
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn
from windsysid.identification.model.regressor import Legendre, Term

__all__ = ["Trend"]

MAX_POLYNOMIAL_ORDER = 4
"""Setting: Legendre polynomials up to this order: up to two turns of a trend over the record."""


class Trend(RegressorEffect):
    """A polynomial over the record in one channel."""

    code = "trend"

    def candidates(self, at: Linearisation) -> Sequence[RegressorCandidate]:
        """One candidate for each channel whose sensor has no random walk."""
        first, last = float(at.time[0]), float(at.time[-1])
        waves = [Legendre(order, first, last) for order in range(1, MAX_POLYNOMIAL_ORDER + 1)]
        return [
            RegressorCandidate(self.code, sensor.channel, tuple(RegressorColumn(row, wave) for wave in waves))
            for row, sensor in enumerate(at.problem.sensors)
            if not sensor.drift
        ]

    def describe(self, terms: Sequence[Term]) -> dict[str, Any]:
        """The size of the trend: its root mean square."""
        size = float(np.sqrt(sum(one.size**2 / (2 * order + 1) for order, one in enumerate(terms, start=1))))
        return {"size": size}
