"""The posterior mode from spectra that are the model's own."""

import numpy as np

from tests.spectral.lti.conftest import AT
from windsysid.spectral.lti.fit import _aligned, _stable_start, fit_linear
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.transforms.cross_spectra import CrossSpectra


def test_the_truth_is_found_where_spectra_have_no_scatter(model: LinearModel, exact: CrossSpectra):
    found = fit_linear(model, exact)
    assert found.settled
    std = np.sqrt(np.diag(found.cov))
    assert np.all(np.abs(found.unknowns - AT) < 0.5 * std)


def test_alignment_keeps_natural_frequencies_and_forgets_damping(model: LinearModel):
    mean = model.prior[0]
    found = _aligned(model, AT)
    wanted, frequency = (model.natural_frequencies(u[None])[0] for u in (AT, found))
    np.testing.assert_allclose(frequency, wanted, atol=0.01)
    assert abs(found[0] - mean[0]) < abs(AT[0] - mean[0]) + 1e-12


def test_a_stable_centre_is_the_start(model: LinearModel):
    np.testing.assert_array_equal(_stable_start(model), model.prior[0])
