"""The mode of a tower's posterior: no slope is left, and evidence is Laplace's."""

import numpy as np
import pytest

from windsysid.identification.model.tolerances import in_numbers, tolerances_of
from windsysid.mechanics.compile import compile_model
from windsysid.spectral.rotor.fit import RotorFit, admit, fit
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.turbine.file import load_turbine


@pytest.fixture(scope="module")
def found(posed: Posed) -> RotorFit:
    return fit(posed.model, posed.start, smoothed=posed.smoothed, enough=1e-8)


def test_no_slope_of_the_log_posterior_is_left_at_the_mode(found: RotorFit):
    mean, std = found.model.prior
    gradient = found.model.likelihood(found.unknowns).gradient + (found.unknowns - mean) / std**2
    assert found.settled
    assert np.all(np.abs(gradient) * np.sqrt(np.diag(found.cov)) < 1e-2)


def test_covariance_and_evidence_are_laplaces(found: RotorFit):
    mean, std = found.model.prior
    information = found.model.likelihood(found.unknowns).information + np.diag(std**-2.0)
    np.testing.assert_allclose(found.cov @ information, np.eye(len(std)), atol=1e-2)
    off = (found.unknowns - mean) / std
    sizes = np.sum(np.log(std)) + 0.5 * np.linalg.slogdet(information)[1]
    assert found.log_evidence == pytest.approx(found.log_likelihood - 0.5 * off @ off - sizes, abs=1e-2)
    doubled = found.log_evidence - 0.5 * found.log_likelihood
    assert found.evidence_at(2.0 * found.model.overlap) == pytest.approx(doubled)


def test_a_tolerance_of_mass_widens_a_stiffness_by_as_much(found: RotorFit, question: RotorQuestion):
    turbine = load_turbine("tower")
    names = [q.name for q in question.parameters]
    tolerances = tolerances_of(turbine, turbine.sensors, names)
    compiled = compile_model(turbine.model, turbine.sensors, instruments=True)
    inexact = in_numbers(tolerances, compiled.parameters, turbine, turbine.sensors, names)
    given = np.array([turbine.values.get(name, 0.0) for name in compiled.parameters])
    known = found._replace(model=found.model._replace(compiled=compiled, given=given))
    wide = admit(known, inexact)
    i, mass = names.index("k_side_side"), turbine.mass_tolerance
    assert len(wide.unknowns) == len(found.unknowns) + len(tolerances)
    assert wide.cov[i, i] == pytest.approx(found.cov[i, i] + mass**2, rel=0.1)
