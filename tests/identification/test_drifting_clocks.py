"""A logger on blades whose clock drifts is found by gravity, and its readings are put back to when they were taken."""

import numpy as np
import pytest
from validation.adversary.instruments import Instruments
from validation.adversary.scenarios import SCENARIOS, Scenario, record

from windsysid.identification import drifting_clocks
from windsysid.identification.drifting_clocks import Drift, find_drift, without_drift
from windsysid.identification.identify import identify
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

TURBINE = load_turbine("verne555")
BLADES = [sensor.channel for sensor in TURBINE.sensors if sensor.blade]


@pytest.fixture(scope="module")
def drifting() -> Record:
    """Ten minutes whose blades' clock is 30 ms late at the end, simulated by code that shares none with windsysid."""
    with pytest.MonkeyPatch.context() as patch:
        kind = Scenario("instrument", instruments=Instruments(drift=5e-5), duration=600.0, rate=50.0)
        patch.setitem(SCENARIOS, "drifting", kind)
        return record("drifting", 300)


def test_the_drift_is_found_within_its_band(drifting: Record):
    found = find_drift(drifting, BLADES, TURBINE.rotor_speed)
    assert found is not None
    assert found.rate == pytest.approx(5e-5, abs=3.0 * found.std)
    assert found.std < 5e-6


def test_a_steady_clock_is_left_alone(verne555: Turbine):
    for seed in range(4):
        steady = simulate_record(verne555, duration=300.0, rate=50.0, seed=seed)
        same, notes = without_drift(steady, verne555, verne555.sensors)
        assert same is steady
        assert not notes


def test_the_turbine_is_identified_from_readings_that_were_put_back(drifting: Record):
    """Coefficients were 5 to 20 standard deviations off, and filters took minutes."""
    found = identify(drifting, TURBINE, prior=DrawnPrior(seed=300))
    truth = SCENARIOS["reference"].machine.truth
    assert found.formulation == "spectral"
    assert found.diagnosis.trusted
    assert any("ppm too fast" in note for note in found.notes)
    assert all(abs(e.estimate - truth[e.name]) < 3.0 * e.std for e in found.estimates)


def test_filters_that_are_asked_for_say_that_they_feel_it(drifting: Record, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(drifting_clocks, "find_drift", lambda *given: Drift(2.5e-4, 3e-6))
    part = drifting.section(0.0, 20.0)
    found = identify(part, TURBINE, formulation="joint", loads="broadband", prior=DrawnPrior(seed=300))
    assert any("use --formulation spectral" in reason for reason in found.diagnosis.reasons)


def test_gaps_stay_gaps(drifting: Record):
    values = drifting.values.copy()
    values[1000:1100, drifting.channels.index(BLADES[0])] = np.nan
    gappy = Record(drifting.time, values, drifting.channels, drifting.units)
    moved, _ = without_drift(gappy, TURBINE, TURBINE.sensors)
    assert np.isnan(moved[BLADES[0]]).sum() == 100
    assert np.isfinite(moved[BLADES[1]]).all()
