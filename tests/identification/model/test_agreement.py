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
    (found,) = disagreement(OUTCOME, other, TOWER, {names[0]: 2.0})
    assert found.data["sigmas"] == pytest.approx(2.0 * wide)
    assert disagreement(OUTCOME, other, TOWER, {names[0]: 4.0}) == ()


def test_a_disagreement_has_its_coefficients_and_says_whether_blades_were_left_out():
    shift = 0.01 * (MAX_DISAGREEMENT_SIGMAS + 1.0) * np.eye(len(OUTCOME.theta))[2]
    other = OUTCOME._replace(theta=OUTCOME.theta - shift)
    (found,), names = disagreement(OUTCOME, other, TOWER), [q.name for q in OUTCOME.model.parameters]
    assert (found.code, found.severity, found.quantities) == ("formulations_disagree", "reason", (names[2],))
    assert found.data["sigmas"] == pytest.approx(MAX_DISAGREEMENT_SIGMAS + 1.0)
    assert found.data["shifts"] == pytest.approx(
        {**dict.fromkeys(names, 0.0), names[2]: -0.01 * (MAX_DISAGREEMENT_SIGMAS + 1.0)}
    )
    assert not found.data["unseen_blades"]
    assert disagreement(OUTCOME, other, load_turbine("verne555"))[0].data["unseen_blades"]


def test_a_fit_that_contradicts_the_prior_and_the_record_is_no_evidence_against_one_that_does_not():
    """Filters whose fore-aft mode had come to lie at a third of its frequency condemned spectra that had it right."""
    places = {q.name: i for i, q in enumerate(OUTCOME.model.parameters)}
    off, far = np.zeros((2, len(places)))
    off[places["c_fore_aft"]], off[places["k_side_side"]] = 0.1, 0.05
    far[places["k_fore_aft"]] = -4.1 * OUTCOME.model.parameters[places["k_fore_aft"]].prior[1]
    believed, lost = (OUTCOME._replace(theta=OUTCOME.theta + shift) for shift in (off, off + far))
    wide, spectra = {"c_fore_aft": 2.1}, OUTCOME._replace(turns=False)
    assert disagreement(spectra, believed, TOWER, wide)[0].quantities == ("k_side_side",)
    (found,) = disagreement(spectra, lost, TOWER, wide)
    assert found.quantities == ("k_side_side",)
    assert set(found.data["shifts"]) == {"k_side_side", "c_side_side"}
    # the result itself contradicts its prior: what does not is evidence against it
    assert disagreement(lost._replace(turns=False), OUTCOME, TOWER, wide)[0].quantities == ("k_fore_aft",)
    both = lost._replace(theta=lost.theta + 0.1)
    assert "k_fore_aft" in disagreement(lost._replace(turns=False), both, TOWER, wide)[0].data["shifts"]
    # factors of filters say nothing of spectra
    assert disagreement(OUTCOME, lost._replace(turns=False), TOWER, wide)[0].quantities == ("k_fore_aft",)
    # a record that fits it well shows that the prior is wrong
    for factors in ({"c_fore_aft": 1.6}, {"c_side_side": 4.0}, None):
        assert disagreement(spectra, lost, TOWER, factors)[0].quantities == ("k_fore_aft",)
