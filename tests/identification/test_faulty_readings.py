"""Readings that are none: codes for "no reading", and spikes beyond all vibration."""

import numpy as np
import pytest
from validation.adversary.scenarios import SCENARIOS, record

from tests.findings import notes
from tests.identification.fits import identify_without_effects
from validation import towers
from windsysid.identification.identify import identify
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


@pytest.mark.slow
@pytest.mark.parametrize(("code", "long"), [(-999.0, 8), (1e5, 1)])
def test_a_code_for_no_reading_does_not_end_in_an_error(verne555: Turbine, code: float, long: int):
    """A search went so far astray that a level overflowed."""
    made = record("reference", 290_003)
    values = made.values.copy()
    for column, row in enumerate((2500, 1000, 3000), start=2):
        values[row : row + long, column] = code
    made = made.with_channels({name: (values[:, i], made.units[i]) for i, name in enumerate(made.channels)})
    found = identify_without_effects(made, verne555, formulation="auto", prior=DrawnPrior(seed=290_003))
    truth = SCENARIOS["reference"].machine.truth
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0
    assert sum("taken as missing" in one.data.get("text", "") for one in notes(found)) == 3


@pytest.mark.slow
def test_a_first_reading_that_is_off_is_no_vibration():
    """A logger that has just been switched on: the loads were blamed."""
    made, truth = towers.simulate("healthy", 290_005)
    name = "tower_z_acceleration"
    values = made[name]
    values[0] += 10.0 * np.std(values)
    found = identify(made.with_channels({name: (values, "m/s^2")}), "tower", prior=DrawnPrior(seed=290_005))
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0


def test_clipped_readings_of_a_decay_are_missing():
    """The damping of the channel that was not clipped was 4 standard deviations off, of grade B: loads share their
    spectrum."""
    made, name = simulate_record(load_turbine("tower"), duration=300.0, rate=4.0, seed=883_000), "tower_x_acceleration"
    truth = {"tower side-side": (0.3163, 0.006), "tower fore-aft": (0.324, 0.06)}
    turned = 2.0 * np.pi * 0.3163 * (made.time - made.time[0])
    values = made[name] + 15.0 * np.std(made[name]) * np.exp(-0.006 * turned) * np.cos(turned)
    largest = 0.25 * np.abs(values).max()
    found = identify(made.with_channels({name: (np.clip(values, -largest, largest), "m/s^2")}), "tower")
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert any(one.code == "clipping" and "taken as missing" in one.data["text"] for one in notes(found))
    for mode in found.modes:
        for (_, one), expected in zip(mode.quantities, truth[mode.name], strict=True):
            assert abs(one.estimate - expected) < 3.0 * one.std
