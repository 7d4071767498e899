"""The posterior of a band's modes where data are the model's own spectrum."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.scoring import evidence, score, score_together, slopes
from windsysid.spectral.transforms.dft import Band


def moved(modes: Modes) -> Modes:
    return modes._replace(frequency=1.01 * modes.frequency, damping=1.5 * modes.damping, shape=0.8 * modes.shape)


def test_the_mode_is_found_from_nearby(one_mode: Modes, exact_band: Band):
    found = score(moved(one_mode), exact_band)
    assert found.converged
    std = found.std(0)
    assert abs(np.log(found.modes.frequency[0] / 1.0)) < 0.1 * std[0]
    assert abs(np.log(found.modes.damping[0] / 0.01)) < 0.1 * std[1]


def test_the_covariance_is_the_inverse_of_the_information_of_differences(one_mode: Modes, exact_band: Band):
    found = score(one_mode, exact_band)
    information, weight = slopes(found.modes, exact_band)
    np.testing.assert_allclose(found.cov @ information.fisher, np.eye(len(found.cov)), atol=1e-6)
    assert len(weight) == 3  # of ln ζ and of both slopes


def test_two_records_of_one_structure_halve_the_variance_of_what_they_share(one_mode: Modes, exact_band: Band):
    alone = score(one_mode, exact_band)
    both = score_together([moved(one_mode)] * 2, [exact_band] * 2)
    assert [fit.converged for fit in both] == [True, True]
    assert both[0].modes.frequency == pytest.approx(both[1].modes.frequency, rel=1e-12)
    assert both[0].std(0)[0] == pytest.approx(alone.std(0)[0] / np.sqrt(2.0), rel=0.02)


def test_a_search_far_above_its_target_is_given_up(one_mode: Modes, exact_band: Band):
    assert not score(moved(one_mode), exact_band, target=-1e9).converged


def test_evidence_is_schwarzs(one_mode: Modes, exact_band: Band):
    found = score(one_mode, exact_band)
    assert evidence(found, 800) == pytest.approx(found.deviance + one_mode.size * np.log(800))
