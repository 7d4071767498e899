"""What filters say of a spectral result, and of which frequencies."""

import numpy as np
import pytest

from tests.identification.fits import fitted, noise, record_of
from windsysid.checks.dispersion import PartScores
from windsysid.identification.automatic_choice import _with_scores_of
from windsysid.identification.verdict.grading import widen_coefficients
from windsysid.results.estimate import FittedSpectrum

RECORD = record_of(noise())


def test_innovations_beyond_the_frequencies_of_spectra_do_not_widen_their_intervals():
    """Blades' modes at 0.86 Hz, which no load of filters explains, made the intervals of a tower at 0.17 Hz 9 times as
    wide: grade C."""
    n, places = 4, np.array([0.13, 0.15, 0.17, 0.19, 0.86, 0.9])
    gradients = np.array([1.0, -1.0, 1.0, -1.0, 40.0, -40.0])[:, None] * np.ones(n)
    scores = PartScores("frequency", places, gradients, np.tile(np.eye(n), (6, 1, 1)), 0.01 * np.eye(n), np.zeros(n))
    time = scores._replace(over="time", places=np.arange(6.0), gradients=gradients / 40.0)
    joint = fitted(RECORD, "joint", scores=(scores, time))
    f = np.linspace(0.12, 0.28, 20)
    spectral = fitted(RECORD, spectra=(FittedSpectrum("tower_x_acceleration", False, f, f, f),))

    def factor(fit):
        parameters = fit.outcome.model.parameters
        return widen_coefficients(fit.outcome.scores, parameters, fit.outcome.cov)[0].factor

    assert factor(joint) > 5.0
    found = _with_scores_of(joint, spectral)
    assert factor(found) == pytest.approx(1.0, abs=0.1)
    assert found.outcome.scores[1] is time
    assert len(found.outcome.scores[0].places) == 4
    assert len(_with_scores_of(joint, fitted(RECORD)).outcome.scores[0].places) == 6
