"""The misfit of a band, and modes that stand for its border."""

import numpy as np
import pytest

from windsysid.spectral.modal_bands.check import is_spurious, misfit, part_fits
from windsysid.spectral.modal_bands.model import Modes
from windsysid.spectral.modal_bands.model_order import BandFit
from windsysid.spectral.modal_bands.scoring import score
from windsysid.spectral.transforms.dft import Band

LENGTH = 400.0


@pytest.fixture(scope="module")
def found(one_mode: Modes, exact_band: Band, transforms: tuple[np.ndarray, np.ndarray]) -> BandFit:
    bins, values = transforms
    return BandFit(score(one_mode, exact_band), exact_band, values, bins, np.eye(2, dtype=complex), 0.0)


def test_a_spectrum_that_is_the_models_has_no_misfit(found: BandFit):
    assert abs(misfit(found)[0]) < 0.1


def test_a_misfit_is_told_in_its_standard_deviations_and_its_place(found: BandFit):
    power = found.band.power.copy()
    power[100:125] *= 1.5
    sigmas, where = misfit(found._replace(band=found.band._replace(power=power)))
    assert sigmas == pytest.approx(0.5 * np.sqrt(25 * 4 * 2), rel=0.05)
    assert where == pytest.approx(float(np.mean(found.band.frequency[100:125])))


def test_a_clear_mode_inside_is_real_and_one_outside_is_spurious(found: BandFit):
    assert not is_spurious(found, 0, LENGTH)
    outside = found.fit._replace(modes=found.fit.modes._replace(frequency=np.array([1.3])))
    assert is_spurious(found._replace(fit=outside), 0, LENGTH)


def test_parts_with_too_few_bins_are_not_fitted(found: BandFit):
    frequency = np.array([0.9, 1.0, 1.1])
    assert part_fits(found, [(frequency, np.ones((3, 2), dtype=complex))] * 2, 4000, 10.0) == []
