"""The spectrum of linear equations and its derivatives."""

import numpy as np
import pytest

from tests.spectral.lti.conftest import AT
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.transforms.cross_spectra import CrossSpectra


def test_natural_frequencies_are_those_of_the_spring(model: LinearModel):
    parameters = {q.name: float(q.physical(u)) for q, u in zip(model.parameters, AT, strict=False)}
    expected = 0.5 * np.log(parameters["k"] / 2.0)
    assert model.natural_frequencies(AT[None])[0] == pytest.approx([expected])
    assert model.stable(AT)


def test_the_expected_gradient_vanishes_at_the_truth(model: LinearModel, exact: CrossSpectra):
    rows = model.rows(exact, AT)
    smear = model.smear(exact, rows, AT)
    _, gradient, information = model.likelihood(rows, exact.last.overlap, AT, smear)
    assert np.all(np.abs(gradient) < 0.3 * np.sqrt(np.diag(information)))
