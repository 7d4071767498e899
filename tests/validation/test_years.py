"""Simulated years: the blocks are what the study says they are, damage is seen within hours and nothing else is."""

import numpy as np
import pytest
from validation.years import Site, delays, false_alarms, simulate_blocks

from validation import years
from windsysid.monitoring.series import DAY

PLACE = Site("none", ("k_x", "c_x", "k_beta_1"), np.array([0.003, 0.4, 0.0012]), 10.0)


def test_simulated_blocks_scatter_as_stated_and_change_when_stated():
    blocks = simulate_blocks(PLACE, days=60.0, seed=1, change=("k_x", 0.9))
    y = blocks.theta[:, 0] + 0.0003 * (blocks.covariates[:, 0] - 10.0)
    quiet = np.abs(np.diff(y)) < 0.03  # neither the change nor bad blocks
    assert np.std(np.diff(y)[quiet]) / np.sqrt(2.0) == pytest.approx(1.2 * 0.003, rel=0.08)
    at = int(30.0 * DAY / 600.0)
    assert np.nanmedian(y[at : at + 500]) - np.nanmedian(y[at - 500 : at]) == pytest.approx(np.log(0.9), abs=0.002)
    assert 0.02 < np.isnan(blocks.theta[:, 0]).mean() < 0.04


@pytest.mark.slow
def test_damage_is_seen_within_hours():
    found = delays(PLACE, ("k_x", 0.95), 5)
    assert (found.seconds <= 2.0 * 3600.0).all()
    assert (delays(PLACE, ("c_x", 0.5), 5).seconds <= 2.0 * DAY).all()


@pytest.mark.slow
def test_a_year_without_a_change_has_no_alarm():
    assert false_alarms(PLACE, 1, years.STATED) == 0
