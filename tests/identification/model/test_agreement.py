"""Two fits of one record compared coefficient by coefficient."""

import numpy as np
import pytest

from tests.identification.fits import TOWER, noise, outcome_of, record_of
from windsysid.checks.limits import MAX_DISAGREEMENT_SIGMAS
from windsysid.identification.model.agreement import compare, disagreement
from windsysid.turbine.file import load_turbine

OUTCOME = outcome_of(record_of(noise()), std=0.01)


def test_the_largest_difference_is_in_the_larger_standard_deviation():
    shift = np.array([0.02, -0.05, 0.0, 0.0])[: len(OUTCOME.theta)]
    other = OUTCOME._replace(theta=OUTCOME.theta + shift, cov=4.0 * OUTCOME.cov)
    for found in (compare(OUTCOME, other), compare(other, OUTCOME)):
        assert found[0] == OUTCOME.model.parameters[1].name
        assert found[1] == pytest.approx(0.05 / 0.02)
    assert compare(OUTCOME, OUTCOME)[1] == 0.0


def test_a_difference_counts_in_intervals_as_wide_as_their_factors_make_them():
    """Filters whose own frequencies contradict each other condemned spectra of OpenFAST's turbines that were right."""
    names = [q.name for q in OUTCOME.model.parameters]
    other = OUTCOME._replace(theta=OUTCOME.theta + 0.1 * (np.arange(len(names)) == 0))
    (name, plain), (_, wide) = compare(OUTCOME, other), compare(OUTCOME, other, {names[0]: 4.0})
    assert name == names[0]
    assert wide == pytest.approx(plain / 4.0)
    assert disagreement(OUTCOME, other, TOWER, {names[0]: 4.0}).data["sigmas"] == wide


def test_a_disagreement_has_its_coefficients_and_says_whether_blades_were_left_out():
    shift = 0.01 * (MAX_DISAGREEMENT_SIGMAS + 1.0) * np.eye(len(OUTCOME.theta))[2]
    other = OUTCOME._replace(theta=OUTCOME.theta - shift)
    found, names = disagreement(OUTCOME, other, TOWER), [q.name for q in OUTCOME.model.parameters]
    assert (found.code, found.severity, found.quantities) == ("formulations_disagree", "reason", (names[2],))
    assert found.data["sigmas"] == pytest.approx(MAX_DISAGREEMENT_SIGMAS + 1.0)
    assert found.data["shifts"] == pytest.approx(
        {**dict.fromkeys(names, 0.0), names[2]: -0.01 * (MAX_DISAGREEMENT_SIGMAS + 1.0)}
    )
    assert not found.data["unseen_blades"]
    assert disagreement(OUTCOME, other, load_turbine("verne555")).data["unseen_blades"]
