"""Scores of narrow bands over frequencies, and of the halves of a record, which widen the intervals of a rotor.

The log-likelihood is a sum over bins, and each half of the record has one of its own. Their gradients at the mode of
the posterior scatter as their Fisher information says where the model is true (`windsysid.checks.dispersion`). A load
that changes, stiffness that does, a spectrum of another shape and a mode that the model lacks raise the scatter for the
quantities that they affect.
"""

from collections.abc import Sequence

import numpy as np

from windsysid.checks.dispersion import PartScores
from windsysid.spectral.rotor_bands.model import BandModel, RotorBandFit

__all__ = ["scores_of_bands"]


def scores_of_bands(fit: RotorBandFit, halves: Sequence[BandModel], duration: float) -> tuple[PartScores, ...]:
    """Scores over the frequencies of a fit, and over the halves of its record of a duration [s] if there are any.

    Raises
    ------
    LinAlgError
        If a spectrum is not positive definite.
    """
    at, (mean, spread) = fit.mode.unknowns, fit.model.prior
    precision = np.diag(spread**-2.0)
    places, gradients, information = fit.model.scores(at)
    whole = PartScores("frequency", places, gradients, information, precision, precision @ (mean - at))
    if not halves:
        return (whole,)
    models = [half.with_inexact(fit.model.bands[0].model.inexact) for half in halves]
    parts = [model.likelihood(model.start_from(at, fit.model)) for model in models]
    times = (np.arange(len(parts)) + 0.5) * duration / len(parts)
    _, slopes, curvatures = (np.array(each) for each in zip(*parts, strict=True))
    return whole, whole._replace(over="time", places=times, gradients=-slopes, information=curvatures)
