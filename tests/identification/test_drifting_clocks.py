"""A logger whose clock drifts is found by gravity or by what vibrates, and its readings are put back in time."""

import numpy as np
import pytest
from validation.adversary.instruments import Instruments
from validation.adversary.scenarios import SCENARIOS, Scenario, record

from tests.findings import codes, only, reasons
from tests.identification.fits import identify_without_effects
from windsysid.identification.effects import clock_drift as drifting_clocks
from windsysid.identification.effects.clock_drift import ClockDrift, find_drift, persists, together
from windsysid.identification.identify import identify
from windsysid.identification.job import Job
from windsysid.identification.model.drift import Drift
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
    rate, std = found
    assert rate == pytest.approx(5e-5, abs=3.0 * std)
    assert std < 5e-6


def job(made: Record, turbine: Turbine) -> Job:
    return Job(made, made, turbine, None, None, None, None, "auto")


def test_a_steady_clock_is_left_alone(verne555: Turbine):
    for seed in range(2):
        steady = simulate_record(verne555, duration=300.0, rate=50.0, seed=seed)
        assert ClockDrift().find(job(steady, verne555)) is None


@pytest.mark.slow
def test_the_turbine_is_identified_from_readings_that_were_put_back(drifting: Record):
    """Coefficients were 5 to 20 standard deviations off, and filters took minutes."""
    found = identify_without_effects(drifting, TURBINE, formulation="auto", prior=DrawnPrior(seed=300))
    truth = SCENARIOS["reference"].machine.truth
    assert found.formulation == "spectral"
    assert found.diagnosis.trusted
    assert only(found.findings, "clock_drift").data["rate"] > 0.0
    assert all(abs(e.estimate - truth[e.name]) < 3.0 * e.std for e in found.estimates)


@pytest.mark.slow
def test_filters_that_are_asked_for_say_that_they_feel_it(drifting: Record, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(drifting_clocks, "find_drift", lambda *given: (2.5e-4, 3e-6))
    part = drifting.section(0.0, 20.0)
    found = identify_without_effects(part, TURBINE, loads="broadband", prior=DrawnPrior(seed=300))
    assert "drift_moved_readings" in codes(reasons(found))


def test_late_readings_are_moved_to_when_they_were_taken():
    time = np.arange(2000) / 20.0
    late = 1e-3 * time
    moved = drifting_clocks._moved(time, np.sin(3.0 * (time - late)), late)
    np.testing.assert_allclose(moved[100:-100], np.sin(3.0 * time[100:-100]), atol=0.02)


def test_gaps_stay_gaps(drifting: Record):
    values = drifting.values.copy()
    values[1000:1100, drifting.channels.index(BLADES[0])] = np.nan
    gappy = Record(drifting.time, values, drifting.channels, drifting.units)
    drifts = ClockDrift().find(job(gappy, TURBINE))
    assert drifts is not None
    moved, _ = drifts.correct(gappy, TURBINE, TURBINE.sensors, filtered=False)
    assert np.isnan(moved[BLADES[0]]).sum() == 100
    assert np.isfinite(moved[BLADES[1]]).all()


@pytest.mark.slow
def test_in_100_s_vibration_tells_a_drift():
    """Filters found their innovations louder at one frequency than at another, and blamed the loads."""
    seen = record("clock drifts 50 ppm", 120019)
    found = identify(seen, TURBINE, prior=DrawnPrior(seed=120019), formulation="spectral")
    drift = only(found.findings, "clock_drift").data
    assert drift["by"].startswith("vibration")
    ppm, std = 1e6 * drift["rate"], 1e6 * drift["std"]
    assert abs(ppm - 50.0) < 3.0 * std < 20.0
    assert found.diagnosis.trusted


@pytest.mark.slow
def test_a_drift_is_put_back_until_none_is_left(monkeypatch: pytest.MonkeyPatch):
    """The first look sees too little: what drifts bends what the halves are held against."""
    monkeypatch.setitem(SCENARIOS, "drifting", Scenario("instrument", instruments=Instruments(drift=-1.5e-4)))
    found = identify(
        record("drifting", 110301), TURBINE, formulation="spectral", prior=DrawnPrior(seed=110301), loads="broadband"
    )
    drift = only(found.findings, "clock_drift").data
    ppm, std = -1e6 * drift["rate"], 1e6 * drift["std"]
    assert abs(ppm - 150.0) < 3.0 * std


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["reference", "support 15 % softer from midway"])
def test_halves_on_one_clock_show_no_drift(kind: str):
    prior = DrawnPrior(seed=11)
    found = identify(record(kind, 11), TURBINE, formulation="spectral", prior=prior, loads="broadband")
    assert "clock_drift" not in codes(found.findings)


def test_what_is_left_adds_to_what_was_put_back():
    before = (Drift("rotor", 4e-5, 3e-6), Drift("mast", 1e-5, 1e-6))
    rotor, mast = together(before, (Drift("rotor", 1e-5, 5e-7, "vibration"),))
    assert rotor.rate == pytest.approx(5e-5)
    assert rotor[2:] == (5e-7, "vibration")
    assert mast == before[1]


def test_what_does_not_go_away_when_it_is_put_back_is_no_drift():
    """A steady line can look like a drift, and like a larger one once that was put back."""
    seen = (Drift("rotor", 1.5e-4, 1e-6),)
    assert persists((Drift("rotor", -2.9e-4, 3e-6),), seen)
    assert not persists((Drift("rotor", 4e-5, 1e-6),), seen)
    assert not persists((Drift("rotor", 3e-6, 1e-6),), (Drift("rotor", 4e-6, 1e-6),))


@pytest.mark.parametrize(("rate", "is_clock"), [(2.9e-4, True), (-2.9e-4, True), (3.1e-4, False), (-3.1e-4, False)])
def test_no_clock_drifts_by_more_than_300_ppm(verne555: Turbine, rate: float, is_clock: bool):
    assert Drift("rotor", rate, 1e-6).matters(verne555, 600.0) is is_clock
