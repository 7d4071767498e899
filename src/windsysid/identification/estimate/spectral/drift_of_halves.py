"""Drifts of clocks from both halves of a record: the lags of the halves differ by half of the drift."""

import math
from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.identification.model.drift import Drift
from windsysid.spectral.rotor.model import LiftedModel

__all__ = ["drift_of_halves"]

MAX_STEPS, LAST_STEP_SIGMAS = 3, 1.0
"""Numerical: most steps of scoring to the clock of a half; one of so many standard deviations or fewer is the last."""


def drift_of_halves(
    halves: Sequence[LiftedModel], unknowns: Array, loggers: Sequence[str], apart: float
) -> list[Drift]:
    """The drifts of loggers whose clocks are unknowns of spectra, from the halves of a record whose middles are so many
    seconds apart, at the unknowns that the whole record has."""
    if not loggers:
        return []
    (early, early_std), (late, late_std) = (_clocks(half, unknowns, len(loggers)) for half in halves)
    rates, stds = (late - early) / apart, np.hypot(early_std, late_std) / apart
    told = zip(loggers, rates.tolist(), stds.tolist(), strict=True)
    return [Drift(logger, rate, std, "vibration in the record's halves") for logger, rate, std in told]


def _clocks(half: LiftedModel, unknowns: Array, count: int) -> tuple[Array, Array]:
    """Delays of the clocks (count,) [s] and their standard deviations with all others known; infinite ones of a clock
    that nothing shows."""
    at, unknowns = half.unknowns.of("clocks"), unknowns.copy()
    for _ in range(MAX_STEPS):
        said = half.likelihood(unknowns)
        information = np.diag(said.information)[at]
        shown = information > 0.0
        step = np.divide(said.gradient[at], information, out=np.zeros(count), where=shown)
        unknowns[at] -= step
        if (step**2 * information <= LAST_STEP_SIGMAS**2).all():
            break
    spread = np.abs(half.inexact.late[-count:]).max(axis=1)
    std = np.divide(spread, np.sqrt(np.abs(information)), out=np.full(count, math.inf), where=shown)
    return spread * unknowns[at], std
