"""A jump is dated to its block, and measured with what is known of it."""

import numpy as np
import pytest

from windsysid.monitoring.levels.jumps import Observations, Rates
from windsysid.monitoring.levels.locating import first_belief, locate

SIGMA = 0.004


@pytest.mark.parametrize("at", [120, 151])
def test_a_clear_jump_is_dated_to_its_block(at: int):
    rng = np.random.default_rng(at)
    y = SIGMA * rng.standard_normal(200)
    y[at:] -= 20.0 * SIGMA
    r, x = np.full(200, SIGMA**2), np.zeros((200, 1))
    prior, scale = first_belief(y[:100], r[:100], 1, "k", True)
    jump = locate(Observations.of(y, r, x), prior, Rates(1e-12, 1.0), at + 2, at - 2, 0.1 * scale, scale)
    assert (jump.at, jump.earliest, jump.latest, jump.found) == (at, at, at, at + 2)
    assert jump.size == pytest.approx(-20.0 * SIGMA, abs=4.0 * jump.std)
    assert jump.std < SIGMA
    assert jump.before == pytest.approx(0.0, abs=SIGMA)
