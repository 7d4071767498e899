"""Modes of results as they are compared: what a record itself says, without the prior that all records share."""

import math

import pytest

from windsysid.spectral.modal_bands.scoring import DAMPING_PRIOR
from windsysid.spectral.oma.known_modes import KnownMode, without_damping_prior


def mode(ln_damping: float, std: float) -> KnownMode:
    return KnownMode("mode 1", 0.0, 0.001, ln_damping, std, {"a": 1.0 + 0.0j}, True)


@pytest.mark.parametrize(("own", "own_std"), [(math.log(0.005), 0.3), (math.log(0.06), 1.0)])
def test_the_prior_of_damping_is_taken_out_again(own: float, own_std: float):
    centre, spread = DAMPING_PRIOR
    information = own_std**-2.0 + spread**-2.0
    mean = (own * own_std**-2.0 + centre * spread**-2.0) / information
    assert without_damping_prior(mode(mean, information**-0.5)) == pytest.approx((own, own_std))


def test_a_damping_that_is_the_priors_says_nothing():
    assert without_damping_prior(mode(DAMPING_PRIOR[0], DAMPING_PRIOR[1]))[1] == math.inf
