"""Loads that drive a mode and its neighbours, in data that have them exactly or not at all."""

import numpy as np

from windsysid.spectral.modal_bands.correlated_loads import are_shared, fit_shared
from windsysid.spectral.modal_bands.model import Modes, spectrum
from windsysid.spectral.modal_bands.scoring import evidence, score
from windsysid.spectral.transforms.dft import Band


def test_a_mode_with_a_load_of_its_own_shares_none(one_mode: Modes, exact_band: Band):
    assert not are_shared(score(one_mode, exact_band), exact_band)


def test_a_drifting_shape_is_detected_and_fitted_with_greater_evidence(one_mode: Modes, exact_band: Band):
    drifting = one_mode._replace(drift=np.array([[0.3], [-0.2j]]), rest=0.1 * one_mode.rest)
    band = exact_band._replace(power=spectrum(drifting, exact_band))
    plain = score(one_mode, band)
    assert are_shared(plain, band)
    shared = fit_shared(plain, band, 800, 1)
    assert shared is not None
    assert shared.modes.drift is not None
    assert evidence(shared, 800) < evidence(plain, 800)
    assert abs(np.log(shared.modes.frequency[0])) < shared.std(0)[0]
