"""Readings that are none: codes for "no reading", and spikes beyond all vibration."""

import numpy as np
import pytest
from validation.adversary.scenarios import SCENARIOS, record

from tests.findings import notes
from validation import towers
from windsysid.identification.identify import identify
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.turbine import Turbine


@pytest.mark.parametrize(("code", "long"), [(-999.0, 8), pytest.param(1e5, 1, marks=pytest.mark.slow)])
def test_a_code_for_no_reading_does_not_end_in_an_error(verne555: Turbine, code: float, long: int):
    """A search went so far astray that a level overflowed."""
    made = record("reference", 290_003)
    values = made.values.copy()
    for column, row in enumerate((2500, 1000, 3000), start=2):
        values[row : row + long, column] = code
    made = made.with_channels({name: (values[:, i], made.units[i]) for i, name in enumerate(made.channels)})
    found = identify(made, verne555, prior=DrawnPrior(seed=290_003))
    truth = SCENARIOS["reference"].machine.truth
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0
    assert sum("taken as missing" in one.data.get("text", "") for one in notes(found)) == 3


def test_a_first_reading_that_is_off_is_no_vibration():
    """A logger that has just been switched on: the loads were blamed."""
    made, truth = towers.simulate("healthy", 290_005)
    name = "tower_z_acceleration"
    values = made[name]
    values[0] += 10.0 * np.std(values)
    found = identify(made.with_channels({name: (values, "m/s^2")}), "tower", prior=DrawnPrior(seed=290_005))
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0
